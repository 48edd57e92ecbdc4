//! Form factors between flat surfaces that nothing stands between, in closed form and f64.
//!
//! ```text
//! A₁ F₁₂ = ∫∫ cosθ₁ cosθ₂ / (π d²) dA₁ dA₂ = A₂ F₂₁
//! ```
//!
//! is the share of what surface 1 sends out that surface 2 receives, times the area of 1.

use glam::DVec3;
use std::f64::consts::PI;

/// Points of Gauss and Legendre's rule of five points, and their weights, on [−1, 1].
const GAUSS: [(f64, f64); 5] = [
    (-0.906_179_845_938_664, 0.236_926_885_056_189_1),
    (-0.538_469_310_105_683_1, 0.478_628_670_499_366_5),
    (0.0, 0.568_888_888_888_888_9),
    (0.538_469_310_105_683_1, 0.478_628_670_499_366_5),
    (0.906_179_845_938_664, 0.236_926_885_056_189_1),
];

/// `A₁ F₁₂` of two convex polygons, each counter-clockwise seen from the side it sends to. The part of each that lies
/// behind the other's plane counts nothing, so they may touch or cut one another's plane. Two contour integrals (Sparrow
/// 1963; Goral et al. 1984),
///
/// ```text
/// A₁ F₁₂ = 1/2π ∮ ∮ ln r dx₁·dx₂
/// ```
///
/// the inner in closed form along each edge, the outer by Gauss's rule, halved where it has not settled to 10⁻⁷ of the
/// product of the edges. (Schröder and Hanrahan 1993 have the outer in closed form too, by dilogarithms.)
pub fn between_polygons(a: &[DVec3], b: &[DVec3]) -> f64 {
    let (na, nb) = (normal(a), normal(b));
    let a_seen = in_front(a, b[0], nb);
    let b_seen = in_front(b, a[0], na);
    let edges = |p: &[DVec3]| (0..p.len()).map(|i| (p[i], p[(i + 1) % p.len()])).collect::<Vec<_>>();
    let (a_edges, b_edges) = (edges(&a_seen), edges(&b_seen));
    let mut sum = 0.0;
    for &(p0, p1) in &a_edges {
        for &(q0, q1) in &b_edges {
            let (along, across) = (p1 - p0, q1 - q0);
            let product = along.dot(across);
            let (la, lb) = (along.length(), across.length());
            if la == 0.0 || lb == 0.0 || product.abs() <= 1e-14 * la * lb {
                continue;
            }
            let direction = across / lb;
            let f = |s: f64| mean_log(p0 + along * s, q0, direction, lb);
            sum += product * settled(&f, 0.0, 1.0, gauss(&f, 0.0, 1.0), 1e-7, 16);
        }
    }
    (sum / (2.0 * PI)).max(0.0)
}

/// Twice the area, along the normal.
fn normal(p: &[DVec3]) -> DVec3 {
    (2..p.len()).map(|i| (p[i - 1] - p[0]).cross(p[i] - p[0])).sum()
}

/// The part of a polygon in front of the plane through `q` with normal `n`.
fn in_front(p: &[DVec3], q: DVec3, n: DVec3) -> Vec<DVec3> {
    let height = |v: DVec3| (v - q).dot(n);
    let mut seen = Vec::with_capacity(p.len() + 1);
    for (i, v) in p.iter().enumerate() {
        let next = p[(i + 1) % p.len()];
        let (h, g) = (height(*v), height(next));
        if h >= 0.0 {
            seen.push(*v);
        }
        if (h < 0.0) != (g < 0.0) && h != 0.0 && g != 0.0 {
            seen.push((*v * g - next * h) / (g - h));
        }
    }
    seen
}

/// The mean of ln r between `x` and the edge from `q` along the unit vector `u` for a length `l`.
fn mean_log(x: DVec3, q: DVec3, u: DVec3, l: f64) -> f64 {
    let to = x - q;
    let start = to.dot(u);
    let h2 = (to - u * start).length_squared();
    let h = h2.sqrt();
    let (from, to) = (-start, l - start);
    let up_to = |t: f64| {
        let r2 = t * t + h2;
        if r2 > 0.0 { 0.5 * t * r2.ln() } else { 0.0 }
    };
    // The angle that the edge fills at x.
    let angle = if h > 0.0 { (h * l).atan2(h2 + from * to) } else { 0.0 };
    (up_to(to) - up_to(from) + h * angle) / l - 1.0
}

fn gauss(f: &impl Fn(f64) -> f64, from: f64, to: f64) -> f64 {
    let (middle, half) = (0.5 * (from + to), 0.5 * (to - from));
    GAUSS.iter().map(|(x, w)| w * f(middle + half * x)).sum::<f64>() * half
}

fn settled(f: &impl Fn(f64) -> f64, from: f64, to: f64, whole: f64, tolerance: f64, depth: u32) -> f64 {
    let middle = 0.5 * (from + to);
    let (left, right) = (gauss(f, from, middle), gauss(f, middle, to));
    if depth == 0 || (left + right - whole).abs() <= tolerance {
        return left + right;
    }
    let each = 0.5 * tolerance;
    settled(f, from, middle, left, each, depth - 1) + settled(f, middle, to, right, each, depth - 1)
}

/// `F₁₂` between parallel rectangles of sides `x` and `y` right opposite each other, a distance of 1 apart (Howell's catalogue
/// of radiation configuration factors, C-11).
pub fn parallel_rectangles(x: f64, y: f64) -> f64 {
    let (x2, y2) = (1.0 + x * x, 1.0 + y * y);
    let (rx, ry) = (x2.sqrt(), y2.sqrt());
    let log = 0.5 * (x2 * y2 / (x2 + y2 - 1.0)).ln();
    2.0 / (PI * x * y) * (log + x * ry * (x / ry).atan() + y * rx * (y / rx).atan() - x * x.atan() - y * y.atan())
}

/// `F₁₂` between rectangles at a right angle that share an edge of length 1: from the one of width `w` to that of width `h`
/// (Howell's catalogue, C-14).
pub fn perpendicular_rectangles(w: f64, h: f64) -> f64 {
    let (w2, h2) = (w * w, h * h);
    let r2 = w2 + h2;
    let first = (1.0 + w2) * (1.0 + h2) / (1.0 + r2);
    let second = w2 * (1.0 + r2) / ((1.0 + w2) * r2);
    let third = h2 * (1.0 + r2) / ((1.0 + h2) * r2);
    let logs = 0.25 * (first.ln() + w2 * second.ln() + h2 * third.ln());
    (w * (1.0 / w).atan() + h * (1.0 / h).atan() - r2.sqrt() * (1.0 / r2.sqrt()).atan() + logs) / (PI * w)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::transport::irradiance::from_polygon;

    fn rectangle(corner: DVec3, a: DVec3, b: DVec3) -> [DVec3; 4] {
        [corner, corner + a, corner + a + b, corner + b]
    }

    #[test]
    fn catalogue_values_are_the_textbook_s() {
        assert!((parallel_rectangles(1.0, 1.0) - 0.199_825).abs() < 5e-7);
        assert!((perpendicular_rectangles(1.0, 1.0) - 0.200_044).abs() < 5e-7);
    }

    #[test]
    fn contours_are_the_catalogue() {
        let (x, y, z) = (DVec3::X, DVec3::Y, DVec3::Z);
        for (w, h) in [(1.0, 1.0), (0.2, 3.0), (5.0, 0.7), (0.03, 0.02)] {
            let floor = rectangle(DVec3::ZERO, x * w, y * h);
            let ceiling = rectangle(z, y * h, x * w);
            let (found, known) = (between_polygons(&floor, &ceiling) / (w * h), parallel_rectangles(w, h));
            assert!((found / known - 1.0).abs() < 1e-6, "parallel {w} × {h}: {found}, {known}");
            let wall = rectangle(DVec3::ZERO, y, z * h);
            let floor = rectangle(DVec3::ZERO, x * w, y);
            let (found, known) = (between_polygons(&floor, &wall) / w, perpendicular_rectangles(w, h));
            assert!((found / known - 1.0).abs() < 1e-6, "perpendicular {w}, {h}: {found}, {known}");
            assert!((between_polygons(&wall, &floor) / w - found).abs() < 1e-6 * found);
        }
    }

    #[test]
    fn a_closed_tetrahedron_sends_everything_to_itself() {
        let p = [DVec3::ZERO, DVec3::X * 1.3, DVec3::new(0.2, 0.9, 0.0), DVec3::new(0.3, 0.2, 0.6)];
        let faces = [[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]].map(|f| f.map(|i| p[i]));
        for (i, a) in faces.iter().enumerate() {
            let area = normal(a).length() / 2.0;
            let others = faces.iter().enumerate().filter(|(j, _)| *j != i);
            let sum: f64 = others.map(|(_, b)| between_polygons(a, b) / area).sum();
            assert!((sum - 1.0).abs() < 1e-6, "face {i}: {sum}");
        }
    }

    /// The mean of Lambert's formula over a triangle, from points that are in front of b.
    fn quadrature(a: &[DVec3; 3], b: &[DVec3; 3]) -> f64 {
        let (na, nb) = (normal(a), normal(b));
        let side = 400;
        let (mut sum, mut count) = (0.0, 0);
        for i in 0..side {
            for j in 0..side - i {
                for third in [1.0 / 3.0, 2.0 / 3.0] {
                    let (u, v) = ((f64::from(i) + third) / f64::from(side), (f64::from(j) + third) / f64::from(side));
                    if u + v > 1.0 {
                        continue;
                    }
                    let p = a[0] + (a[1] - a[0]) * u + (a[2] - a[0]) * v;
                    count += 1;
                    if (p - b[0]).dot(nb) > 0.0 {
                        sum += from_polygon(p, na.normalize(), b);
                    }
                }
            }
        }
        sum / f64::from(count) / PI * na.length() / 2.0
    }

    #[test]
    fn contours_are_the_mean_of_lamberts_formula() {
        let v = DVec3::new;
        let a = [v(0.0, 0.0, 0.0), v(1.0, 0.1, 0.0), v(0.2, 0.8, 0.1)];
        // In front of a, through its plane, and with a plane that cuts it; each from both sides.
        for b in [
            [v(0.2, 0.1, 0.9), v(0.4, 1.0, 0.6), v(1.1, 0.2, 0.7)],
            [v(0.5, 0.2, 0.7), v(0.1, 0.6, 0.3), v(1.4, 0.9, -0.4)],
            [v(0.4, -0.5, 0.1), v(0.5, 0.9, 0.4), v(0.3, 0.3, 1.2)],
        ] {
            let sides = [b, [b[0], b[2], b[1]]].map(|b| (between_polygons(&a, &b), quadrature(&a, &b)));
            let most = sides[0].1.max(sides[1].1);
            assert!(most > 0.0);
            for (found, expected) in sides {
                assert!((found - expected).abs() < 2e-4 * most, "{found}, quadrature {expected}, at {b:?}");
            }
        }
    }
}
