//! One path told vertex by vertex is the one that the film gets.

use rebond::film::Film;
use rebond::integrators::IntegratorSettings;
use rebond::render::{Budget, Engine, Integrator, Region, Story, render};
use rebond::sampling::Sampler;
use rebond::scene::Scene;
use rebond_io::{SceneSource, from_settings};

const SIZE: u32 = 24;

fn scene(name: &str) -> (SceneSource, Scene) {
    let mut source = SceneSource::open(name).expect(name);
    (source.description.film.width, source.description.film.height) = (SIZE, SIZE);
    let scene = source.build().expect(name);
    (source, scene)
}

/// Stories of every seventh pixel, two samples each, by an integrator; with the film's own samples.
fn stories(name: &str, settings: &str) -> Vec<(Story, [f32; 3])> {
    let (source, scene) = scene(name);
    let settings: IntegratorSettings = from_settings(settings).expect(settings).0;
    let sampler = Sampler::new(source.description.sampler, 5);
    let integrator = settings.integrator(&scene, sampler, Engine::Scalar).expect(name);
    let one = |n: u32, sample: u32| {
        let [x, y] = [n % SIZE, n / SIZE];
        let story = integrator.tell([x, y], SIZE, sample).expect("a story");
        let region = Region { x, y, width: 1, height: 1, full_width: SIZE };
        let mut film = Film::new(1, 1);
        let budget = Budget { samples: Some(1), ..Budget::default() };
        render(&*integrator as &dyn Integrator, &mut film, region, sample, &budget, 1, &());
        (story, film.pixels()[0].mean().map(|x| x as f32))
    };
    (0..SIZE * SIZE).step_by(7).flat_map(|n| [one(n, 0), one(n, 1001)]).collect()
}

fn bits(rgb: [f32; 3]) -> [u32; 3] {
    rgb.map(f32::to_bits)
}

#[test]
fn the_sum_is_the_films_sample_to_the_last_bit() {
    for (name, settings) in [
        ("cornell-spheres", "path"),
        ("cornell-spheres", "path:mode=implicit"),
        ("cornell-spheres", "path:mode=explicit,light_sampling=solid-angle"),
        ("cornell-spheres", "path:paths=L[DG]*E"),
        ("veach-mis", "direct"),
        ("sky", "path:max_depth=5"),
        ("sky", "direct:sampling=product"),
        ("point-lights", "path"),
        ("many-lights", "path"),
        ("cornell-box", "ambient-occlusion"),
    ] {
        let (mut lit, mut longest) = (0, 0);
        for (story, sample) in stories(name, settings) {
            let sum = story
                .vertices
                .iter()
                .fold([0.0; 3], |sum: [f32; 3], v| std::array::from_fn(|c| sum[c] + v.contribution[c]));
            assert_eq!(bits(sum), bits(story.radiance), "{name} {settings}: {story:?}");
            assert_eq!(bits(sum), bits(sample), "{name} {settings}: {story:?}");
            lit += usize::from(sum != [0.0; 3]);
            longest = longest.max(story.vertices.len());
        }
        assert!(lit > 0 && longest > 0, "{name} {settings}: {lit}, {longest}");
    }
}

#[test]
fn a_story_hangs_together() {
    for (story, _) in stories("cornell-spheres", "path") {
        for (n, v) in story.vertices.iter().enumerate() {
            assert_eq!(v.depth as usize, n + 1);
            // What is found and what was asked for make up the contribution.
            let asked = v.asked.filter(|a| !a.blocked).map_or([0.0; 3], |a| a.light);
            assert_eq!(bits(std::array::from_fn(|c| v.found[c] + asked[c])), bits(v.contribution));
            for w in &v.weights {
                assert!((0.0..=1.0).contains(&w.weight));
                // The power heuristic, as it is defined.
                if w.pdf.is_finite() && w.pdf > 0.0 {
                    let (a, b) = (f64::from(w.pdf).powi(2), f64::from(w.other).powi(2));
                    assert!((f64::from(w.weight) - a / (a + b)).abs() < 1e-5, "{w:?}");
                }
            }
        }
        // Every ray starts where the one before ended, to within what keeps it off the surface.
        for pair in story.vertices.windows(2) {
            let place = pair[0].place.expect("a surface that the path leaves");
            let off: f32 = (0..3).map(|c| (place.position[c] - pair[1].origin[c]).abs()).sum();
            assert!(off < 0.1, "{off}"); // of 550 mm
            assert!(pair[0].event.is_some());
        }
        assert!(story.vertices.last().is_some_and(|v| v.event.is_none()));
    }
}
