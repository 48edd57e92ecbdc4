//! Radiosity against closed forms, against path tracing, and its solvers against each other.

mod common;

use common::*;
use rebond::film::Film;
use rebond::integrators::radiosity::form_factors::{FormFactors, Kind, Symmetric};
use rebond::integrators::radiosity::patches::Patches;
use rebond::integrators::radiosity::{Report, Solution, Solver, Unsolvable, sampler, solve};
use rebond::integrators::{IntegratorSettings, RadiositySettings};
use rebond::render::{Budget, Engine, Observer, Region, render};
use rebond::sampling::{Sampler, SamplerSettings};
use rebond::scene::Scene;
use rebond::transport::form_factor::{parallel_rectangles, perpendicular_rectangles};
use rebond_io::{SceneSource, read_solution, write_glb, write_solution};
use std::collections::HashSet;
use std::num::NonZeroU32;
use std::sync::Arc;

fn with(patches: u32, solver: Solver) -> RadiositySettings {
    let patches = NonZeroU32::new(patches).expect("not 0");
    RadiositySettings { patches, solver, rays: 16, ..RadiositySettings::default() }
}

fn solved(scene: &Scene, settings: &RadiositySettings) -> (Solution, Report) {
    solve(scene, settings, &sampler(1), &()).expect("a diffuse scene")
}

/// Mesh and form factors of a scene.
fn matrix(scene: &Scene, patches: usize, rays: u32, seed: u32) -> (Patches, Vec<f64>, Symmetric) {
    let mesh = Patches::new(scene, &scene.faces(), patches);
    let factors = FormFactors::new(scene, &mesh, &mesh.leaves, vec![Kind::Patch; mesh.len()], rays, seed);
    let (matrix, _) = Symmetric::form_factors(&factors, &()).expect("not stopped");
    (mesh, factors.areas.clone(), matrix)
}

/// F from all of one shape to all of another.
fn between(mesh: &Patches, areas: &[f64], matrix: &Symmetric, from: u32, to: u32) -> f64 {
    let shape: Vec<u32> = mesh.leaves.iter().map(|e| mesh.faces[mesh.elements[*e as usize].face as usize][3]).collect();
    let area: f64 = (0..mesh.len()).filter(|i| shape[*i] == from).map(|i| areas[i]).sum();
    let mut sum = 0.0;
    for i in 0..mesh.len() {
        for (j, x) in matrix.row(i).iter().enumerate() {
            if (shape[i], shape[j]) == (from, to) || (shape[j], shape[i]) == (from, to) {
                sum += f64::from(*x);
            }
        }
    }
    sum / area
}

/// A unit square, turned and moved.
fn square(turn: &str, to: &str) -> String {
    format!("[[shapes]]\ntype = \"rectangle\"\nto_world = [{{ scale = 0.5 }}, {turn} {{ translate = {to} }}]\n")
}

const DOWN: &str = "{ rotate = { axis = [1, 0, 0], angle = 180 } },";

#[test]
fn squares_are_their_closed_forms() {
    let parallel = parse(&(square("", "[0, 0, 0]") + &square(DOWN, "[0, 0, 1]"))).build().expect("a scene");
    let wall = "{ rotate = { axis = [1, 0, 0], angle = 90 } },";
    let corner = parse(&(square("", "[0, 0, 0]") + &square(wall, "[0, 0.5, 0.5]"))).build().expect("a scene");
    for (what, scene, known) in [
        ("parallel", &parallel, parallel_rectangles(1.0, 1.0)),
        ("perpendicular", &corner, perpendicular_rectangles(1.0, 1.0)),
    ] {
        for patches in [4, 64, 700] {
            // Nothing is in the way, so that rays make no difference.
            for rays in [1, 16] {
                let (mesh, areas, matrix) = matrix(scene, patches, rays, 3);
                let found = between(&mesh, &areas, &matrix, 0, 1);
                assert!((found - known).abs() < 2e-5, "{what}, {patches} patches, {rays} rays: {found}, {known}");
            }
        }
    }
}

/// A cube seen from within.
fn cube(emission: f64, reflectance: f64) -> SceneSource {
    parse(&format!(
        "film = {{ width = 16, height = 16 }}\n[camera]\ntype = \"perspective\"\nfov = 90\n[[shapes]]\ntype = \"cube\"\nflip_normals = true\nemission = {emission}\nmaterial = {{ type = \"diffuse\", reflectance = {reflectance} }}\n"
    ))
}

#[test]
fn a_closed_room_sends_everything_to_itself() {
    let scene = cube(1.0, 0.5).build().expect("a scene");
    for patches in [12, 200, 1000] {
        let mesh = Patches::new(&scene, &scene.faces(), patches);
        let factors = FormFactors::new(&scene, &mesh, &mesh.leaves, vec![Kind::Patch; mesh.len()], 4, 1);
        let (matrix, closure) = Symmetric::form_factors(&factors, &()).expect("not stopped");
        assert!(closure.least > 1.0 - 3e-4 && closure.most < 1.0 + 3e-4, "{patches}: {closure:?}");
        // None sends on more than it has.
        for (i, sum) in matrix.row_sums().iter().enumerate() {
            let sum = sum / factors.areas[i] * f64::from(closure.scale[i]);
            assert!(sum <= 1.0, "{patches}: row {i} sums to {sum}");
        }
    }
}

/// What is in the way takes nothing out of a closed room: it receives as much itself. So rows sum to 1 but for the error of
/// visibility, which falls with the number of rays; with 64 the sixteen points of a patch have been used four times over.
#[test]
fn rows_of_a_closed_room_with_a_block_sum_to_one_as_rays_tell() {
    let block = "[[shapes]]\ntype = \"cube\"\nto_world = [{ scale = [0.3, 0.4, 0.5] }, { rotate = { axis = [0, 1, 0], angle = 30 } }, { translate = [0.2, -0.3, 0.1] }]\n";
    let room = "[[shapes]]\ntype = \"cube\"\nflip_normals = true\nemission = 1\n";
    let scene = parse(&(room.to_owned() + block)).build().expect("a scene");
    let mesh = Patches::new(&scene, &scene.faces(), 400);
    let rms = [1, 4, 16, 64].map(|rays| {
        let factors = FormFactors::new(&scene, &mesh, &mesh.leaves, vec![Kind::Patch; mesh.len()], rays, 5);
        let n = mesh.len();
        let mut squares = 0.0;
        let mut row = vec![0.0; n];
        for i in 0..n {
            factors.row(i, 0..n, &mut row);
            let sum: f64 = row.iter().map(|x| f64::from(*x)).sum::<f64>() / factors.areas[i];
            squares += (sum - 1.0).powi(2);
        }
        (squares / n as f64).sqrt()
    });
    assert!(rms[1] < rms[0] / 1.5 && rms[2] < rms[1] && rms[3] <= rms[2], "{rms:?}");
    assert!(rms[2] < 5e-3, "{rms:?}");
}

#[test]
fn the_furnace_is_one_over_one_minus_albedo() {
    for reflectance in [0.2, 0.8] {
        let scene = cube(1.5, reflectance).build().expect("a scene");
        for solver in Solver::ALL {
            let (solution, report) = solved(&scene, &with(150, solver));
            let known = 1.5 / (1.0 - reflectance);
            // What is missing of a row's sum is missing at every bounce.
            let lost = report.closure.as_ref().map_or(3e-4, |c| (1.0 - c.least).abs().max((c.most - 1.0).abs()));
            let bound = (lost * reflectance / (1.0 - reflectance) + 2e-5) * known;
            assert!(lost < 5e-4, "{}: {report:?}", solver.name());
            for l in &solution.radiance {
                assert!((f64::from(l[1]) - known).abs() <= bound, "{}, ρ = {reflectance}: {l:?}", solver.name());
            }
        }
    }
}

/// In a closed room that absorbs nothing light grows with every round, by all that the lamps send.
#[test]
fn what_does_not_converge_says_so() {
    let white = cube(1.0, 1.0).build().expect("a scene");
    for solver in Solver::ALL {
        let (_, report) = solved(&white, &with(12, solver));
        let residual = report.residual.expect("no solution");
        // Whatever it is that an inverse finds, it is no solution.
        let known = if solver == Solver::Inverse { residual.max(1e-2) } else { 1.0 };
        assert!((residual - known).abs() < 0.02, "{}: {residual}", solver.name());
        let warning = report.warning().expect("a warning");
        assert!(warning.contains("has not converged: its residual is"), "{warning}");
    }
    // One that absorbs a twentieth is soon solved.
    let grey = cube(1.0, 0.95).build().expect("a scene");
    for solver in Solver::ALL {
        let (_, report) = solved(&grey, &with(12, solver));
        assert_eq!((report.residual, report.warning()), (None, None), "{}", solver.name());
    }
}

/// The largest difference of two solutions over the mean of the second, without what lamps emit.
fn difference(a: &Solution, b: &Solution) -> f64 {
    let (of, areas) =
        (|s: &Solution, i: usize, c: usize| f64::from(s.radiance[i][c] - s.emission[i][c]), b.problem().areas);
    let total: f64 = areas.iter().sum();
    (0..3)
        .map(|c| {
            let mean: f64 = (0..areas.len()).map(|i| of(b, i, c) * areas[i]).sum::<f64>() / total;
            (0..areas.len()).map(|i| (of(a, i, c) - of(b, i, c)).abs() / mean).fold(0.0, f64::max)
        })
        .fold(0.0, f64::max)
}

#[test]
fn solvers_agree() {
    let scene = SceneSource::open("cornell-box").expect("built in").build().expect("a scene");
    let (reference, _) = solved(&scene, &with(500, Solver::GaussSeidel));
    for solver in [Solver::Inverse, Solver::Jacobi, Solver::Progressive] {
        let (solution, _) = solved(&scene, &with(500, solver));
        let found = difference(&solution, &reference);
        assert!(found < 1e-4, "{}: {found:e}", solver.name());
    }
    // Links between patches only are the matrix; coarser ones are as much further from it as they are allowed to be.
    let mut last = f64::INFINITY;
    for error in [1e-4, 1e-6, 1e-14] {
        let settings = RadiositySettings { error, ..with(500, Solver::Hierarchical) };
        let (solution, report) = solved(&scene, &settings);
        let found = difference(&solution, &reference);
        assert!(found < last, "ε = {error:e}: {found:e} after {last:e}, {} links", report.links);
        last = found;
    }
    assert!(last < 1e-4, "hierarchical: {last:e}");
}

#[test]
fn reciprocity_and_bits_do_not_hang_on_threads() {
    let scene = SceneSource::open("cornell-box").expect("built in").build().expect("a scene");
    let of = |threads: usize, solver: Solver| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        pool.install(|| solved(&scene, &with(300, solver)).0)
    };
    for solver in Solver::ALL {
        assert_eq!(of(1, solver), of(3, solver), "{}", solver.name());
    }
    // Whichever of two patches asks, the number is the same but for the order of a sum.
    let mesh = Patches::new(&scene, &scene.faces(), 300);
    let factors = FormFactors::new(&scene, &mesh, &mesh.leaves, vec![Kind::Patch; mesh.len()], 4, 1);
    let n = mesh.len();
    let rows: Vec<Vec<f32>> = (0..n)
        .map(|i| {
            let mut row = vec![0.0; n];
            factors.row(i, 0..n, &mut row);
            row
        })
        .collect();
    let mut seen = 0;
    for (i, row) in rows.iter().enumerate() {
        for (j, other) in rows.iter().enumerate().take(i) {
            let (a, b) = (row[j], other[i]);
            assert!((a - b).abs() <= 1e-5 * a.max(b), "{i}, {j}: {a}, {b}");
            seen += u32::from(a > 0.0);
        }
    }
    assert!(seen > 10_000);
}

#[test]
fn no_corner_lies_within_an_edge() {
    let scene = SceneSource::open("cornell-box").expect("built in").build().expect("a scene");
    let faces = scene.faces();
    let whole = Patches::new(&scene, &faces, 1500);
    let near_the_lamp = |p: usize| {
        let c = whole.corners(whole.leaves[p]).iter().sum::<glam::DVec3>() / 3.0;
        -c.distance(glam::DVec3::new(278.0, 548.0, 280.0))
    };
    let urgent: Vec<f64> = (0..whole.len()).map(near_the_lamp).collect();
    for mesh in [whole.clone(), whole.refined(&urgent, 2500)] {
        // Corners only ever come to be at the middles of edges.
        let place = |p: glam::DVec3| p.to_array().map(|x| (x * 1e6).round() as i64);
        let mut corners = HashSet::new();
        for p in 0..mesh.len() {
            corners.extend(mesh.triangle(p).map(|v| place(mesh.vertices[v as usize])));
        }
        for p in 0..mesh.len() {
            let c = mesh.corners(mesh.leaves[p]);
            for k in 0..3 {
                let middle = (c[k] + c[(k + 1) % 3]) * 0.5;
                assert!(!corners.contains(&place(middle)), "a corner at {middle}, within an edge of patch {p}");
            }
            // Longest edges are cut, so that triangles stay round: no angle below half of the thinnest face's.
            let angle = |k: usize| (c[(k + 1) % 3] - c[k]).angle_between(c[(k + 2) % 3] - c[k]);
            assert!((0..3).all(|k| angle(k) > 0.2), "patch {p}: {:?}", [angle(0), angle(1), angle(2)]);
        }
        let area: f64 = mesh.leaves.iter().map(|e| mesh.area(*e)).sum();
        let of_faces: f64 = (0..faces.len() as u32).map(|f| mesh.area(f)).sum();
        assert!((area / of_faces - 1.0).abs() < 1e-12);
        // A point of a face is in the patch that it is led to.
        for (patch, e) in mesh.leaves.iter().enumerate() {
            let face = mesh.elements[*e as usize].face;
            let c = mesh.corners(*e);
            let p = c[0] * 0.5 + c[1] * 0.3 + c[2] * 0.2;
            let w = rebond::integrators::radiosity::patches::weights_of(p, mesh.corners(face));
            let (found, weights) = mesh.locate(face, w.map(|x| x as f32));
            assert_eq!(found, patch);
            // The halves turn corners about, but keep them the same corners.
            let back: glam::DVec3 = (0..3).map(|k| c[k] * f64::from(weights[k])).sum();
            assert!(back.distance(p) < 1e-2, "{back}, {p}");
        }
        // What a file holds of it is enough.
        assert_eq!(Patches::from_cuts(&scene, &faces, &mesh.cuts()).expect("its own cuts"), mesh);
    }
}

#[test]
fn relighting_is_solving_with_other_lights() {
    let scene = SceneSource::open("cornell-box").expect("built in").build().expect("a scene");
    // With 64 rays for all, what shines makes no difference to form factors.
    let settings = RadiositySettings { rays: 64, ..with(400, Solver::Inverse) };
    let (first, _) = solved(&scene, &settings);
    let mut twice = first.clone();
    let lamp = first.emission.iter().find(|e| e[0] > 0.0).expect("a lamp").map(|x| 2.0 * x);
    assert!(twice.relight(&[(0, lamp)]));
    for (a, b) in twice.radiance.iter().zip(&first.radiance) {
        assert!((0..3).all(|c| (a[c] - 2.0 * b[c]).abs() <= 1e-5 * a[c]), "{a:?}, {b:?}");
    }
    // The short block in the lamp's place.
    let mut source = SceneSource::open("cornell-box").expect("built in");
    for (i, shape) in source.description.shapes.iter_mut().enumerate() {
        use rebond::scene::description::{Color, ShapeDescription as S};
        match shape {
            S::Mesh(m) if i == 4 => m.emission = Some(Color([3.0, 2.0, 1.0])),
            S::Rectangle(r) => r.emission = None,
            _ => {}
        }
    }
    let other = source.build().expect("a scene");
    let (expected, _) = solved(&other, &RadiositySettings { solver: Solver::Jacobi, ..settings });
    let mut relit = first;
    assert!(relit.relight(&[(0, [0.0; 3]), (4, [3.0, 2.0, 1.0])]));
    let found = difference(&relit, &expected);
    assert!(found < 1e-4, "{found:e}");
    let (mut without, _) = solved(&scene, &with(100, Solver::Jacobi));
    assert!(!without.relight(&[(0, lamp)]), "there is no inverse");
}

/// A point light that relighting does not touch is gathered from as before; and a solution fits no scene but its own.
#[test]
fn relit_solutions_are_gathered_from() {
    let text = |reflectance: f64| {
        format!(
            "film = {{ width = 24, height = 24 }}\n[camera]\ntype = \"orthographic\"\n\
             to_world.look_at = {{ origin = [0, 0, 0.9], target = [0, 0, 0], up = [0, 1, 0] }}\n\
             [[emitters]]\ntype = \"point\"\nposition = [0.2, 0.1, 0.8]\nintensity = 1\n\
             [[shapes]]\ntype = \"rectangle\"\nmaterial = {{ type = \"diffuse\", reflectance = {reflectance} }}\n\
             [[shapes]]\ntype = \"rectangle\"\nemission = 0.5\n\
             to_world = [{{ rotate = {{ axis = [1, 0, 0], angle = 180 }} }}, {{ translate = [0, 0, 1] }}]\n"
        )
    };
    let (source, other) = (parse(&text(0.5)), parse(&text(0.2)));
    let scene = source.build().expect("a scene");
    let settings = RadiositySettings { gather: 8, ..with(200, Solver::Inverse) };
    let (solution, _) = solved(&scene, &settings);
    let mut relit = solution.clone();
    assert!(relit.relight(&[(1, [0.5; 3])]));
    let view = |solution: &Solution, scene: &Scene| {
        let settings = RadiositySettings { loaded: Some(Arc::new(solution.clone())), ..settings.clone() };
        let sampler = Sampler::new(SamplerSettings::default(), 1);
        let integrator =
            IntegratorSettings::Radiosity(Box::new(settings)).integrator(scene, sampler, Engine::Wavefront);
        integrator.map(|i| {
            let mut film = Film::new(24, 24);
            let budget = Budget { samples: Some(64), ..Budget::default() };
            render(&*i, &mut film, Region::whole(24, 24), 0, &budget, 2, &());
            mean_of(&film)[1]
        })
    };
    let (before, after) = (view(&solution, &scene).expect("its scene"), view(&relit, &scene).expect("its scene"));
    assert!(before > 0.1 && (after / before - 1.0).abs() < 0.01, "{before} {after}");
    let scene = other.build().expect("a scene");
    assert!(view(&solution, &scene).expect_err("another scene").message.contains("another scene"));
}

fn mean_of(film: &rebond::film::Film) -> [f64; 3] {
    let mut sum = [0.0; 3];
    film.pixels().iter().for_each(|p| (0..3).for_each(|c| sum[c] += p.mean()[c]));
    sum.map(|x| x / film.pixels().len() as f64)
}

#[test]
fn views_are_the_path_tracer_s_picture() {
    let source = small("cornell-box", [64, 64]);
    let job = |samples: u32| Job { samples: 0..samples, ..Job::default() };
    let reference = mean_of(&film(&source, "path", &job(256)));
    for (settings, samples, within) in [
        ("radiosity:patches=2000", 16, 0.02),
        ("radiosity:patches=2000,smooth=false", 16, 0.02),
        ("radiosity:patches=2000,adaptive=true", 16, 0.02),
        ("radiosity:patches=2000,solver=hierarchical", 16, 0.02),
        ("radiosity:patches=500,gather=4", 16, 0.02),
    ] {
        let found = mean_of(&film(&source, settings, &job(samples)));
        for c in 0..3 {
            assert!((found[c] / reference[c] - 1.0).abs() < within, "{settings}: {found:?}, path {reference:?}");
        }
    }
}

#[test]
fn stages_of_shooting_add_up_to_the_last() {
    let source = small("cornell-box", [32, 32]);
    let of = |solver: &str, samples: std::ops::Range<u32>| {
        film(&source, &format!("radiosity:patches=200,solver={solver}"), &Job { samples, ..Job::default() })
    };
    let (whole, last) = (of("progressive", 0..64), mean_of(&of("gauss-seidel", 0..64)));
    let mut parts = of("progressive", 0..3);
    parts.merge(&of("progressive", 3..64));
    assert_eq!(parts.develop(), whole.develop(), "samples hang on their index alone");
    let found = mean_of(&whole);
    for c in 0..3 {
        assert!((found[c] / last[c] - 1.0).abs() < 2e-3, "{found:?}, {last:?}");
    }
    // The first picture already has most of the light.
    let first = mean_of(&of("progressive", 0..1));
    for c in 0..3 {
        assert!((0.6..1.6).contains(&(first[c] / last[c])), "{first:?}, {last:?}");
    }
}

#[test]
fn lights_that_are_no_patches_shine_on_patches() {
    let floor = r#"
        film = { width = 8, height = 8 }
        [camera]
        type = "orthographic"
        to_world = [{ scale = 0.9 }, { look_at = { origin = [0, 0, 3], target = [0, 0, 0], up = [0, 1, 0] } }]
        [[shapes]]
        type = "rectangle"
        material = { type = "diffuse", reflectance = 0.6 }
        [[emitters]]
        "#;
    for light in [
        "type = \"point\"\nposition = [0.3, 0.2, 2]\nintensity = 5",
        "type = \"directional\"\ndirection = [0.2, 0.1, -1]\nirradiance = 2",
        "type = \"constant\"\nradiance = 1.5",
    ] {
        let source = parse(&format!("{floor}{light}\n"));
        let job = Job { samples: 0..64, ..Job::default() };
        let (found, known) =
            (mean_of(&film(&source, "radiosity:patches=300", &job)), mean_of(&film(&source, "path:max_depth=2", &job)));
        assert!((found[1] / known[1] - 1.0).abs() < 0.01, "{light}: {found:?}, {known:?}");
    }
}

#[test]
fn textures_are_seen_through_the_light() {
    // An even sky: every point of the floor receives the same, so its picture is its texture.
    let source = parse(
        r#"
        film = { width = 24, height = 24 }
        [camera]
        type = "orthographic"
        to_world = [{ scale = 0.99 }, { look_at = { origin = [0, 0, 3], target = [0, 0, 0], up = [0, 1, 0] } }]
        [[shapes]]
        type = "rectangle"
        material = { type = "diffuse", reflectance = { image = "checker.png" } }
        [[emitters]]
        type = "constant"
        radiance = 1
        "#,
    );
    let job = Job { samples: 0..64, ..Job::default() };
    let (found, known) = (film(&source, "radiosity:patches=40", &job), film(&source, "path", &job));
    for (a, b) in found.pixels().iter().zip(known.pixels()) {
        assert!((a.mean()[1] - b.mean()[1]).abs() < 0.05, "{:?}, {:?}", a.mean(), b.mean());
    }
}

#[test]
fn what_is_not_diffuse_is_named() {
    let shapes = r#"
        [materials]
        gold = { type = "conductor", metal = "gold" }
        half = { type = "mix", a = { type = "diffuse", reflectance = 0.8 }, b = { type = "mirror" }, weight = 0.25 }
        [[shapes]]
        type = "rectangle"
        emission = 1
        [[shapes]]
        type = "cube"
        material = "gold"
        [[shapes]]
        type = "cube"
        material = "half"
        "#;
    let scene = parse(shapes).build().expect("a scene");
    let settings = with(50, Solver::GaussSeidel);
    let Err(Unsolvable::Settings(e)) = solve(&scene, &settings, &sampler(0), &()) else {
        panic!("gold is not diffuse")
    };
    assert!(e.message.contains("shapes[1] (material \"gold\"): a conductor"), "{}", e.message);
    assert!(e.message.contains("shapes[2] (material \"half\"): a mirror"), "{}", e.message);
    assert!(e.help.contains("diffuse_only"), "{}", e.help);
    let only = RadiositySettings { diffuse_only: true, ..settings.clone() };
    let (solution, report) = solve(&scene, &only, &sampler(0), &()).expect("what is diffuse of it");
    assert_eq!(report.dropped.len(), 2);
    let has = |r: f32| solution.reflectance.iter().any(|x| (x[0] - r).abs() < 1e-6);
    assert!(has(0.0) && has(0.6), "gold is black, and of the mix three quarters of 0.8 are left");
    for (more, what) in [
        ("[[shapes]]\ntype = \"sphere\"\n", "shapes[3]: a sphere"),
        (
            "[[shapes]]\ntype = \"cube\"\nmaterial = { type = \"mask\", opacity = 0.5, material = \"gold\" }\n",
            "a surface with holes",
        ),
        (
            "[[shapes]]\ntype = \"cube\"\nto_world = { keyframes = [{ time = 0 }, { time = 1, to_world = { translate = [1, 0, 0] } }] }\n",
            "shapes[3].to_world: a motion",
        ),
    ] {
        let scene = parse(&(shapes.to_owned() + more)).build().expect("a scene");
        let Err(Unsolvable::Settings(e)) = solve(&scene, &only, &sampler(0), &()) else { panic!("{what}") };
        assert!(e.message.contains(what), "{}", e.message);
    }
}

#[test]
fn what_does_not_fit_says_what_would() {
    let scene = SceneSource::open("cornell-box").expect("built in").build().expect("a scene");
    let settings = RadiositySettings { memory: 1.0, ..with(30_000, Solver::Inverse) };
    let Err(Unsolvable::Settings(e)) = solve(&scene, &settings, &sampler(0), &()) else { panic!("it does not fit") };
    assert!(e.message.contains("30000 patches need") && e.message.contains("GB by inverse"), "{}", e.message);
    assert!(
        e.help.contains("progressive") && e.help.contains("hierarchical") && !e.help.contains("jacobi"),
        "{}",
        e.help
    );
    struct Stop;
    impl Observer for Stop {
        fn should_stop(&self) -> bool {
            true
        }
    }
    for solver in Solver::ALL {
        assert_eq!(solve(&scene, &with(50, solver), &sampler(0), &Stop).err(), Some(Unsolvable::Stopped));
    }
}

#[test]
fn files_hold_all_of_a_solution() {
    let scene = SceneSource::open("cornell-box").expect("built in").build().expect("a scene");
    let settings = RadiositySettings { adaptive: true, ..with(150, Solver::Inverse) };
    for solver in [Solver::Inverse, Solver::Jacobi] {
        let (solution, _) = solved(&scene, &RadiositySettings { solver, ..settings.clone() });
        let bytes = write_solution(&solution, "cornell-box");
        assert_eq!(read_solution(&bytes, "a", &scene).expect("its own file"), solution);
        let other = cube(1.0, 0.5).build().expect("a scene");
        let error = read_solution(&bytes, "a.safetensors", &other).expect_err("another scene");
        assert!(error.to_string().contains("of another scene"), "{error}");
        for length in [0, 7, 100, bytes.len() / 2, bytes.len() - 1] {
            assert!(read_solution(&bytes[..length], "a", &scene).is_err(), "{length} bytes");
        }
        // Any one byte may be wrong: an error or other numbers, never a panic.
        for at in (0..2000.min(bytes.len())).step_by(7) {
            let mut wrong = bytes.clone();
            wrong[at] ^= 0x15;
            let _ = read_solution(&wrong, "a", &scene);
        }
    }
}

#[test]
fn another_reader_finds_the_light_of_a_baked_mesh() {
    let scene = SceneSource::open("cornell-box").expect("built in").build().expect("a scene");
    let (solution, _) = solved(&scene, &with(200, Solver::GaussSeidel));
    for smooth in [true, false] {
        let bytes = write_glb(&solution, smooth, 1.0);
        let glb = gltf::Gltf::from_slice(&bytes).expect("glTF 2.0 by the crate that reads it");
        let blob = glb.blob.as_deref();
        let primitive = glb.meshes().next().expect("a mesh").primitives().next().expect("a primitive");
        let reader = primitive.reader(|_| blob);
        let positions: Vec<[f32; 3]> = reader.read_positions().expect("positions").collect();
        let colors: Vec<[f32; 3]> = reader.read_colors(0).expect("colours").into_rgb_f32().collect();
        let indices: Vec<u32> = reader.read_indices().expect("indices").into_u32().collect();
        assert_eq!((indices.len(), positions.len()), (3 * solution.mesh.len(), colors.len()));
        let corners = solution.at_corners(smooth);
        for (patch, triangle) in indices.chunks(3).enumerate() {
            for (k, i) in triangle.iter().enumerate() {
                let place = solution.mesh.vertices[solution.mesh.triangle(patch)[k] as usize].as_vec3().to_array();
                assert_eq!(positions[*i as usize], place);
                for c in 0..3 {
                    let light = solution.emission[patch][c] + solution.reflectance[patch][c] * corners[patch][k][c];
                    assert!((colors[*i as usize][c] - light.min(1.0)).abs() < 1e-6);
                }
            }
            if !smooth {
                let flat = solution.radiance[patch].map(|x| x.min(1.0));
                let found = colors[triangle[0] as usize];
                assert!((0..3).all(|c| (found[c] - flat[c]).abs() < 1e-5), "{found:?}, {flat:?}");
            }
        }
        let (shared, all) = (positions.len(), indices.len());
        assert!(if smooth { 3 * shared < all } else { shared == all }, "{shared} corners for {all}");
    }
}
