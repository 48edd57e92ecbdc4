//! A mesh of two million triangles, through a file.

use rebond::film::Film;
use rebond::render::{Budget, Engine, Region, render};
use rebond::sampling::{Sampler, SamplerSettings};
use rebond_io::{MeshData, SceneFiles, SceneSource, write_ply};

/// A wavy square [−1, 1]² of 2·side² triangles.
fn waves(side: u32) -> MeshData {
    let at = |i: u32| 2.0 * i as f32 / side as f32 - 1.0;
    let height = |x: f32, y: f32| 0.05 * (9.0 * x).sin() * (7.0 * y).cos();
    let row = |j: u32| (0..=side).map(move |i| [at(i), height(at(i), at(j)), -at(j)]);
    let corner = |i: u32, j: u32| j * (side + 1) + i;
    let cell = |n: u32| {
        let (i, j) = (n % side, n / side);
        let [a, b, c, d] = [corner(i, j), corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1)];
        [[a, b, c], [a, c, d]]
    };
    let positions = (0..=side).flat_map(row).collect();
    MeshData { positions, triangles: (0..side * side).flat_map(cell).collect(), ..MeshData::default() }
}

#[test]
fn two_million_triangles_load_and_render() {
    let folder = tempfile::tempdir().expect("a folder");
    std::fs::write(folder.path().join("waves.ply"), write_ply(&waves(1000))).expect("written");
    let text = r#"
        film = { width = 64, height = 64 }
        camera = { type = "orthographic", to_world = [{ scale = 0.9 }, { look_at = { origin = [0, 5, 0], target = [0, 0, 0], up = [0, 0, -1] } }] }
        shapes = [{ type = "ply", file = "waves.ply", material = { type = "diffuse", reflectance = 0.5 } }]
        emitters = [{ type = "constant", radiance = 1 }]
    "#;
    let files = SceneFiles::Folder(folder.path().to_path_buf());
    let source = SceneSource::parse(text, "waves.toml", "waves", files).expect("a scene");
    let scene = source.build().expect("it builds");
    let s = scene.statistics();
    assert_eq!((s.triangles, s.emitters, s.warnings.len()), (2_000_000, 1, 0));
    assert!(s.accelerator_bytes > 0 && s.table_bytes > 0);

    let sampler = Sampler::new(SamplerSettings::default(), 0);
    let integrator = source.description.integrator.integrator(&scene, sampler, Engine::Wavefront).expect("settings");
    let mut film = Film::new(64, 64);
    let budget = Budget { samples: Some(16), ..Budget::default() };
    render(&*integrator, &mut film, Region::whole(64, 64), 0, &budget, 2, &());
    assert_eq!(film.dropped_samples(), 0);
    // Slopes stay below 0.45: a point loses little of its sky to its neighbours, and they give half of that back. So the
    // mean lies between the bare ρ of an open plane less a tenth, and ρ; no pixel is black, and none shows a hole.
    let mean = film.mean()[0];
    assert!(mean > 0.45 && mean < 0.5, "{mean}");
    for pixel in film.pixels() {
        let l = pixel.mean()[0];
        assert!(l > 0.3 && l < 0.7, "{l}");
    }
}
