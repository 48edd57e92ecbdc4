//! Every model: χ² of its sampler against its density, weight = f·cos/pdf, reciprocity, energy, both widths.

use super::check::{self, Angles, Effort, LARGEST_DISAGREEMENT, Material, sampling_directions, sidak};
use super::*;
use crate::math::{Moments, vec3};
use crate::testing::{SIGNIFICANCE, random_pairs, t_test_p_value};
use rebond_lanes::{F32x16, scalar::Index1};

fn lobe(p: [f32; PARAMETERS]) -> Lobe<f32> {
    Lobe { color: Rgb::splat([0.9, 0.8, 0.7]), p }
}

/// Gold, rough glass, and so on: (name, model, parameters).
fn models() -> Vec<(&'static str, Model, [f32; PARAMETERS])> {
    let metal = |ax, ay| [0.143, 0.375, 1.442, 3.983, 2.386, 1.603, ax, ay, 0.0];
    let glass = |eta, ax, ay| [eta, 0.0, 0.0, 0.0, 0.0, 0.0, ax, ay, 0.0];
    let of = |kind: f32, mut p: [f32; PARAMETERS]| {
        p[facets::KIND] = kind;
        p
    };
    let beckmann = |p| of(BECKMANN, p);
    let r = |r| [r, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    let ashikhmin = |rs, nu, nv| [rs, rs, rs * 0.5, nu, nv, 0.0, 0.0, 0.0, 0.0];
    let plastic = |eta, nonlinear, alpha| [eta, nonlinear, 0.0, 0.0, 0.0, 0.0, alpha, 0.0, 0.0];
    vec![
        ("diffuse", Model::Diffuse, r(0.0)),
        ("mirror", Model::Mirror, r(0.0)),
        ("glass", Model::Dielectric, glass(1.5, 0.0, 0.0)),
        ("pane", Model::ThinDielectric, glass(1.5, 0.0, 0.0)),
        ("gold", Model::Conductor, metal(0.0, 0.0)),
        ("rough gold", Model::RoughConductor, metal(0.3, 0.3)),
        ("rougher gold", Model::RoughConductor, metal(0.8, 0.8)),
        ("smoother gold", Model::RoughConductor, metal(0.05, 0.05)),
        ("brushed gold", Model::RoughConductor, metal(0.5, 0.15)),
        ("rough glass", Model::RoughDielectric, glass(1.5, 0.3, 0.3)),
        ("brushed glass", Model::RoughDielectric, glass(1.33, 0.6, 0.2)),
        ("rough air in glass", Model::RoughDielectric, glass(1.0 / 1.5, 0.4, 0.4)),
        ("Beckmann's gold", Model::RoughConductor, beckmann(metal(0.3, 0.3))),
        ("Beckmann's rougher gold", Model::RoughConductor, beckmann(metal(0.9, 0.9))),
        ("Beckmann's brushed gold", Model::RoughConductor, beckmann(metal(0.5, 0.15))),
        ("Beckmann's glass", Model::RoughDielectric, beckmann(glass(1.5, 0.3, 0.3))),
        ("Beckmann's brushed glass", Model::RoughDielectric, beckmann(glass(1.33, 0.6, 0.2))),
        ("separable gold", Model::RoughConductor, of(SEPARABLE, metal(0.9, 0.9))),
        ("separable brushed gold", Model::RoughConductor, of(SEPARABLE, metal(0.5, 0.15))),
        ("Beckmann's separable gold", Model::RoughConductor, of(BECKMANN + SEPARABLE, metal(0.7, 0.7))),
        ("separable glass", Model::RoughDielectric, of(SEPARABLE, glass(1.5, 0.8, 0.8))),
        ("Beckmann's separable glass", Model::RoughDielectric, of(BECKMANN + SEPARABLE, glass(1.33, 0.6, 0.2))),
        ("phong 60", Model::Phong, r(60.0)),
        ("phong 3", Model::Phong, r(3.0)),
        ("phong 300", Model::Phong, r(300.0)),
        ("phong 1", Model::Phong, r(1.0)),
        ("lecture's phong 60", Model::PhongLecture, r(60.0)),
        ("lecture's phong 3", Model::PhongLecture, r(3.0)),
        ("lecture's phong 300", Model::PhongLecture, r(300.0)),
        ("lecture's phong 1", Model::PhongLecture, r(1.0)),
        ("blinn-phong 60", Model::BlinnPhong, r(60.0)),
        ("blinn-phong 2", Model::BlinnPhong, r(2.0)),
        ("blinn-phong 300", Model::BlinnPhong, r(300.0)),
        ("blinn-phong 10", Model::BlinnPhong, r(10.0)),
        ("lecture's blinn-phong 60", Model::BlinnPhongLecture, r(60.0)),
        ("lecture's blinn-phong 2", Model::BlinnPhongLecture, r(2.0)),
        ("lecture's blinn-phong 300", Model::BlinnPhongLecture, r(300.0)),
        ("lecture's blinn-phong 10", Model::BlinnPhongLecture, r(10.0)),
        ("oren-nayar 0", Model::OrenNayar, r(0.0)),
        ("oren-nayar 0.3", Model::OrenNayar, r(0.3)),
        ("oren-nayar 0.7", Model::OrenNayar, r(0.7)),
        ("oren-nayar 1", Model::OrenNayar, r(1.0)),
        ("ashikhmin-shirley", Model::AshikhminShirley, ashikhmin(0.05, 40.0, 40.0)),
        ("brushed ashikhmin-shirley", Model::AshikhminShirley, ashikhmin(0.3, 10.0, 500.0)),
        ("all gloss ashikhmin-shirley", Model::AshikhminShirley, [1.0, 1.0, 1.0, 1000.0, 30.0, 0.0, 0.0, 0.0, 0.0]),
        ("broad ashikhmin-shirley", Model::AshikhminShirley, ashikhmin(0.8, 2.0, 1.0)),
        ("ashikhmin-shirley without gloss", Model::AshikhminShirley, ashikhmin(0.0, 100.0, 10.0)),
        ("plastic", Model::Plastic, plastic(1.5, 0.0, 0.1)),
        ("rough plastic", Model::Plastic, plastic(1.3, 1.0, 0.5)),
        ("shiny plastic", Model::Plastic, plastic(1.9, 1.0, 0.03)),
        ("dull plastic", Model::Plastic, plastic(1.5, 0.0, 1.0)),
        ("compensated gold", Model::CompensatedConductor, metal(0.3, 0.3)),
        ("rougher compensated gold", Model::CompensatedConductor, metal(0.9, 0.9)),
        ("smoother compensated gold", Model::CompensatedConductor, metal(0.05, 0.05)),
        ("compensated white", Model::CompensatedConductor, [0.0, 0.0, 0.0, 9.0, 9.0, 9.0, 0.6, 0.6, 0.0]),
        // metallic, transmission, η, F0, clearcoat, its α, αx, αy, sheen
        ("principled plastic", Model::Principled, [0.0, 0.0, 1.5, 0.04, 0.0, 0.03, 0.25, 0.25, 0.0]),
        ("principled metal", Model::Principled, [1.0, 0.0, 1.5, 0.04, 0.0, 0.03, 0.1, 0.4, 0.0]),
        ("principled glass", Model::Principled, [0.0, 1.0, 1.45, 0.034, 0.0, 0.03, 0.2, 0.2, 0.0]),
        ("principled lacquer", Model::Principled, [0.3, 0.0, 1.5, 0.08, 1.0, 0.05, 0.5, 0.5, 0.0]),
        ("principled varnish", Model::Principled, [0.3, 0.0, 1.5, 0.04, 1.0, 0.01, 0.25, 0.25, 0.0]),
        ("principled cloth", Model::Principled, [0.0, 0.0, 1.5, 0.04, 0.0, 0.03, 0.9, 0.9, 1.0]),
        ("principled all at once", Model::Principled, [0.3, 0.4, 1.6, 0.06, 0.7, 0.1, 0.15, 0.5, 0.6]),
        // share of glass, η, share that passes, flatness, sheen, tint, αx, αy, tint of the sheen
        ("thin glass", Model::PrincipledThin, [1.0, 1.5, 0.0, 0.0, 0.0, 0.0, 0.2, 0.2, 0.0]),
        ("thin brushed glass", Model::PrincipledThin, [1.0, 1.8, 0.0, 0.0, 0.0, 1.0, 0.6, 0.2, 0.0]),
        ("leaf", Model::PrincipledThin, [0.3, 1.5, 0.6, 0.7, 0.8, 0.2, 0.36, 0.36, 0.5]),
        ("paper", Model::PrincipledThin, [0.0, 1.5, 0.3, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0]),
        ("cloth", Model::PrincipledThin, [0.0, 1.5, 0.0, 0.0, 1.0, 0.0, 0.64, 0.64, 1.0]),
    ]
}

fn bsdf(model: Model, p: [f32; PARAMETERS]) -> Bsdf<'static, f32> {
    let n = vec3(0.3, -0.5, 0.8).normalized();
    let frame = Frame::with_tangent(n, vec3(1.0, 0.2, 0.1));
    Bsdf::new(Index1(model as u32), 1 << model as u32, lobe(p), frame, n, true)
}

/// Directions from nearly upright to grazing, above and below.
fn directions() -> impl Iterator<Item = Vec3<f32>> {
    let angles = [(3.0_f32, 10.0_f32), (40.0, 100.0), (75.0, 250.0), (120.0, 33.0), (160.0, 200.0)];
    angles.into_iter().map(|(theta, phi)| {
        let (t, p) = (theta.to_radians(), phi.to_radians());
        vec3(t.sin() * p.cos(), t.sin() * p.sin(), t.cos())
    })
}

/// An integral over all directions.
pub fn quadrature(f: impl Fn(Vec3<f32>) -> f64) -> f64 {
    use std::f64::consts::{PI, TAU};
    let (rows, columns) = (1000, 400);
    let mut sum = 0.0;
    for i in 0..rows {
        let theta = (f64::from(i) + 0.5) * PI / f64::from(rows);
        for j in 0..columns {
            let phi = (f64::from(j) + 0.5) * TAU / f64::from(columns);
            let w = [theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()];
            sum += f(Vec3::splat(w.map(|x| x as f32))) * theta.sin();
        }
    }
    sum * PI * TAU / f64::from(rows * columns)
}

pub fn material(model: Model, p: [f32; PARAMETERS], color: [f32; 3]) -> Material {
    let mut bsdf = bsdf(model, p);
    bsdf.lobe.color = Rgb::splat(color);
    Material::new(vec![(1.0, bsdf)])
}

/// At least 20 pairs of a direction and parameters for each model; 1 % for all of a model's together.
#[test]
fn samples_follow_their_densities() {
    for model in Model::ALL {
        if model.is_specular() || model.is_measured() {
            continue;
        }
        let effort = Effort { chi2_samples: 100_000, ..Effort::default() };
        // Lambert's has no parameters, only directions.
        let directions = |below| match model {
            Model::Diffuse => (0..20).map(|i| Angles { theta: 4.4 * f64::from(i), phi: 17.0 * f64::from(i) }).collect(),
            _ => sampling_directions(below),
        };
        let of_model = models().into_iter().filter(|(_, m, _)| *m == model);
        samples_agree(of_model.map(|(name, _, p)| {
            let material = material(model, p, [0.9, 0.8, 0.7]);
            (name, material.check_sampling(&effort, &directions(material.transmits())))
        }));
    }
}

/// Holds what was found about a model to 1 % for all of it together.
pub(super) fn samples_agree(found: impl Iterator<Item = (&'static str, check::Sampling)>) {
    let mut tests = Vec::new();
    for (name, found) in found {
        assert_eq!(found.undecided, 0, "{name}");
        assert!(found.disagreement < LARGEST_DISAGREEMENT, "{name}: {}", found.disagreement);
        tests.extend(found.tests.into_iter().map(|t| (name, t)));
    }
    assert!(tests.len() >= 20, "{} pairs", tests.len());
    let level = sidak(tests.len());
    for (name, test) in tests {
        assert!(test.p > level, "{name}: {test:?} against {level}");
    }
}

#[test]
fn weights_are_value_times_cosine_over_density() {
    for (name, model, p) in models() {
        let bsdf = bsdf(model, p);
        if model.is_specular() {
            continue;
        }
        for local in directions() {
            let known = bsdf.frame.to_world(local);
            for (i, u) in random_pairs(300).enumerate() {
                for mode in [TransportMode::Radiance, TransportMode::Importance] {
                    let s = bsdf.sample(known, u, || i as f32 / 300.0, mode, true);
                    if !s.weight.is_lit() {
                        continue;
                    }
                    let v = bsdf.eval(known, s.w, mode, true);
                    let cos = s.w.dot(bsdf.frame.n).abs();
                    // Grazing directions lose digits in the cosine.
                    let tolerance = 1e-3 + 2e-6 / cos;
                    assert!(
                        (v.pdf.0 / s.pdf.0 - 1.0).abs() < tolerance,
                        "{name}: density {} drawn, {} evaluated",
                        s.pdf.0,
                        v.pdf.0
                    );
                    assert!(
                        (v.f.g * cos / v.pdf.0 / s.weight.g - 1.0).abs() < tolerance,
                        "{name}: weight {} against {}",
                        s.weight.g,
                        v.f.g * cos / v.pdf.0
                    );
                }
            }
        }
    }
}

/// Albedo: the mean weight. With `n` samples, and as samples.
fn albedo(model: Model, p: [f32; PARAMETERS], local: Vec3<f32>) -> Vec<f64> {
    let mut bsdf = bsdf(model, p);
    bsdf.lobe.color = Rgb::white();
    let known = bsdf.frame.to_world(local);
    let weights = random_pairs(40_000).map(|u| {
        let s = bsdf.sample(known, u, || (u[1] * 4096.0).fract(), TransportMode::Importance, true);
        f64::from(s.weight.g)
    });
    weights.collect()
}

#[test]
fn every_model_is_what_it_claims() {
    let effort = Effort { albedo_samples: 25_000, chi2_samples: 1000, ..Effort::default() };
    for (name, model, p) in models() {
        // White, so that what is lost or won is the model's own.
        let report = material(model, p, [1.0, 0.9, 0.5]).check(&effort);
        assert!(report.is_positive(), "{name}: {:?}", report.positivity);
        match model {
            Model::PhongLecture | Model::BlinnPhongLecture => {
                assert!(!report.conserves_energy() && !report.holds(), "{name}: {:?}", report.energy.largest);
                assert_eq!(report.is_reciprocal(), model == Model::BlinnPhongLecture, "{name}");
            }
            // What it may give back too much, and what not, is told below.
            Model::PrincipledThin => {
                assert!(report.is_reciprocal(), "{name}: {:?}", report.reciprocity);
                assert_eq!(report.claims, check::Claims { reciprocity: true, energy: false }, "{name}");
            }
            _ => {
                assert!(report.is_reciprocal(), "{name}: {:?}", report.reciprocity);
                assert!(report.conserves_energy(), "{name}: {:?}", report.energy.largest);
                assert_eq!(report.claims, check::Claims { reciprocity: true, energy: true }, "{name}");
            }
        }
    }
}

#[test]
fn the_lectures_slips_show() {
    // Phong with the division by cosθi: light that grazes the surface leaves with (cosθo averaged over the lobe) / cosθi
    // of its power. From above there is no excess.
    let phong = material(Model::PhongLecture, [60.0; PARAMETERS], [1.0; 3]);
    let leaving = |theta| {
        let a = phong.albedo(Angles { theta, phi: 0.0 }, TransportMode::Importance, 100_000, 1);
        (a.mean, a.error)
    };
    let (grazing, error) = leaving(88.0);
    let exact = quadrature(|b| {
        let a = Angles { theta: 88.0, phi: 0.0 }.direction();
        f64::from(phong.eval(a, b, TransportMode::Importance).0[1] * b.z.max(0.0))
    });
    assert!(exact > 1.9 && (grazing - exact).abs() < 5.0 * error + 1e-3, "{grazing} for {exact}");
    assert!(leaving(0.0).0 < 1.0);
    // The lecture's Blinn-Phong reflects much more than it receives: (r+1)/2π · 8π(2^{−r/2}+r)/((r+2)(r+4)) → 4.
    let blinn = albedo(Model::BlinnPhongLecture, [60.0; PARAMETERS], vec3(0.0, 0.0, 1.0));
    let exact = 61.0 * 4.0 * (2.0_f64.powi(-30) + 60.0) / (62.0 * 64.0);
    assert!(t_test_p_value(&blinn, exact) > SIGNIFICANCE);
    // The corrected one has albedo 1 there, and so has corrected Phong.
    for model in [Model::BlinnPhong, Model::Phong] {
        for r in [2.0, 60.0] {
            let a = albedo(model, [r; PARAMETERS], vec3(0.0, 0.0, 1.0));
            assert!(t_test_p_value(&a, 1.0) > SIGNIFICANCE, "{model:?} {r}");
        }
    }
}

#[test]
fn smooth_glass_keeps_power_and_squeezes_radiance() {
    let glass = bsdf(Model::Dielectric, [1.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    for local in directions() {
        let known = glass.frame.to_world(local);
        let (reflected, rest) = (glass.sample(known, [0.5; 2], || 0.0, TransportMode::Importance, true), 0.999_999);
        assert!((glass.frame.to_local(reflected.w) - vec3(-local.x, -local.y, local.z)).length() < 1e-5);
        let power = glass.sample(known, [0.5; 2], || rest, TransportMode::Importance, true);
        let radiance = glass.sample(known, [0.5; 2], || rest, TransportMode::Radiance, true);
        let eta = if local.z > 0.0 { 1.5_f32 } else { 1.0 / 1.5 };
        if power.eta == 1.0 {
            assert!(local.z < 0.0, "only the inside reflects totally");
            continue;
        }
        assert_eq!(power.eta, eta);
        assert!((radiance.weight.r * eta * eta - power.weight.r).abs() < 1e-6);
        // Snell: the tangential part shrinks by η, the side changes.
        let out = glass.frame.to_local(power.w);
        assert!((out.x * eta + local.x).abs() < 1e-5 && out.z * local.z < 0.0);
        assert!((reflected.pdf.0 + power.pdf.0 - 1.0).abs() < 1e-6);
    }
}

#[test]
fn rough_surfaces_tend_to_smooth_ones() {
    // At α = 0.002 the albedo of rough glass and gold is Fresnel's to a fraction of a percent.
    let up = vec3(0.6, 0.0, 0.8);
    let gold = albedo(Model::RoughConductor, [0.143, 0.375, 1.442, 3.983, 2.386, 1.603, 0.002, 0.002, 0.0], up);
    let exact = fresnel::conductor(0.8_f32, Rgb::splat([0.143, 0.375, 1.442]), Rgb::splat([3.983, 2.386, 1.603])).g;
    let mean = gold.iter().sum::<f64>() / gold.len() as f64;
    assert!((mean - f64::from(exact)).abs() < 1e-3, "{mean} against {exact}");
    // Power is what neither side of glass loses: all of it leaves, and Fresnel's part is reflected.
    let glass = material(Model::RoughDielectric, [1.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.002, 0.002, 0.0], [1.0; 3]);
    let mut reflected = Moments::default();
    let mut total = Moments::default();
    for u in check::numbers(3, 60_000) {
        let s = glass.sample(up, u.value(4), u.pair(1), u.value(3), TransportMode::Importance);
        let weight = f64::from(s.weight.g);
        total.add(weight);
        reflected.add(if s.w.z > 0.0 { weight } else { 0.0 });
    }
    let exact = f64::from(fresnel::dielectric(0.8_f32, 1.5).0);
    assert!((total.mean() - 1.0).abs() < 1e-3, "{total:?}");
    assert!((reflected.mean() - exact).abs() < 1e-3 + 5.0 * reflected.standard_error(), "{reflected:?} for {exact}");
}

#[test]
fn shading_normals_are_corrected_in_one_mode_only() {
    let ng = vec3(0.0, 0.0, 1.0);
    let frame = Frame::around(vec3(0.3_f32, 0.0, 1.0).normalized());
    let b = Bsdf::new(Index1(0), 1, lobe([0.0; PARAMETERS]), frame, ng, true);
    let (x, y) = (vec3(0.5, 0.5, 0.7).normalized(), vec3(-0.2, 0.1, 0.9).normalized());
    let radiance = |a, b_| b.eval(a, b_, TransportMode::Radiance, true).f.r;
    let importance = |a, b_| b.eval(a, b_, TransportMode::Importance, true).f.r;
    // Veach: f*(a, b) |b·ns|/|b·ng| = f(b, a) |a·ns|/|a·ng|.
    let side = |w: Vec3<f32>| w.dot(frame.n) / w.dot(ng);
    assert!((importance(x, y) * side(y) - radiance(y, x) * side(x)).abs() < 1e-6);
    // A direction between the two surfaces sees nothing.
    let between = vec3(0.9, 0.0, -0.15).normalized();
    assert!(between.dot(frame.n) > 0.0 && radiance(x, between) == 0.0 && radiance(between, x) == 0.0);
}

/// A wide BSDF of mixed models gives each lane what a narrow one gives.
#[test]
fn lanes_agree_with_single_points() {
    let all = models();
    for first in (0..all.len()).step_by(16) {
        let lanes: Vec<_> = (0..16).map(|i| all[(first + i) % all.len()]).collect();
        lanes_agree(&lanes);
    }
}

fn lanes_agree(lanes: &[(&str, Model, [f32; PARAMETERS])]) {
    let gather = |f: &dyn Fn(usize) -> f32| (0..16).fold(F32x16::splat(0.0), |v, i| v.with_lane(i, f(i)));
    let narrow: Vec<Bsdf<f32>> = lanes.iter().map(|(_, m, p)| bsdf(*m, *p)).collect();
    let model = (0..16).fold(<F32x16 as Real>::Index::splat(0), |v, i| v.with_lane(i, lanes[i].1 as u32));
    let p = std::array::from_fn(|k| gather(&|i| lanes[i].2[k]));
    let wide_vector = |v: Vec3<f32>| Vec3::<F32x16>::splat([v.x, v.y, v.z]);
    let f = narrow[0].frame;
    let frame = Frame { s: wide_vector(f.s), t: wide_vector(f.t), n: wide_vector(f.n) };
    let mask = <F32x16 as Real>::Mask::splat(true);
    let color = Rgb::splat([0.9, 0.8, 0.7]);
    let wide = Bsdf::new(model, (1 << Model::ALL.len()) - 1, Lobe { color, p }, frame, frame.n, mask);
    for local in directions() {
        let known = f.to_world(local);
        for u in random_pairs(50) {
            let mode = TransportMode::Radiance;
            let s = wide.sample(wide_vector(known), u.map(F32x16::splat), || F32x16::splat(u[0]), mode, mask);
            let other = f.to_world(crate::sampling::warp::uniform_sphere(u));
            let v = wide.eval(wide_vector(known), wide_vector(other), mode, mask);
            for lane in 0..16 {
                let one = narrow[lane].sample(known, u, || u[0], mode, true);
                assert_eq!(s.weight.lane(lane), one.weight.lane(0), "{}", lanes[lane].0);
                if one.weight.is_lit() {
                    assert_eq!((s.w.lane(lane), s.pdf.0.lane(lane)), (one.w.lane(0), one.pdf.0), "{}", lanes[lane].0);
                }
                let value = narrow[lane].eval(known, other, mode, true);
                assert_eq!((v.f.lane(lane), v.pdf.0.lane(lane)), (value.f.lane(0), value.pdf.0), "{}", lanes[lane].0);
            }
        }
    }
}

/// Surfaces that give back all they receive, at every angle and roughness, within the error of the tables they stand on;
/// and ones whose loss is known.
#[test]
fn white_furnace() {
    let error = 0.002;
    let thetas = [0.0, 30.0, 60.0, 80.0, 87.0, 89.0, 89.9];
    let albedo = |material: &Material, theta: f64| {
        material.albedo(Angles { theta, phi: 20.0 }, TransportMode::Radiance, 60_000, 9)
    };
    for alpha in [SMOOTH, 0.002, 0.01, 0.05, 0.2, 0.5, 1.0] {
        // k → ∞ reflects all: (η − 1)² + k² over (η + 1)² + k² at η = 0 is 1.
        let white = [0.0, 0.0, 0.0, 9.0, 9.0, 9.0, alpha, alpha, 0.0];
        let compensated = material(Model::CompensatedConductor, white, [1.0; 3]);
        let plain = material(Model::RoughConductor, white, [1.0; 3]);
        let varnish = [1.5, 1.0, 0.0, 0.0, 0.0, 0.0, alpha, 0.0, 0.0];
        let plastic = material(Model::Plastic, varnish, [1.0; 3]);
        let principled = material(Model::Principled, [0.0, 0.0, 1.5, 0.04, 0.0, 0.1, alpha, alpha, 0.0], [1.0; 3]);
        for theta in thetas {
            for (name, material) in [("metal", &compensated), ("plastic", &plastic), ("principled", &principled)] {
                let a = albedo(material, theta);
                assert!((a.mean - 1.0).abs() < error + 5.0 * a.error, "{name} α {alpha}: {a:?}");
            }
            // Without compensation the loss is that of the table.
            let a = albedo(&plain, theta);
            let e = 1.0 - f64::from(albedo::Reflected::at(theta.to_radians().cos() as f32, alpha).lost);
            assert!((a.mean - e).abs() < error + 5.0 * a.error, "α {alpha}: {a:?}, stated {e}");
        }
    }
    // Rough glass loses what leaves a facet for another on either side.
    for (eta, alpha) in [(1.5, 0.3), (1.5, 1.0), (1.0 / 1.5, 0.5), (2.4, 0.6)] {
        let glass = material(Model::RoughDielectric, [eta, 0.0, 0.0, 0.0, 0.0, 0.0, alpha, alpha, 0.0], [1.0; 3]);
        for theta in [0.0, 60.0, 80.0, 110.0, 150.0] {
            let known = Angles { theta, phi: 20.0 }.direction();
            let f = |b: Vec3<f32>| glass.eval(known, b, TransportMode::Importance).0[1];
            let exact = quadrature(|b| f64::from(f(b) * b.z.abs()));
            let a = glass.albedo(Angles { theta, phi: 20.0 }, TransportMode::Importance, 60_000, 9);
            assert!((a.mean - exact).abs() < 1e-3 + 5.0 * a.error, "η {eta}, α {alpha}: {a:?} for {exact}");
        }
    }
    // From straight above, facets of α = 1 reflect 1 − ln 2: their normals are of cosine law, so that cosθo is uniform
    // where it is positive, which is half of them, and G₂ is 2 cosθo / (1 + cosθo).
    let roughest = 1.0 - f64::from(albedo::Reflected::at(1.0_f32, 1.0).lost);
    assert!((roughest - (1.0 - 2.0_f64.ln())).abs() < 1e-3, "{roughest}");
    // Coloured plastic, from the average: (1 − Ē) ρ' is what its base sends out of what gets in.
    let rho = 0.5_f32;
    let coat = albedo::Reflected::average(0.3_f32).with(0.04);
    let e = albedo::Reflected::at(0.7_f32, 0.3).with(0.04);
    let internal = 1.0 - (1.0 - coat) / 2.25;
    for (nonlinear, share) in [(0.0, rho), (1.0, rho * (1.0 - internal) / (1.0 - rho * internal))] {
        let plastic = material(Model::Plastic, [1.5, nonlinear, 0.0, 0.0, 0.0, 0.0, 0.3, 0.0, 0.0], [rho; 3]);
        let at = Angles { theta: f64::from(0.7_f32).acos().to_degrees(), phi: 0.0 };
        let a = plastic.albedo(at, TransportMode::Radiance, 400_000, 3);
        let exact = f64::from(e + (1.0 - e) * share);
        assert!((a.mean - exact).abs() < error + 5.0 * a.error, "{a:?} for {exact}");
    }
}

/// A white base under an anisotropic coat loses a little at most, and wins nothing.
#[test]
fn anisotropic_coats_are_no_lights() {
    let mut range = [f64::INFINITY, 0.0_f64];
    for (ax, ay) in [(1.0, 0.155), (0.3, 0.03), (0.05, 0.5), (0.003, 0.03), (1.0, 0.6), (0.1, 1.0)] {
        for f0 in [0.04, 0.3] {
            let principled = material(Model::Principled, [0.0, 0.0, 1.5, f0, 0.0, 0.1, ax, ay, 0.0], [1.0; 3]);
            for theta in [0.0, 30.0, 60.0, 75.0, 85.0, 88.0, 89.0, 89.9] {
                for phi in [0.0, 20.0, 45.0, 70.0, 90.0] {
                    let a = principled.albedo(Angles { theta, phi }, TransportMode::Radiance, 30_000, 9);
                    range = [range[0].min(a.mean + 4.0 * a.error), range[1].max(a.mean - 4.0 * a.error)];
                }
            }
        }
    }
    assert!(range[1] <= 1.0005 && range[0] > 0.95, "{range:?}");
}

#[test]
fn principled_has_its_limits() {
    let known = Angles { theta: 40.0, phi: 30.0 }.direction();
    let others = [(10.0, 0.0), (40.0, 210.0), (60.0, 150.0), (85.0, 200.0)].map(|(theta, phi)| Angles { theta, phi });
    let base = [0.8, 0.6, 0.3];
    let eval = |m: &Material, b: Angles| m.eval(known, b.direction(), TransportMode::Radiance).0;
    let principled = |p| material(Model::Principled, p, base);
    // Neither metallic nor clear: the plastic of the same coat.
    let (one, other) = (
        principled([0.0, 0.0, 1.5, 0.04, 0.0, 0.1, 0.3, 0.3, 0.0]),
        material(Model::Plastic, [1.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.3, 0.0, 0.0], base),
    );
    // All clear and white: rough glass.
    let glass = [1.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.3, 0.3, 0.0];
    let (clear, rough) = (
        material(Model::Principled, [0.0, 1.0, 1.5, 0.04, 0.0, 0.1, 0.3, 0.3, 0.0], [1.0; 3]),
        material(Model::RoughDielectric, glass, [1.0; 3]),
    );
    for b in others {
        let below = Angles { theta: 180.0 - b.theta, ..b };
        for (x, y) in [
            (eval(&one, b), eval(&other, b)),
            (eval(&clear, b), eval(&rough, b)),
            (eval(&clear, below), eval(&rough, below)),
        ] {
            for channel in 0..3 {
                assert!((x[channel] - y[channel]).abs() <= 1e-5 * y[channel].max(1e-3), "{b:?}: {x:?} for {y:?}");
            }
        }
    }
}

/// Near the horizon what passes a sheet is proportional to a small cosine, which light is to find the same both ways.
#[test]
fn smooth_sheets_are_reciprocal() {
    let effort = Effort { albedo_samples: 10, chi2_samples: 10, ..Effort::default() };
    for share in [0.5, 1.0] {
        for (ax, ay) in [(SMOOTH, SMOOTH), (0.01, 0.01), (0.2, SMOOTH)] {
            let sheet = material(Model::PrincipledThin, [share, 1.5, 0.5, 0.0, 0.0, 0.5, ax, ay, 0.0], [1.0, 0.9, 0.5]);
            for seed in 1..=8 {
                let report = sheet.check(&Effort { seed, ..effort });
                assert!(report.is_reciprocal(), "{share}, {ax}, {ay}: {:?}", report.reciprocity);
            }
        }
    }
}

/// What sheets reflect and pass where it is known.
#[test]
fn thin_sheets_have_their_limits() {
    let sheet = |p, color| material(Model::PrincipledThin, p, color);
    let thetas: [f64; 7] = [0.0, 30.0, 60.0, 80.0, 88.0, 120.0, 150.0];
    let schlick = |theta: f64| (1.0 - theta.to_radians().cos().abs()).powi(5);
    let albedo = |m: &Material, theta: f64| m.albedo(Angles { theta, phi: 20.0 }, TransportMode::Radiance, 60_000, 9);
    // Smooth and diffuse: (1 − f(θ)/2)(1 − f(θ')/2) c/π; the mean of (1 − cosθ)⁵ by the cosine is 1/21.
    let smooth = sheet([0.0, 1.5, 0.0, 0.0, 0.0, 0.0, SMOOTH, SMOOTH, 0.0], [0.8; 3]);
    // All passes: Lambert's, on the other side.
    let passes = sheet([0.0, 1.5, 1.0, 0.5, 1.0, 1.0, 0.3, 0.3, 0.0], [1.0; 3]);
    // Glass that is nearly smooth: Fresnel's part is reflected, the rest passes straight on.
    let glass = sheet([1.0, 1.5, 0.0, 0.0, 0.0, 0.0, SMOOTH, SMOOTH, 0.0], [0.5; 3]);
    for theta in thetas {
        let cos = theta.to_radians().cos().abs();
        let a = albedo(&smooth, theta);
        let exact = 0.8 * (1.0 - schlick(theta) / 2.0) * (1.0 - 1.0 / 42.0);
        assert!((a.mean - exact).abs() < 5.0 * a.error + 1e-4, "smooth: {a:?} for {exact}");
        let a = albedo(&passes, theta);
        assert!((a.mean - 1.0).abs() < 5.0 * a.error + 1e-4, "all passes: {a:?}");
        let f = f64::from(fresnel::dielectric(cos as f32, 1.5).0);
        let a = albedo(&glass, theta);
        assert!((a.mean - (f + 0.5 * (1.0 - f))).abs() < 5.0 * a.error + 3e-3, "glass: {a:?}, {f} reflected");
    }
    // Rough glass, untinted: no more than it gets.
    for alpha in [0.05, 0.3, 1.0] {
        let glass = sheet([1.0, 1.5, 0.0, 0.0, 0.0, 0.0, alpha, alpha, 0.0], [1.0; 3]);
        for theta in [0.0, 30.0, 60.0, 80.0, 88.0, 89.5] {
            let a = albedo(&glass, theta);
            assert!(a.mean < 1.0 + 5.0 * a.error, "rough glass {alpha}: {a:?}");
        }
    }
    // The roughest sheet, from straight above: 1 + (½ + cosθ')(1 − cosθ')⁵ over π, a polynomial whose integral is 29/28.
    let rough = sheet([0.0, 1.5, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 0.0], [1.0; 3]);
    let a = albedo(&rough, 0.0);
    assert!((a.mean - 29.0 / 28.0).abs() < 5.0 * a.error + 1e-4, "{a:?}");
}

/// Red and blue of Mitsuba 3.9.1's `principledthin`, over the cosine.
#[test]
fn thin_sheets_are_those_of_mitsuba() {
    let pairs = [
        ((40.0, 30.0), (55.0, 200.0)),
        ((70.0, 100.0), (20.0, 310.0)),
        ((25.0, 250.0), (150.0, 80.0)),
        ((130.0, 10.0), (120.0, 170.0)),
        ((62.0, 0.0), (100.0, 175.0)),
    ];
    // α of a roughness, and of an anisotropy.
    let alpha = |r: f32, anisotropic: f32| {
        let aspect = (1.0 - 0.9 * anisotropic).sqrt();
        [r * r / aspect, r * r * aspect]
    };
    let [ax, ay] = alpha(0.15, 0.5);
    let [bx, by] = alpha(0.4, 0.8);
    let sheets = [
        (
            [0.8, 1.33, 0.15, 0.0, 0.0, 0.1, ax, ay, 0.0],
            [0.7, 0.1, 0.1],
            [
                [0.04753257, 0.01367759],
                [0.03629443, 0.005198856],
                [0.06432283, 0.009188977],
                [0.03769089, 0.00565393],
                [0.01548521, 0.002212172],
            ],
        ),
        (
            [0.4, 1.5, 0.6, 0.7, 0.8, 0.0, 0.36, 0.36, 0.5],
            [0.2, 0.5, 0.8],
            [
                [0.03493622, 0.07896299],
                [0.02024602, 0.06475813],
                [0.2975914, 1.190366],
                [0.03938409, 0.08919451],
                [0.3417004, 1.366802],
            ],
        ),
        (
            [0.0, 1.5, 0.3, 0.3, 0.3, 0.0, 1.0, 1.0, 0.0],
            [0.9, 0.8, 0.3],
            [
                [0.1979579, 0.06646652],
                [0.2075525, 0.06941592],
                [0.08594367, 0.02864789],
                [0.2089426, 0.0712546],
                [0.08594367, 0.02864789],
            ],
        ),
        (
            [1.0, 1.8, 0.0, 0.0, 0.0, 1.0, bx, by, 0.0],
            [0.9, 0.8, 0.3],
            [
                [0.3447518, 0.1230771],
                [0.0009865637, 0.0003403067],
                [1.98087, 0.66029],
                [0.01123951, 0.004573745],
                [0.9785262, 0.3261755],
            ],
        ),
    ];
    for (p, color, values) in sheets {
        let sheet = material(Model::PrincipledThin, p, color);
        for ((a, b), [red, blue]) in pairs.into_iter().zip(values) {
            let direction = |(theta, phi): (f64, f64)| Angles { theta, phi }.direction();
            let (f, _) = sheet.eval(direction(a), direction(b), TransportMode::Radiance);
            for (found, theirs) in [(f[0], red), (f[2], blue)] {
                // Both know luminance to three digits.
                assert!((found / theirs - 1.0_f32).abs() < 1e-3, "{p:?} {a:?} {b:?}: {found} for {theirs}");
            }
        }
    }
}
