//! From a hit to a point on a surface, with a bound of its error.

use super::{EMITTER_PER_PRIMITIVE, HAS_NORMALS, HAS_UVS, IS_DISK, IS_SPHERE, Scene, shading_frame};
use crate::emitter::{NO_EMITTER, POINT_ERROR};
use crate::math::{Frame, Matrix, Vec3, offset_from_surface, vec3};
use crate::texture::Textures;
use rebond_bvh::{Hit, Ray};
use rebond_lanes::{Index, Mask, Real, math};
use std::f32::consts::{FRAC_1_PI, PI};

/// A point on a surface, as a ray found it.
#[derive(Clone, Copy, Debug)]
pub struct Surface<F: Real> {
    /// The point, computed on the surface rather than along the ray.
    pub p: Vec3<F>,
    /// Bound, per axis, of the distance of `p` from the true surface.
    pub error: F,
    /// Geometric unit normal.
    pub ng: Vec3<F>,
    /// Shading frame.
    pub frame: Frame<F>,
    /// Texture coordinates.
    pub uv: [F; 2],
    /// Primitive it is of, as [`Hit`] counts.
    pub primitive: F::Index,
    /// Of a triangle, the weights of its second and third corner.
    pub weights: [F; 2],
    /// ∂p/∂u and ∂p/∂v; zero in scenes without maps of normals and heights.
    pub dp: [Vec3<F>; 2],
    /// Unit direction back along the ray.
    pub wo: Vec3<F>,
    /// Material.
    pub material: F::Index,
    /// Emitter, or [`NO_EMITTER`].
    pub emitter: F::Index,
    /// When it was hit.
    pub time: F,
}

impl<F: Real> Surface<F> {
    /// Lanes in which the ray came from the side of the normal.
    #[inline(always)]
    pub fn front(&self) -> F::Mask {
        self.wo.dot(self.ng).gt(F::zero())
    }

    /// The unit normal that a map gives: from heights in the lanes of `heights` (Blinn 1978, eq. 4: the normal of
    /// `p + h n`, the curvature of the surface left out), else from normals in the frame of ∂p/∂u, ∂p/∂v and the normal.
    #[inline(always)]
    pub(super) fn normal_under(&self, textures: &Textures, texture: F::Index, scale: F, heights: F::Mask) -> Vec3<F> {
        let n = self.frame.n;
        let mut found = n;
        if !heights.all() {
            let texel = textures.eval(texture, self.uv);
            let (x, y) = (texel.r * 2.0 - 1.0, texel.g * 2.0 - 1.0);
            // A normal that points into the surface is none.
            let z = (texel.b * 2.0 - 1.0).max(F::splat(1e-3));
            let t = self.frame.t * F::one().copy_sign(self.frame.t.dot(self.dp[1]));
            found = (self.frame.s * (x * scale) + t * (y * scale) + n * z).normalized();
        }
        if heights.any() {
            let [hu, hv] = textures.slope(texture, self.uv);
            let along_u = self.dp[0] + n * (hu * scale);
            let along_v = self.dp[1] + n * (hv * scale);
            // Only directions count, and squares of squares of lengths would be beyond f32.
            let unit = |v: Vec3<F>| v * v.max_abs().recip();
            let bumped = unit(along_u).cross(unit(along_v)).normalized().facing(n);
            // At a pole u has no direction.
            let usable = bumped.dot(n).gt(F::zero());
            found = Vec3::select(heights, Vec3::select(usable, bumped, n), found);
        }
        found
    }

    /// Where a ray into direction `w` starts, so that it does not meet this surface again.
    #[inline(always)]
    pub fn leave(&self, w: Vec3<F>) -> Vec3<F> {
        offset_from_surface(self.p, self.error, self.ng, w)
    }
}

/// Geometry of a hit, in the space of its instance.
#[derive(Clone, Copy)]
struct Local<F: Real> {
    p: Vec3<F>,
    error: F,
    ng: Vec3<F>,
    ns: Vec3<F>,
    tangent: Vec3<F>,
    uv: [F; 2],
    dp: [Vec3<F>; 2],
}

#[inline(always)]
pub fn surface<F: Real>(scene: &Scene, ray: &Ray<F>, hit: &Hit<F>, mask: F::Mask) -> Surface<F> {
    let primitive = F::Index::select(mask, hit.primitive, F::Index::splat(0));
    let corners = F::words(&scene.primitives, primitive);
    let [material, first_emitter, flags, first_primitive] = F::words(&scene.shapes, corners[3]);
    let flag = |f: u32| (flags & F::Index::splat(f)).ne(F::Index::splat(0));
    let analytic = if scene.features.analytic { flag(IS_SPHERE | IS_DISK) & mask } else { F::Mask::splat(false) };

    let matrix = scene.features.instances.then(|| {
        let instance = F::Index::select(mask, hit.instance, F::Index::splat(0));
        scene.instances.at(instance, ray.time, mask)
    });
    let mut local = triangle(scene, hit, &corners, flag(HAS_NORMALS), flag(HAS_UVS), analytic);
    if analytic.any() {
        let round = round(scene, ray, hit, corners[0], flag(IS_SPHERE), analytic, matrix.as_ref());
        let pick = |a: Vec3<F>, b: Vec3<F>| Vec3::select(analytic, a, b);
        local = Local {
            p: pick(round.p, local.p),
            error: F::select(analytic, round.error, local.error),
            ng: pick(round.ng, local.ng),
            ns: pick(round.ns, local.ns),
            tangent: pick(round.tangent, local.tangent),
            uv: [F::select(analytic, round.uv[0], local.uv[0]), F::select(analytic, round.uv[1], local.uv[1])],
            dp: [pick(round.dp[0], local.dp[0]), pick(round.dp[1], local.dp[1])],
        };
    }
    if let Some(matrix) = &matrix {
        local = place(matrix, local);
    }
    let emitter = if scene.features.emissive_shapes {
        let own = flag(EMITTER_PER_PRIMITIVE);
        let number = first_emitter + F::Index::select(own, primitive - first_primitive, F::Index::splat(0));
        F::Index::select(first_emitter.eq(F::Index::splat(NO_EMITTER)), first_emitter, number)
    } else {
        F::Index::splat(NO_EMITTER)
    };
    let tangent = scene.features.tangents.then_some(local.tangent);
    Surface {
        p: local.p,
        error: local.error,
        ng: local.ng,
        frame: shading_frame(local.ns, tangent),
        uv: local.uv,
        primitive,
        weights: [hit.u, hit.v],
        dp: local.dp,
        wo: vec3(-ray.d[0], -ray.d[1], -ray.d[2]),
        material,
        emitter,
        time: ray.time,
    }
}

#[inline(always)]
fn triangle<F: Real>(
    scene: &Scene,
    hit: &Hit<F>,
    corners: &[F::Index; 4],
    has_normals: F::Mask,
    has_uvs: F::Mask,
    other: F::Mask,
) -> Local<F> {
    if scene.vertices.is_empty() || other.all() {
        let z = Vec3::splat([0.0, 0.0, 1.0]);
        let (nowhere, nothing) = (Vec3::zero(), F::zero());
        return Local { p: nowhere, error: nothing, ng: z, ns: z, tangent: z, uv: [nothing; 2], dp: [nowhere; 2] };
    }
    let vertex = |i: usize| F::record(&scene.vertices, corners[i]);
    let (v0, v1, v2) = (vertex(0), vertex(1), vertex(2));
    let (p0, p1, p2) = (Vec3::of_record(v0), Vec3::of_record(v1), Vec3::of_record(v2));
    let (e1, e2) = (p1 - p0, p2 - p0);
    // Squares of squares of large or small lengths would be beyond f32.
    let (size1, size2) = (e1.max_abs(), e2.max_abs());
    let ng = (e1 * size1.recip()).cross(e2 * size2.recip()).normalized();
    let mut local = Local {
        p: e1.mul_add(hit.u, e2.mul_add(hit.v, p0)),
        error: (p0.max_abs() + size1 + size2) * POINT_ERROR,
        ng,
        ns: ng,
        tangent: e1,
        uv: [hit.u, hit.v],
        dp: [Vec3::zero(), Vec3::zero()],
    };
    if scene.features.maps {
        local.dp = [e1, e2];
    }
    if scene.features.normals && (has_normals | has_uvs).any() {
        let normal = |i: usize| F::record(&scene.normals, corners[i]);
        let (n0, n1, n2) = (normal(0), normal(1), normal(2));
        let w = F::one() - hit.u - hit.v;
        let across = |a: F, b: F, c: F| w * a + hit.u * b + hit.v * c;
        let n = vec3(across(n0[0], n1[0], n2[0]), across(n0[1], n1[1], n2[1]), across(n0[2], n1[2], n2[2]));
        let length2 = n.length_squared();
        // Normals that cancel out, or were never there, leave the geometric one; the side is the face's.
        let usable = has_normals & length2.gt(F::splat(1e-12));
        local.ns = Vec3::select(usable, (n * length2.sqrt().recip()).facing(ng), ng);
        let uv = [across(v0[3], v1[3], v2[3]), across(n0[3], n1[3], n2[3])];
        local.uv = [F::select(has_uvs, uv[0], local.uv[0]), F::select(has_uvs, uv[1], local.uv[1])];
        if scene.features.tangents {
            // ∂p/∂u from the UVs of the corners; the first edge where they are degenerate.
            let (du1, du2, dv1, dv2) = (v1[3] - v0[3], v2[3] - v0[3], n1[3] - n0[3], n2[3] - n0[3]);
            let determinant = du1 * dv2 - du2 * dv1;
            let along_u = e1 * dv2 - e2 * dv1;
            let usable = has_uvs & determinant.abs().gt(F::splat(1e-12));
            local.tangent = Vec3::select(usable, along_u * F::one().copy_sign(determinant), local.tangent);
            if scene.features.maps {
                let (inverse, along_v) = (determinant.recip(), e2 * du1 - e1 * du2);
                local.dp = [
                    Vec3::select(usable, along_u * inverse, local.dp[0]),
                    Vec3::select(usable, along_v * inverse, local.dp[1]),
                ];
            }
        }
    }
    local
}

/// A sphere or a disk.
#[inline(always)]
fn round<F: Real>(
    scene: &Scene,
    ray: &Ray<F>,
    hit: &Hit<F>,
    place: F::Index,
    sphere: F::Mask,
    mask: F::Mask,
    matrix: Option<&Matrix<F>>,
) -> Local<F> {
    let place = F::Index::select(mask, place, F::Index::splat(0));
    let record = |n: u32| F::record(&scene.analytic, place + F::Index::splat(n));
    let ([cx, cy, cz, radius], [sx, sy, sz, sign], [nx, ny, nz, hand]) = (record(0), record(1), record(2));
    let (center, axes) = (
        vec3(cx, cy, cz),
        Frame { s: vec3(sx, sy, sz), t: vec3(nx, ny, nz).cross(vec3(sx, sy, sz)) * hand, n: vec3(nx, ny, nz) },
    );
    let (o, d) = (Vec3 { x: ray.o[0], y: ray.o[1], z: ray.o[2] }, Vec3 { x: ray.d[0], y: ray.d[1], z: ray.d[2] });
    let along = d.mul_add(hit.t, o);
    let along = matrix.map_or(along, |m| m.point_before(along));
    let from_center = along - center;
    // Onto the sphere, or into the plane of the disk.
    let out = from_center.normalized();
    let flat = from_center - axes.n * axes.n.dot(from_center);
    let arm = Vec3::select(sphere, out * radius, flat);
    let n = Vec3::select(sphere, out, axes.n) * sign;
    let l = axes.to_local(arm) * radius.recip();
    let phi = math::atan2(l.y, l.x) * (0.5 * FRAC_1_PI);
    let u = phi - phi.floor();
    let v = F::select(sphere, math::acos(-l.z) * FRAC_1_PI, (l.x * l.x + l.y * l.y).sqrt());
    let dp = if scene.features.maps {
        // u goes around the axis; v from pole to pole along π r, or outwards along r.
        let outwards = (arm - axes.n * axes.n.dot(arm)).normalized();
        let up = (axes.n * (F::one() - l.z * l.z).safe_sqrt() - outwards * l.z) * (radius * PI);
        [axes.n.cross(arm) * (hand * (2.0 * PI)), Vec3::select(sphere, up, outwards * radius)]
    } else {
        [Vec3::zero(), Vec3::zero()]
    };
    let (mut p, mut error) = (center + arm, (center.max_abs() + radius) * POINT_ERROR);
    if matrix.is_none() {
        // A sphere so large or so far off that the way along the ray is known better: walls of smallpt's kind.
        let error_along = (o.max_abs() + d.max_abs() * hit.t) * POINT_ERROR;
        let better = sphere & error_along.lt(error);
        (p, error) = (Vec3::select(better, along, p), F::select(better, error_along, error));
    }
    Local {
        p,
        error,
        ng: n,
        ns: n,
        tangent: Vec3::select(sphere, axes.n.cross(out) * hand, axes.s) * F::splat(2.0 * PI),
        uv: [u, v],
        dp,
    }
}

/// A hit's geometry brought into the world.
#[inline(always)]
fn place<F: Real>(m: &Matrix<F>, l: Local<F>) -> Local<F> {
    // Normals go by the transposed inverse; outwards stays outwards if the matrix mirrors.
    let (cofactors, determinant) = m.cofactors();
    let sign = F::one().copy_sign(determinant);
    let normal = |n: Vec3<F>| vec3(cofactors[0].dot(n), cofactors[1].dot(n), cofactors[2].dot(n)).normalized() * sign;
    let stretch = m.stretch();
    let size = l.p.max_abs() * stretch + m.translation().max_abs();
    Local {
        p: m.point(l.p),
        error: l.error * stretch + size * POINT_ERROR,
        ng: normal(l.ng),
        ns: normal(l.ns),
        tangent: m.vector(l.tangent),
        uv: l.uv,
        dp: [m.vector(l.dp[0]), m.vector(l.dp[1])],
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::film::Image;
    use crate::scene::description::{CameraDescription, ShapeDescription, Sphere};
    use crate::scene::{MeshSource, Resources, SceneDescription, build, is_hit};
    use crate::shape::MeshData;
    use crate::testing::random_pairs;
    use crate::texture::Encoding;

    struct NoFiles;
    impl Resources for NoFiles {
        fn mesh(&self, file: &str, _: MeshSource) -> Result<MeshData, String> {
            Err(file.into())
        }
        fn image(&self, file: &str, _: Encoding) -> Result<Image, String> {
            Err(file.into())
        }
    }

    /// On a sphere of radius 1e5 a point is known to a few thousandths of a unit from its centre, but far better along a short ray.
    #[test]
    fn points_of_large_and_small_spheres_are_within_their_errors() {
        for (radius, most) in [(1e5_f32, 1e-3), (1.0, 1e-4)] {
            let sphere = Sphere {
                center: [radius, 0.0, 0.0],
                radius,
                flip_normals: false,
                material: None,
                emission: None,
                to_world: Default::default(),
            };
            let description = SceneDescription {
                shapes: vec![ShapeDescription::Sphere(sphere)],
                camera: CameraDescription::default(),
                ..SceneDescription::default()
            };
            let scene = build(&description, &NoFiles).expect("a scene");
            let mut hits = 0;
            for [u, v] in random_pairs(2000) {
                let o = [-20.0 - 80.0 * u, 60.0 * v - 30.0, 10.0 * u];
                let d = (vec3(0.0, 0.3 * u, 0.2 * v) - Vec3::splat(o)).normalized();
                let ray = Ray { o, d: d.array(), tmax: f32::INFINITY, time: 0.0 };
                let hit = scene.intersect(&ray, true, false);
                if !is_hit(&hit) {
                    continue;
                }
                hits += 1;
                let surface = scene.surface(&ray, &hit, true);
                let [x, y, z] = surface.p.array().map(f64::from);
                let r = f64::from(radius);
                let off = ((x - r).powi(2) + y * y + z * z).sqrt() - r;
                let error = f64::from(surface.error);
                assert!(
                    off.abs() <= error * 3.0_f64.sqrt() && error < most,
                    "radius {radius}: off by {off}, bound {error}"
                );
            }
            assert!(hits > 1000, "{hits}");
        }
    }
}
