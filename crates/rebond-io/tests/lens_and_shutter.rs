//! Depth of field and motion blur against what geometry says.

mod common;

use common::*;
use rebond::film::Film;
use rebond::math::Moments;
use rebond::sampling::SamplerSettings;
use std::f64::consts::{PI, TAU};

const LEVEL: f64 = 0.01;
const SEEDS: [u64; 3] = [1, 2, 3];

fn independent(scene: &str, integrator: &str, seed: u64, samples: u32) -> Film {
    let job = Job { seed, sampler: SamplerSettings::Independent {}, samples: 0..samples, ..Job::default() };
    film(&parse(scene), integrator, &job)
}

/// Judges the columns of a picture by what the mean of each should be; `tests` of them are made in all. Where theory says 0
/// or 1 nothing else will do.
fn judge_columns(film: &Film, width: usize, expected: &[f64], tests: usize, what: &str) {
    let mut judged = 0;
    for (x, expected) in expected.iter().enumerate() {
        let column: Vec<f64> = film.pixels().iter().skip(x).step_by(width).map(|p| p.mean()[1]).collect();
        let moments: Moments = column.iter().copied().collect();
        if *expected < 1e-9 || *expected > 1.0 - 1e-9 {
            let off = column.iter().map(|m| (m - expected).abs()).fold(0.0, f64::max);
            assert!(off < 1e-6, "{what}: column {x} is off by {off}");
        } else if (0.01..0.99).contains(expected) {
            let p = moments.p_value(*expected);
            assert!(p > LEVEL / tests as f64, "{what}: column {x} is {} for {expected}, p {p}", moments.mean());
            judged += 1;
        }
    }
    assert!(judged > 3, "{what}: {judged} columns judged");
}

// ---- depth of field ----

const LENS: f64 = 0.25;
const FOCUS: f64 = 4.0;

/// The opening of a lens: corners of its polygon, or none if it is round. As in the camera, x is to the left.
struct Opening {
    blades: usize,
    rotation: f64,
}

impl Opening {
    fn corners(&self) -> Vec<[f64; 2]> {
        let angle = |k: usize| self.rotation.to_radians() + TAU * k as f64 / self.blades as f64;
        (0..self.blades).map(|k| [LENS * angle(k).sin(), LENS * angle(k).cos()]).collect()
    }

    fn area(&self) -> f64 {
        if self.blades == 0 { PI * LENS * LENS } else { self.area_right_of(f64::INFINITY) }
    }

    /// The area of the polygon at x < c.
    fn area_right_of(&self, c: f64) -> f64 {
        let corners = self.corners();
        let mut kept: Vec<[f64; 2]> = Vec::new();
        for (k, a) in corners.iter().enumerate() {
            let b = corners[(k + 1) % corners.len()];
            if a[0] < c {
                kept.push(*a);
            }
            if (a[0] < c) != (b[0] < c) {
                let s = (c - a[0]) / (b[0] - a[0]);
                kept.push([c, a[1] + s * (b[1] - a[1])]);
            }
        }
        let twice: f64 = (0..kept.len())
            .map(|k| {
                let ([x0, y0], [x1, y1]) = (kept[k], kept[(k + 1) % kept.len()]);
                x0 * y1 - x1 * y0
            })
            .sum();
        twice.abs() / 2.0
    }

    /// The mean, over c from a to b, of the share of the opening at x < c.
    fn mean_share(&self, a: f64, b: f64) -> f64 {
        if self.blades == 0 {
            // The disk's share left of a chord is ½ + (t √(1−t²) + asin t)/π; this is its integral.
            let integral = |c: f64| {
                let t = (c / LENS).clamp(-1.0, 1.0);
                let root = (1.0 - t * t).sqrt();
                let inside = t / 2.0 + (t * t.asin() + root - root.powi(3) / 3.0) / PI;
                LENS * inside + (c - LENS).max(0.0)
            };
            return (integral(b) - integral(a)) / (b - a);
        }
        // Quadratic between corners, so that Simpson's rule is exact there.
        let mut edges: Vec<f64> = self.corners().iter().map(|c| c[0]).filter(|x| a < *x && *x < b).collect();
        edges.extend([a, b]);
        edges.sort_by(f64::total_cmp);
        let share = |c: f64| self.area_right_of(c) / self.area();
        let piece = |e: &[f64]| (e[1] - e[0]) / 6.0 * (share(e[0]) + 4.0 * share((e[0] + e[1]) / 2.0) + share(e[1]));
        edges.windows(2).map(piece).sum::<f64>() / (b - a)
    }

    fn toml(&self) -> String {
        format!(
            "type = \"thin-lens\"\nfov = 10\naperture_radius = {LENS}\nfocus_distance = {FOCUS}\n\
             aperture_blades = {}\naperture_rotation = {}\n",
            self.blades, self.rotation
        )
    }
}

/// Half the picture's width in the plane in focus.
fn half_width() -> f64 {
    5_f64.to_radians().tan() * FOCUS
}

/// A half-plane of light out of focus: through the lens point l, the pixel that is at X in the plane in focus sees it at
/// x = l (1 − z/f) + X z/f. Its edge is as blurred as the part of the lens on one side of a chord says.
#[test]
fn an_edge_out_of_focus_is_a_chord_of_the_lens() {
    let (width, height) = (48, 64);
    let openings = [(0, 0.0), (0, 0.0), (3, 20.0), (5, 0.0), (5, -33.0), (6, 10.0), (7, 90.0)];
    let places = [2.5, 9.0];
    let tests = openings.len() * places.len() * SEEDS.len() * width;
    for (blades, rotation) in openings {
        let opening = Opening { blades, rotation };
        for z in places {
            let scene = format!(
                r#"
                film = {{ width = {width}, height = {height}, filter = {{ type = "box" }} }}
                [camera]
                {}
                [[shapes]]
                type = "rectangle"
                emission = 1
                flip_normals = true
                to_world = [{{ scale = 50 }}, {{ translate = [50, 0, {z}] }}]
                "#,
                opening.toml()
            );
            let (k, m) = (1.0 - z / FOCUS, z / FOCUS);
            let at = |i: usize| half_width() * (1.0 - 2.0 * i as f64 / width as f64);
            let expected: Vec<f64> = (0..width)
                .map(|i| {
                    let (a, b) = (at(i + 1), at(i));
                    if k < 0.0 {
                        opening.mean_share(a * m / -k, b * m / -k)
                    } else {
                        1.0 - opening.mean_share(-b * m / k, -a * m / k)
                    }
                })
                .collect();
            for seed in SEEDS {
                let film = independent(&scene, "path:max_depth=1", seed, 64);
                judge_columns(&film, width, &expected, tests, &format!("{blades} blades, z = {z}, seed {seed}"));
            }
        }
    }
}

/// A small disk of light out of focus becomes the opening's own shape: of diameter 2R |z − f|/z in the plane in focus, evenly
/// lit, and dark outside.
#[test]
fn a_point_out_of_focus_is_a_circle_of_confusion() {
    let (side, spot) = (49, 0.01);
    for (blades, z) in [(0, 2.5), (0, 9.0), (6, 9.0), (5, 2.5)] {
        let opening = Opening { blades, rotation: 15.0 };
        let scene = format!(
            r#"
            film = {{ width = {side}, height = {side}, filter = {{ type = "box" }} }}
            [camera]
            {}
            [[shapes]]
            type = "disk"
            emission = 1
            flip_normals = true
            to_world = [{{ scale = {spot} }}, {{ translate = [0, 0, {z}] }}]
            "#,
            opening.toml()
        );
        let (k, m) = ((1.0 - z / FOCUS).abs(), z / FOCUS);
        let (radius, rim) = (LENS * k / m, spot / m);
        let pixel = 2.0 * half_width() / f64::from(side);
        let inner = if blades == 0 { radius } else { radius * (PI / blades as f64).cos() };
        let even = PI * (spot / k).powi(2) / opening.area();
        let all = PI * rim * rim / (2.0 * half_width()).powi(2);
        for seed in SEEDS {
            let film = independent(&scene, "path:max_depth=1", seed, 1024);
            let mut inside = Moments::default();
            for (i, p) in film.pixels().iter().enumerate() {
                let from_center = |n: u32| (f64::from(n) - f64::from(side / 2)) * pixel;
                let distance = from_center(i as u32 % side).hypot(from_center(i as u32 / side));
                if distance + pixel < inner - rim {
                    inside.add(p.mean()[1]);
                } else if distance - pixel > radius + rim {
                    assert_eq!(p.mean()[1], 0.0, "{blades} blades, z = {z}: light at {distance}, beyond {radius}");
                }
            }
            assert!(inside.count() > 100);
            let (p, mean) = (inside.p_value(even), inside.mean());
            assert!(p > LEVEL / 24.0, "{blades} blades, z = {z}, seed {seed}: {mean} for {even}, p {p}");
            let (mean, p) = t_test(&film, all);
            assert!(p > LEVEL / 24.0, "{blades} blades, z = {z}, seed {seed}: {mean} for {all} in all, p {p}");
        }
    }
}

// ---- motion blur ----

/// The mean, over the pixel from p to q and over centres c0 to c1, of the share covered by a bar of half-width a.
fn swept(c0: f64, c1: f64, a: f64, [p, q]: [f64; 2]) -> f64 {
    // ∫ P(c < u) du
    let integral = |u: f64| {
        let inside = u.clamp(c0, c1);
        (inside - c0).powi(2) / (2.0 * (c1 - c0)) + (u - c1).max(0.0)
    };
    (integral(q + a) - integral(p + a) - integral(q - a) + integral(p - a)) / (q - p)
}

/// A bar that moves across the picture while the shutter is open is a trapezoid: whether it shines, hides what shines, stands
/// still before a camera that moves the other way, or is part of a group.
#[test]
fn a_moving_bar_is_a_trapezoid() {
    let (width, height) = (32, 64);
    // Slower and faster than its own width; the shutter is open for half of the motion.
    let bars = [(-0.4, 0.2, 0.5), (-0.8, 0.6, 0.06)];
    let tests = 4 * bars.len() * SEEDS.len() * width;
    for (c0, c1, a) in bars {
        let (middle, reach) = ((c0 + c1) / 2.0, c1 - c0);
        let moved = |from: f64, to: f64| {
            format!(
                "{{ keyframes = [{{ time = 0, to_world = {{ translate = [{from}, 0, 0] }} }}, \
                 {{ time = 2, to_world = {{ translate = [{to}, 0, 0] }} }}] }}"
            )
        };
        let motion = moved(middle - reach, middle + reach);
        let bar = |with: &str, motion: &str| {
            format!(
                "[[shapes]]\ntype = \"rectangle\"\nflip_normals = true\n{with}\n\
                 to_world = [{{ scale = [{a}, 9, 1] }}, {{ translate = [0, 0, 5] }}, {motion}]\n"
            )
        };
        let camera = |motion: &str| {
            format!("[camera]\ntype = \"orthographic\"\nshutter_open = 0.5\nshutter_close = 1.5\n{motion}\n")
        };
        let film = format!("film = {{ width = {width}, height = {height}, filter = {{ type = \"box\" }} }}\n");
        let background = "[[shapes]]\ntype = \"rectangle\"\nflip_normals = true\nemission = 1\n\
                          to_world = [{ scale = 9 }, { translate = [0, 0, 7] }]\n";
        let still = "{ translate = [0, 0, 0] }";
        let group = format!("{}\n", bar("", still).replace("[[shapes]]", "[[groups.bar]]"));
        let instance = format!("[[shapes]]\ntype = \"instance\"\ngroup = \"bar\"\nto_world = [{motion}]\n");
        let away = moved(reach - middle, -middle - reach);
        let scenes = [
            ("a light", true, format!("{film}{}{}", camera(""), bar("emission = 1", &motion))),
            ("a shade", false, format!("{film}{}{background}{}", camera(""), bar("", &motion))),
            (
                "a camera",
                true,
                format!("{film}{}{}", camera(&format!("to_world = [{away}]")), bar("emission = 1", still)),
            ),
            ("a group", false, format!("{film}{}{background}{group}{instance}", camera(""))),
        ];
        for (what, shines, scene) in scenes {
            let at = |i: usize| 1.0 - 2.0 * i as f64 / width as f64;
            let covered: Vec<f64> = (0..width).map(|i| swept(c0, c1, a, [at(i + 1), at(i)])).collect();
            let expected: Vec<f64> = covered.iter().map(|c| if shines { *c } else { 1.0 - c }).collect();
            for seed in SEEDS {
                let film = independent(&scene, "path:max_depth=1", seed, 64);
                judge_columns(&film, width, &expected, tests, &format!("{what}, half-width {a}, seed {seed}"));
            }
        }
    }
}

/// The irradiance below lights that move, averaged over the time of the shutter in closed form.
#[test]
fn moving_lights_light_the_floor() {
    let (h, r, x0, x1) = (1.5, 0.4, -0.6, 2.0);
    // ∫ h/(h² + x²)^(3/2) dx = x / (h √(h² + x²))
    let along = |x: f64| x / (h * (h * h + x * x).sqrt());
    let passing = (along(x1) - along(x0)) / (x1 - x0);
    // A disk of radius r above, rising: ∫ π r²/(r² + h²) dh = π r atan(h/r)
    let rising = PI * r * ((2.0 * h / r).atan() - (h / r).atan()) / h;
    let keys = |a: &str, b: &str| {
        format!("{{ keyframes = [{{ time = 0, to_world = [{a}] }}, {{ time = 1, to_world = [{b}] }}] }}")
    };
    let at = |x: f64, h: f64| format!("{{ translate = [{x}, 0, {h}] }}");
    let passes = keys(&at(x0, h), &at(x1, h));
    let grown = keys("{ scale = 1 }", "{ scale = 3 }");
    let down = "{ rotate = { axis = [1, 0, 0], angle = 180 } }";
    let shape =
        |kind: &str, to_world: &str| format!("[[shapes]]\ntype = {kind}\nemission = 3\nto_world = [{to_world}]\n");
    let small = format!("\"sphere\"\nradius = {r}");
    // The mean of the squares of radii from r to 3r.
    let growing = 13.0 / 3.0 * (r / 4.0).powi(2) * PI / (h * h);
    let lights = [
        ("a sphere", true, shape(&small, &passes), 3.0 * PI * r * r * passing),
        (
            "a sphere that grows",
            true,
            shape(&format!("\"sphere\"\nradius = {}", r / 4.0), &format!("{grown}, {}", at(0.0, h))),
            3.0 * growing,
        ),
        (
            "a disk that rises",
            true,
            shape("\"disk\"", &format!("{down}, {{ scale = {r} }}, {}", keys(&at(0.0, h), &at(0.0, 2.0 * h)))),
            3.0 * rising,
        ),
        (
            "a point",
            false,
            format!("[[emitters]]\ntype = \"point\"\nposition = [0, 0, 0]\nintensity = 3\nto_world = [{passes}]\n"),
            3.0 * passing,
        ),
        (
            "a spot",
            false,
            format!(
                "[[emitters]]\ntype = \"spot\"\ncutoff_angle = 80\nbeam_width = 80\nintensity = 3\nto_world = [{down}, {passes}]\n"
            ),
            3.0 * passing,
        ),
    ];
    let sampling = [
        ("path:max_depth=2", false),
        ("path:max_depth=2,light_sampling=solid-angle", false),
        ("direct:sampling=area", false),
        ("direct:sampling=bsdf", true),
    ];
    for (what, found, light, irradiance) in &lights {
        let scene = format!(
            r#"
            film = {{ width = 8, height = 8, filter = {{ type = "box" }} }}
            [camera]
            type = "orthographic"
            shutter_close = 1
            to_world = [{{ scale = 0.001 }}, {{ look_at = {{ origin = [0, 0.9, 0.8], target = [0, 0, 0], up = [0, 0, 1] }} }}]
            [[shapes]]
            type = "rectangle"
            to_world = {{ scale = 30 }}
            material = {{ type = "diffuse", reflectance = 0.5 }}
            {light}
            "#
        );
        for (integrator, by_directions) in sampling {
            if by_directions && !found {
                continue;
            }
            for seed in SEEDS {
                let (mean, p) = t_test(&independent(&scene, integrator, seed, 2048), irradiance * 0.5 / PI);
                let expected = irradiance * 0.5 / PI;
                assert!(p > LEVEL / 57.0, "{what}, {integrator}, seed {seed}: {mean} for {expected}, p {p}");
            }
        }
    }
}

/// Lamps that spin, shear, shrink and are mirrored: drawing points of them and meeting them by chance agree, so their densities
/// follow them. There are enough for a tree.
#[test]
fn ways_to_find_moving_lights_agree() {
    let scene = r#"
        film = { width = 32, height = 32, filter = { type = "box" } }
        [camera]
        type = "perspective"
        fov = 50
        shutter_close = 1
        to_world.look_at = { origin = [0, -4, 3], target = [0, 0, 0.3], up = [0, 0, 1] }
        [[shapes]]
        type = "rectangle"
        to_world = { scale = 4 }
        material = { type = "diffuse", reflectance = 0.5 }
        [[shapes]]
        type = "cube"
        emission = [4, 1, 1]
        to_world = [{ scale = 0.3 }, { keyframes = [{ time = 0 }, { time = 1, to_world = { rotate = { axis = [1, 2, 3], angle = 70 } } }] }, { translate = [-1, 0, 1] }]
        [[shapes]]
        type = "rectangle"
        emission = [1, 4, 1]
        flip_normals = true
        to_world = [{ keyframes = [{ time = 0, to_world = [{ scale = [-0.5, 0.3, 1] }] }, { time = 1, to_world = [{ scale = [-0.2, 0.9, 1] }, { rotate = { axis = [0, 1, 0], angle = 40 } }] }] }, { translate = [1, 0.5, 1] }]
        [[shapes]]
        type = "disk"
        emission = [1, 1, 4]
        to_world = [{ rotate = { axis = [1, 0, 0], angle = 150 } }, { keyframes = [{ time = 0, to_world = { scale = [0.5, 0.5, 1] } }, { time = 1, to_world = { matrix = [[0.9, 0.5, 0, 0], [0, 0.5, 0, 0.5], [0, 0, 1, 0]] } }] }, { translate = [0, 1, 1.2] }]
        [[shapes]]
        type = "sphere"
        emission = 3
        radius = 0.2
        to_world = [{ keyframes = [{ time = 0 }, { time = 1, to_world = [{ scale = 1.5 }, { translate = [0.5, -1, 0.5] }] }] }, { translate = [0, -0.5, 0.4] }]
        [[shapes]]
        type = "mesh"
        emission = 2
        positions = [[0, 0, 0], [0, 0.5, 0], [0.5, 0, 0], [0.5, 0.5, 0.3]]
        faces = [[0, 1, 2], [1, 3, 2]]
        to_world = [{ translate = [-1, -1, 0.6] }, { keyframes = [{ time = 0 }, { time = 1, to_world = { translate = [0.7, 0.3, 0.3] } }] }]
    "#;
    let picture = |integrator: &str, seed| independent(scene, integrator, seed, 512).develop();
    let reference = picture("direct:sampling=bsdf", 1);
    let others = [
        "path:max_depth=2",
        "path:max_depth=2,light_sampling=solid-angle",
        "direct:sampling=light",
        "direct:sampling=area",
        "direct:sampling=solid-angle",
    ];
    for (i, integrator) in others.into_iter().enumerate() {
        agree(&picture(integrator, 2 + i as u64), &reference, LEVEL / 15.0, integrator);
    }
}
