//! One bounce of camera paths: what both engines do between a ray and the next.

use super::journal::{Asked, Journal, Vertex};
use super::path_classes::PathClasses;
use super::path_state::{PathState, Shade};
use crate::bsdf::Event;
use crate::math::{Rgb, vec3};
use crate::scene::{Scene, is_hit};
use rebond_bvh::{Hit, Trace};
use rebond_lanes::{Index, Mask, Real};

/// What became of paths at a bounce.
pub struct Bounced<F: Trace> {
    /// Paths that go on.
    pub alive: F::Mask,
    /// Lanes that traced a shadow ray.
    pub shadow_rays: F::Mask,
}

/// What the rays of the `active` lanes hit.
#[inline(always)]
pub fn trace<F: Trace>(scene: &Scene, path: &PathState<F>, active: F::Mask, coherent: bool) -> Hit<F> {
    let first = blind(scene, path, active);
    if first.any() {
        let (seen, met) = (scene.see(&path.ray(), first), scene.intersect(&path.ray(), active.and_not(first), false));
        select(first, seen, met)
    } else {
        scene.intersect(&path.ray(), active, coherent)
    }
}

/// Rays of an eye that sees no lights.
#[inline(always)]
fn blind<F: Trace>(scene: &Scene, path: &PathState<F>, active: F::Mask) -> F::Mask {
    if scene.hides_emitters() { active & path.depth.eq(Index::splat(1)) } else { F::Mask::splat(false) }
}

/// Lets the estimator handle what the rays of the `active` lanes hit, and traces its shadow rays. Light counts only
/// if it is of a class that is wanted; `deposit` is told of all that counts, with its layer's number + 1, and the
/// journal of the first lane.
#[inline(always)]
#[expect(clippy::too_many_arguments)]
pub fn bounce<F: Trace>(
    scene: &Scene,
    shade: &impl Shade,
    classes: Option<&PathClasses>,
    path: &mut PathState<F>,
    hit: &Hit<F>,
    active: F::Mask,
    mut deposit: impl FnMut(&PathState<F>, F::Index, Rgb<F>),
    journal: &mut impl Journal,
) -> Bounced<F> {
    let gathered = path.radiance();
    path.set_radiance(Rgb::black());
    let first = blind(scene, path, active);
    journal.write(|vertices| vertices.push(Vertex::new(scene, path, hit)));
    let bounce = shade.shade_telling(scene, path, hit, active, journal);
    if first.any() {
        // Nor does it see surroundings.
        path.set_radiance(path.radiance().masked(is_hit(hit) | !first));
    }
    if let Some(classes) = classes {
        // What the estimator added came along the present ray.
        let layer = classes.light::<F>(path.class);
        let light = path.radiance().masked(layer.ne(F::Index::splat(0)));
        path.set_radiance(light);
        deposit(path, layer, light);
    }
    journal.last(|vertex| vertex.found = path.radiance().lane(0));
    let mut shadow_rays = F::Mask::splat(false);
    if let Some(shadow) = bounce.shadow {
        let mut layer = F::Index::splat(0);
        shadow_rays = shadow.mask;
        if let Some(classes) = classes {
            layer = classes.light::<F>(classes.step::<F>(path.class, shadow.event));
            shadow_rays = shadow_rays & layer.ne(F::Index::splat(0));
        }
        let wanted = shadow_rays;
        // A ray of no length meets nothing.
        shadow_rays = shadow_rays & shadow.ray.tmax.gt(F::zero());
        let blocked = scene.occluded(&shadow.ray, shadow_rays);
        let light = shadow.contribution.masked(wanted.and_not(blocked));
        if wanted.bits() & 1 == 1 {
            journal.last(|vertex| {
                let [x, y, z] = shadow.ray.d;
                let (d, infinite) = (vec3(x, y, z), shadow.ray.tmax.is_finite().bits() & 1 == 0);
                let length = d.length_squared().sqrt();
                vertex.asked = Some(Asked {
                    direction: (d * length.recip()).lane(0),
                    distance: if infinite { f32::INFINITY } else { length.lane(0) },
                    light: shadow.contribution.lane(0),
                    blocked: blocked.bits() & 1 == 1,
                });
            });
        }
        path.set_radiance(path.radiance() + light);
        if classes.is_some() {
            deposit(path, layer, light);
        }
    }
    journal.last(|vertex| vertex.contribution = path.radiance().lane(0));
    path.set_radiance(gathered + path.radiance());
    let mut alive = bounce.alive & active;
    if let Some(classes) = classes {
        path.class = classes.step::<F>(path.class, bounce.event);
        alive = alive & classes.may_count::<F>(path.class);
    }
    if alive.bits() & 1 == 1 {
        journal.last(|vertex| vertex.event = Event::ALL.get(bounce.event.lane(0) as usize).copied());
    }
    Bounced { alive, shadow_rays }
}

fn select<F: Real>(mask: F::Mask, a: Hit<F>, b: Hit<F>) -> Hit<F> {
    let (index, number) = (|a, b| F::Index::select(mask, a, b), |a, b| F::select(mask, a, b));
    Hit {
        t: number(a.t, b.t),
        u: number(a.u, b.u),
        v: number(a.v, b.v),
        primitive: index(a.primitive, b.primitive),
        instance: index(a.instance, b.instance),
    }
}
