//! Times evaluating a BSDF with its density, and sampling it: nanoseconds per number, one at a time and in sixteen lanes.
//!
//! `bsdf_cost [NAME..]`: only models whose name begins so.
//!
//! Directions are above the surface and of cosine law. Each figure is the least over the rounds, in which the models take
//! turns; it includes reading the directions and adding up what comes out.
#![allow(clippy::print_stdout, missing_docs)]

use rebond::bsdf::measured::{AdaptiveTable, AngleTable, Grid2, HalfDifferenceTable, Measured, Tables};
use rebond::bsdf::{Bsdf, Lobe, Model, PARAMETERS, TransportMode};
use rebond::math::{Frame, Rgb, Vec3, vec3};
use rebond::sampling::{Sampler, SamplerSettings, warp};
use rebond_lanes::{F32x16, Index, Mask, Real, scalar::Index1};
use std::hint::black_box;
use std::time::Instant;

const ROUNDS: usize = 25;
/// Calls in a row: what they read stays in the first cache.
const CALLS: usize = 256;
const REPEATS: usize = 16;

/// A name, a model and its parameters, each as the model says which it reads.
type Row = (&'static str, Model, [f32; PARAMETERS]);

fn models() -> Vec<Row> {
    let p = |first: &[f32], alpha: f32| {
        let mut p = [0.0; PARAMETERS];
        p[..first.len()].copy_from_slice(first);
        [p[6], p[7]] = [alpha; 2];
        p
    };
    let gold = [0.143, 0.375, 1.442, 3.983, 2.386, 1.603];
    // Metallic, transmission, η, F0, clearcoat, its α, αx, αy, sheen.
    let layers = [0.3, 0.4, 1.5, 0.04, 1.0, 0.03, 0.15, 0.4, 0.5];
    vec![
        ("diffuse", Model::Diffuse, p(&[], 0.0)),
        ("oren-nayar", Model::OrenNayar, p(&[0.5], 0.0)),
        ("mirror", Model::Mirror, p(&[], 0.0)),
        ("conductor", Model::Conductor, p(&gold, 0.0)),
        ("dielectric", Model::Dielectric, p(&[1.5], 0.0)),
        ("thin-dielectric", Model::ThinDielectric, p(&[1.5], 0.0)),
        ("phong", Model::Phong, p(&[60.0], 0.0)),
        ("phong, lecture", Model::PhongLecture, p(&[60.0], 0.0)),
        ("blinn-phong", Model::BlinnPhong, p(&[60.0], 0.0)),
        ("blinn-phong, lecture", Model::BlinnPhongLecture, p(&[60.0], 0.0)),
        ("ashikhmin-shirley", Model::AshikhminShirley, p(&[0.3, 0.3, 0.3, 10.0, 500.0], 0.0)),
        ("conductor, rough", Model::RoughConductor, p(&gold, 0.3)),
        ("conductor, compensated", Model::CompensatedConductor, p(&gold, 0.3)),
        ("dielectric, rough", Model::RoughDielectric, p(&[1.5], 0.3)),
        ("plastic", Model::Plastic, p(&[1.5], 0.3)),
        ("principled, plastic", Model::Principled, p(&[0.0, 0.0, 1.5, 0.04, 0.0, 0.03], 0.3)),
        ("principled, all layers", Model::Principled, layers),
        ("principled, thin", Model::PrincipledThin, p(&[0.3, 1.5, 0.3, 0.5, 0.5], 0.15)),
    ]
}

/// Tables of the sizes that measured materials have, and their models: the lecture's, MERL's and RGL's (isotropic). What
/// they hold is smooth and makes no difference.
fn measured() -> (Tables, Vec<Row>) {
    let values = |n: u32| (0..n).map(|i| [0.1 + 0.05 * (i as f32 * 0.01).sin(); 3]).collect::<Vec<_>>();
    let grid = |x: u32, y: u32, n: u32| Grid2 { size: [x, y], values: vec![1.0; (x * y * n) as usize] };
    let theta: Vec<f32> = (0..8).map(|i| 0.2 * i as f32).collect();
    let color = Grid2 { size: [32, 32], values: values(8 * 32 * 32) };
    let rgl =
        AdaptiveTable::new(theta, vec![0.0], grid(128, 128, 1), grid(128, 128, 1), grid(128, 128, 8), color, true);
    let sizes = [[90, 1, 90, 180], [24, 48, 24, 48]];
    let [isotropic, anisotropic] = sizes.map(|s| AngleTable::new(s, values(s.iter().product())).expect("a table"));
    let merl = HalfDifferenceTable::new([90, 90, 180], values(90 * 90 * 180)).expect("a table");
    let all = [
        ("measured, table", Measured::Angles(isotropic)),
        ("measured, anisotropic", Measured::Angles(anisotropic)),
        ("measured, MERL", Measured::HalfDifference(merl)),
        ("measured, RGL", Measured::Adaptive(rgl.expect("a table"))),
    ];
    let mut tables = Tables::default();
    let rows = all.map(|(name, table)| {
        let mut p = [0.0; PARAMETERS];
        p[0] = f32::from_bits(tables.add(&table).expect("room"));
        (name, table.model(), p)
    });
    (tables, rows.to_vec())
}

/// Directions above the surface, and numbers to sample with.
struct Inputs<F: Real> {
    known: Vec<Vec3<F>>,
    other: Vec<Vec3<F>>,
    u: Vec<[F; 3]>,
}

impl<F: Real> Inputs<F> {
    fn new() -> Self {
        let sampler = Sampler::new(SamplerSettings::Independent {}, 1);
        let number = |i: usize, k: u32| {
            (0..F::LANES).fold(F::zero(), |v, lane| {
                let stream = sampler.stream::<f32>(Index1((i * F::LANES + lane) as u32), Index1(0));
                v.with_lane(lane, stream.value(Index1(k)))
            })
        };
        let directions =
            |k: u32| (0..CALLS).map(|i| warp::cosine_hemisphere([number(i, k), number(i, k + 1)])).collect();
        let u = (0..CALLS).map(|i| [4, 5, 6].map(|k| number(i, k))).collect();
        Self { known: directions(0), other: directions(2), u }
    }
}

fn bsdf<F: Real>(model: Model, p: [f32; PARAMETERS], tables: &Tables) -> Bsdf<'_, F> {
    let (zero, one) = (F::zero(), F::one());
    let frame = Frame { s: vec3(one, zero, zero), t: vec3(zero, one, zero), n: vec3(zero, zero, one) };
    let lobe = Lobe { color: Rgb::splat([0.8, 0.7, 0.6]), p: p.map(F::splat) };
    let number = model as u32;
    Bsdf::new(F::Index::splat(number), 1 << number, lobe, frame, frame.n, F::Mask::splat(true)).with_tables(tables)
}

/// Nanoseconds per number of evaluating and of sampling.
fn time<F: Real>(bsdf: &Bsdf<F>, inputs: &Inputs<F>) -> [f64; 2] {
    let mask = F::Mask::splat(true);
    let per_number = |calls: &dyn Fn(&mut F)| {
        let (start, mut sum) = (Instant::now(), F::zero());
        (0..REPEATS).for_each(|_| calls(&mut sum));
        black_box(sum);
        start.elapsed().as_secs_f64() * 1e9 / (REPEATS * CALLS * F::LANES) as f64
    };
    let eval = per_number(&|sum| {
        for (known, other) in inputs.known.iter().zip(&inputs.other) {
            let v = black_box(bsdf).eval(*known, *other, TransportMode::Radiance, mask);
            *sum += v.f.r + v.f.g + v.f.b + v.pdf.0;
        }
    });
    let sample = per_number(&|sum| {
        for (known, u) in inputs.known.iter().zip(&inputs.u) {
            let s = black_box(bsdf).sample(*known, [u[0], u[1]], || u[2], TransportMode::Radiance, mask);
            *sum += s.w.x + s.w.z + s.weight.r + s.weight.g + s.weight.b + s.pdf.0;
        }
    });
    [eval, sample]
}

fn main() {
    let wanted: Vec<String> = std::env::args().skip(1).collect();
    let (one, sixteen) = (Inputs::<f32>::new(), Inputs::<F32x16>::new());
    let (tables, measured) = measured();
    let mut models = models();
    models.extend(measured);
    models.retain(|(name, ..)| wanted.is_empty() || wanted.iter().any(|w| name.starts_with(w.as_str())));
    let mut least = vec![[f64::INFINITY; 4]; models.len()];
    for _ in 0..ROUNDS {
        for ((_, model, p), least) in models.iter().zip(&mut least) {
            let [a, b] = time(&bsdf::<f32>(*model, *p, &tables), &one);
            let [c, d] = time(&bsdf::<F32x16>(*model, *p, &tables), &sixteen);
            for (least, t) in least.iter_mut().zip([a, b, c, d]) {
                *least = least.min(t);
            }
        }
    }
    println!("{:<24} {:>10} {:>10} {:>12} {:>12}", "ns per number", "eval, 1", "sample, 1", "eval, 16", "sample, 16");
    for ((name, model, _), [a, b, c, d]) in models.iter().zip(least) {
        // Specular models have no value.
        let eval = |t: f64| if model.is_specular() { "–".to_string() } else { format!("{t:.2}") };
        println!("{name:<24} {:>10} {b:>10.2} {:>12} {d:>12.2}", eval(a), eval(c));
    }
}
