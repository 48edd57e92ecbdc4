//! Drawings of a lobe, as SVG.

use rebond::bsdf::TransportMode;
use rebond::bsdf::check::{Angles, Material};
use std::fmt::Write;

/// What to draw.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Plot {
    /// Curves in the plane of incidence.
    Polar,
    /// The hemisphere seen from above, and the one below for what transmits, in colours.
    Hemisphere,
    /// One above the other.
    Both,
}

/// Angles of the light in the drawings, and the colour of each in the polar one.
const LIGHTS: [(f64, &str); 4] = [(0.0, "#0072b2"), (30.0, "#009e73"), (60.0, "#d55e00"), (80.0, "#cc79a7")];
const WIDTH: f64 = 880.0;
const POLAR_RADIUS: f64 = 270.0;
const DISK_RADIUS: f64 = 95.0;
/// How many powers of ten the colours span, as the words say.
const DECADES: f64 = 4.0;

/// The words of the drawings.
#[derive(Clone, Copy)]
pub struct Words {
    radius: &'static str,
    largest: &'static str,
    no_lobe: &'static str,
    light_from: &'static str,
    above: &'static str,
    below: &'static str,
    hemispheres: &'static str,
}

pub const ENGLISH: Words = Words {
    radius: "radius √(f / largest f)",
    largest: "largest f",
    no_lobe: "no lobe",
    light_from: "light from",
    above: "above",
    below: "below",
    hemispheres: "f towards each direction, seen from above; ring: the light; colours over four powers of ten",
};

pub const FRENCH: Words = Words {
    radius: "rayon √(f / f max)",
    largest: "f max",
    no_lobe: "aucun lobe",
    light_from: "lumière de",
    above: "dessus",
    below: "dessous",
    hemispheres: "f vers chaque direction, vu d'en haut ; anneau : la lumière ; couleurs sur quatre puissances de dix",
};

/// The drawing of a material.
pub fn svg(material: &Material, title: &str, plot: Plot, words: Words) -> String {
    let mut body = String::new();
    let mut y = 44.0;
    if plot != Plot::Hemisphere {
        y = polar(&mut body, material, y, words);
    }
    if plot != Plot::Polar {
        y = hemispheres(&mut body, material, y, words);
    }
    let title = title.replace('&', "&amp;").replace('<', "&lt;");
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {y:.0}\" width=\"{WIDTH}\" height=\"{y:.0}\" \
         font-family=\"sans-serif\" font-size=\"13\">\n<rect width=\"100%\" height=\"100%\" fill=\"#FFFFFF\"/>\n\
         <text x=\"20\" y=\"26\" font-size=\"16\">{title}</text>\n{body}</svg>\n"
    )
}

/// f in the green channel, with the light at `theta` on the side of φ = 180°.
fn value(material: &Material, theta: f64, to: Angles) -> f64 {
    let from = Angles { theta, phi: 180.0 };
    f64::from(material.eval(to.direction(), from.direction(), TransportMode::Radiance).0[1])
}

/// Angles between the steps of a curve, fine enough for narrow lobes.
fn curve(material: &Material, theta: f64, below: bool) -> Vec<(f64, f64)> {
    let end = if below { 180.0 } else { 90.0 };
    let steps = 1440;
    let at = |i: i32| {
        let t = end * f64::from(i) / f64::from(steps);
        let to = Angles { theta: t.abs().min(179.999), phi: if t < 0.0 { 180.0 } else { 0.0 } };
        (t, value(material, theta, to))
    };
    (-steps..=steps).map(at).filter(|(_, f)| f.is_finite()).collect()
}

/// Curves of √f around the point of incidence, each over its own largest value; returns where it ends.
fn polar(out: &mut String, material: &Material, top: f64, words: Words) -> f64 {
    let below = material.transmits();
    let (cx, cy) = (POLAR_RADIUS + 60.0, top + POLAR_RADIUS + 20.0);
    let bottom = if below { cy + POLAR_RADIUS } else { cy };
    let place =
        |t: f64, r: f64| (cx + POLAR_RADIUS * r * t.to_radians().sin(), cy - POLAR_RADIUS * r * t.to_radians().cos());
    // Writing to a string cannot fail.
    for r in [0.25, 0.5, 0.75, 1.0] {
        let radius = POLAR_RADIUS * r;
        let arc = if below {
            format!(
                "<circle cx=\"{cx}\" cy=\"{cy}\" r=\"{radius}\" fill=\"none\" stroke=\"#808080\" stroke-opacity=\"0.35\"/>"
            )
        } else {
            let (x0, x1) = (cx - radius, cx + radius);
            format!(
                "<path d=\"M{x0} {cy}A{radius} {radius} 0 0 1 {x1} {cy}\" fill=\"none\" stroke=\"#808080\" stroke-opacity=\"0.35\"/>"
            )
        };
        let _ = writeln!(out, "{arc}");
    }
    for t in [-60.0, -30.0, 0.0, 30.0, 60.0] {
        let ((x, y), (tx, ty)) = (place(t, 1.0), place(t, 1.045));
        let _ = writeln!(
            out,
            "<line x1=\"{cx}\" y1=\"{cy}\" x2=\"{x:.1}\" y2=\"{y:.1}\" stroke=\"#808080\" stroke-opacity=\"0.35\"/>"
        );
        let _ = writeln!(
            out,
            "<text x=\"{tx:.1}\" y=\"{:.1}\" text-anchor=\"middle\" fill=\"#808080\">{:.0}°</text>",
            ty + 4.0,
            f64::abs(t)
        );
    }
    let (left, right) = (cx - POLAR_RADIUS - 20.0, cx + POLAR_RADIUS + 20.0);
    let _ = writeln!(out, "<line x1=\"{left}\" y1=\"{cy}\" x2=\"{right}\" y2=\"{cy}\" stroke=\"#000000\"/>");
    let legend = cx + POLAR_RADIUS + 40.0;
    let _ = writeln!(out, "<text x=\"{legend}\" y=\"{:.0}\">{}</text>", top + 20.0, words.radius);
    for (i, (theta, color)) in LIGHTS.into_iter().enumerate() {
        let points = curve(material, theta, below);
        let largest = points.iter().fold(0.0, |m: f64, (_, f)| m.max(*f));
        let y = top + 48.0 + 22.0 * i as f64;
        let of_lobe =
            if largest > 0.0 { format!("{} {}", words.largest, rounded(largest)) } else { words.no_lobe.into() };
        let _ = writeln!(out, "<rect x=\"{legend}\" y=\"{:.0}\" width=\"14\" height=\"4\" fill=\"{color}\"/>", y - 7.0);
        let (x, from) = (legend + 22.0, words.light_from);
        let _ = writeln!(out, "<text x=\"{x:.0}\" y=\"{y:.0}\">{from} {theta:.0}°, {of_lobe}</text>");
        // Where the light comes from.
        let ((x0, y0), (x1, y1)) = (place(-theta, 1.02), place(-theta, 0.92));
        let _ = writeln!(
            out,
            "<line x1=\"{x0:.1}\" y1=\"{y0:.1}\" x2=\"{x1:.1}\" y2=\"{y1:.1}\" stroke=\"{color}\" stroke-width=\"3\"/>"
        );
        if largest > 0.0 {
            let path = points.iter().map(|(t, f)| {
                let (x, y) = place(*t, (f / largest).sqrt());
                format!("{x:.1} {y:.1}")
            });
            let path = path.collect::<Vec<_>>().join("L");
            let _ = writeln!(
                out,
                "<path d=\"M{path}Z\" fill=\"{color}\" fill-opacity=\"0.08\" stroke=\"{color}\" stroke-width=\"1.6\"/>"
            );
        }
    }
    bottom + 40.0
}

/// Three digits.
fn rounded(x: f64) -> String {
    if (0.01..1e4).contains(&x) { format!("{x:.3}") } else { format!("{x:.2e}") }
}

/// Disks in orthographic projection, in colours of log f; returns where they end.
fn hemispheres(out: &mut String, material: &Material, top: f64, words: Words) -> f64 {
    let sides: &[(bool, &str)] =
        if material.transmits() { &[(false, words.above), (true, words.below)] } else { &[(false, words.above)] };
    let mut y = top + 20.0;
    let _ = writeln!(out, "<text x=\"20\" y=\"{y:.0}\">{}</text>", words.hemispheres);
    for (below, name) in sides {
        let cy = y + DISK_RADIUS + 34.0;
        for (i, (theta, _)) in LIGHTS.into_iter().enumerate() {
            let cx = 20.0 + DISK_RADIUS + i as f64 * (2.0 * DISK_RADIUS + 20.0);
            disk(out, material, theta, *below, [cx, cy]);
            let _ = writeln!(
                out,
                "<text x=\"{cx}\" y=\"{:.0}\" text-anchor=\"middle\">{name}, {} {theta:.0}°</text>",
                cy - DISK_RADIUS - 10.0,
                words.light_from
            );
        }
        y = cy + DISK_RADIUS + 10.0;
    }
    y + 14.0
}

fn disk(out: &mut String, material: &Material, theta: f64, below: bool, [cx, cy]: [f64; 2]) {
    const RINGS: usize = 36;
    const SECTORS: usize = 96;
    let angle = |ring: f64| {
        let t = 90.0 * ring / RINGS as f64;
        if below { 180.0 - t } else { t }
    };
    let phi = |sector: f64| 360.0 * sector / SECTORS as f64;
    let at = |ring: usize, sector: usize| {
        let to = Angles { theta: angle(ring as f64 + 0.5), phi: phi(sector as f64 + 0.5) };
        value(material, theta, to)
    };
    let values: Vec<f64> = (0..RINGS * SECTORS).map(|i| at(i / SECTORS, i % SECTORS)).collect();
    let largest = values.iter().copied().filter(|f| f.is_finite()).fold(0.0, f64::max);
    let _ = writeln!(out, "<circle cx=\"{cx}\" cy=\"{cy}\" r=\"{DISK_RADIUS}\" fill=\"{}\"/>", colour(0.0));
    // Smoothed edges of neighbours would let what is below shine through.
    out.push_str("<g shape-rendering=\"crispEdges\">\n");
    for (i, f) in values.iter().enumerate() {
        let shade = if *f > 0.0 && largest > 0.0 { 1.0 + (f / largest).log10() / DECADES } else { 0.0 };
        if shade <= 0.0 {
            continue;
        }
        let (ring, sector) = ((i / SECTORS) as f64, (i % SECTORS) as f64);
        let corner = |ring: f64, sector: f64| {
            let (r, p) = (DISK_RADIUS * angle(ring).to_radians().sin(), phi(sector).to_radians());
            format!("{:.1} {:.1}", cx + r * p.cos(), cy - r * p.sin())
        };
        // A little wider than its share, so that no gaps show between neighbours.
        let (end, width) = ((ring + 1.05).min(RINGS as f64), sector + 1.05);
        let _ = writeln!(
            out,
            "<path d=\"M{}L{}L{}L{}Z\" fill=\"{}\"/>",
            corner(ring, sector),
            corner(end, sector),
            corner(end, width),
            corner(ring, width),
            colour(shade)
        );
    }
    out.push_str("</g>\n");
    let x = cx - DISK_RADIUS * theta.to_radians().sin();
    let _ =
        writeln!(out, "<circle cx=\"{x:.1}\" cy=\"{cy}\" r=\"4\" fill=\"none\" stroke=\"white\" stroke-width=\"2\"/>");
}

/// From dark blue over magenta and orange to light yellow.
fn colour(x: f64) -> String {
    const STOPS: [[f64; 3]; 5] =
        [[16.0, 16.0, 48.0], [90.0, 25.0, 120.0], [190.0, 55.0, 100.0], [245.0, 140.0, 50.0], [253.0, 245.0, 180.0]];
    let x = x.clamp(0.0, 1.0) * (STOPS.len() - 1) as f64;
    let i = (x as usize).min(STOPS.len() - 2);
    let mix = |c: usize| STOPS[i][c] + (STOPS[i + 1][c] - STOPS[i][c]) * (x - i as f64);
    format!("#{:02x}{:02x}{:02x}", mix(0) as u8, mix(1) as u8, mix(2) as u8)
}
