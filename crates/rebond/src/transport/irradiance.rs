//! Irradiance from unoccluded lights of radiance 1, in closed form and f64: what estimators are judged by.
//!
//! Times the radiance it is irradiance; over π, the form factor from a surface element to the light. Each light shines
//! to both sides, and is cut off at the receiver's horizon.

use glam::DVec3;
use std::f64::consts::PI;

/// From a simple flat polygon, at `p` on a surface with unit normal `n`: Lambert's formula (Lambert 1760; Arvo, thesis,
/// 1995, §2.2.5),
///
/// ```text
/// E = ½ |Σ Θᵢ n·Γᵢ|
/// ```
///
/// with Θᵢ the angle that edge i fills as seen from p, and Γᵢ the unit normal of the plane through p and the edge. Zero at
/// points in the polygon's own plane.
pub fn from_polygon(p: DVec3, n: DVec3, vertices: &[DVec3]) -> f64 {
    // The part above the horizon. Edges that run along the horizon twice, to and fro, cancel out.
    let mut above = Vec::with_capacity(vertices.len() + 2);
    for (i, v) in vertices.iter().enumerate() {
        let (a, b) = (*v - p, vertices[(i + 1) % vertices.len()] - p);
        let (ha, hb) = (a.dot(n), b.dot(n));
        if ha >= 0.0 {
            above.push(a);
        }
        if (ha < 0.0) != (hb < 0.0) && ha != 0.0 && hb != 0.0 {
            above.push((a * hb - b * ha) / (hb - ha));
        }
    }
    let sum = (0..above.len()).fold(0.0, |sum, i| {
        let (a, b) = (above[i], above[(i + 1) % above.len()]);
        let across = a.cross(b);
        let sin = across.length();
        // An edge that points at p fills no angle.
        if sin > 0.0 { sum + sin.atan2(a.dot(b)) * across.dot(n) / sin } else { sum }
    });
    0.5 * sum.abs()
}

/// From a sphere, at `p` on a surface with unit normal `n`: `π sin²σ cosθ` where all of it is above the horizon, with σ
/// its angular radius and θ the angle to its centre; what remains of that where the horizon cuts it (Snyder, "Area Light
/// Sources for Real-Time Graphics", 1996); π within it.
pub fn from_sphere(p: DVec3, n: DVec3, center: DVec3, radius: f64) -> f64 {
    let to = center - p;
    let distance = to.length();
    if distance <= radius {
        return PI;
    }
    let (sin_sigma, cos) = (radius / distance, n.dot(to) / distance);
    let sin2 = sin_sigma * sin_sigma;
    if cos.abs() >= sin_sigma {
        return PI * sin2 * cos.max(0.0);
    }
    let (sin, cot_sigma) = ((1.0 - cos * cos).sqrt(), (1.0 - sin2).sqrt() / sin_sigma);
    let y = -cot_sigma * cos / sin;
    let root = sin * (1.0 - y * y).max(0.0).sqrt();
    (cos * y.clamp(-1.0, 1.0).acos() - cot_sigma * root) * sin2 + (root / cot_sigma).atan()
}

/// From a disk of this radius in a plane parallel to the receiver's at distance `height`, its axis `offset` away
/// (Howell's catalogue of radiation configuration factors, B-12).
pub fn from_parallel_disk(height: f64, offset: f64, radius: f64) -> f64 {
    let (h2, a2, r2) = (height * height, offset * offset, radius * radius);
    let z = h2 + a2 + r2;
    PI * 0.5 * (1.0 + (r2 - h2 - a2) / (z * z - 4.0 * r2 * a2).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Midpoint rule over a triangle of `sides`², signed by `axis` so that a fan covers polygons that are not convex.
    fn over_triangle(f: &impl Fn(DVec3, DVec3) -> f64, [a, b, c]: [DVec3; 3], axis: DVec3, side: usize) -> f64 {
        let area = (b - a).cross(c - a) * 0.5;
        let cell = area.dot(axis) / (side * side) as f64;
        let mut sum = 0.0;
        for i in 0..side {
            for j in 0..side - i {
                let at = |third: f64| {
                    let (x, y) = ((i as f64 + third) / side as f64, (j as f64 + third) / side as f64);
                    f(a + (b - a) * x + (c - a) * y, axis)
                };
                sum += at(1.0 / 3.0) + if i + j + 1 < side { at(2.0 / 3.0) } else { 0.0 };
            }
        }
        sum * cell
    }

    /// ∫ cosθ cosθ' / d² dA over what lies above the horizon.
    fn quadrature(p: DVec3, n: DVec3, vertices: &[DVec3]) -> f64 {
        let normal = (2..vertices.len())
            .map(|i| (vertices[i - 1] - vertices[0]).cross(vertices[i] - vertices[0]))
            .sum::<DVec3>()
            .normalize();
        let f = |x: DVec3, axis: DVec3| {
            let to = x - p;
            let d2 = to.length_squared();
            to.dot(n).max(0.0) * to.dot(axis).abs() / (d2 * d2)
        };
        (2..vertices.len()).map(|i| over_triangle(&f, [vertices[0], vertices[i - 1], vertices[i]], normal, 1000)).sum()
    }

    fn check(name: &str, closed: f64, quadrature: f64) {
        // A thousandth of the size as step, squared, times a curvature.
        assert!((closed - quadrature).abs() < 2e-5 * quadrature + 1e-9, "{name}: {closed}, quadrature {quadrature}");
    }

    #[test]
    fn lamberts_formula_is_the_integral() {
        let v = DVec3::new;
        let triangle = [v(1.0, 0.2, 1.0), v(-0.5, 1.3, 1.4), v(-0.3, -0.8, 0.9)];
        let arrow = [v(-1.0, -1.0, 1.5), v(0.0, -0.2, 1.5), v(1.0, -1.0, 1.5), v(0.0, 1.5, 1.5)];
        let ell = [
            v(0.0, 0.0, 2.0),
            v(2.0, 0.0, 2.0),
            v(2.0, 1.0, 2.0),
            v(1.0, 1.0, 2.0),
            v(1.0, 2.0, 2.0),
            v(0.0, 2.0, 2.0),
        ];
        let normals =
            [DVec3::Z, v(0.6, 0.0, 0.8), v(1.0, 0.0, 0.1).normalize(), v(-0.3, 0.9, -0.2).normalize(), DVec3::X];
        for p in [DVec3::ZERO, v(0.4, 0.3, 0.2), v(2.0, -1.0, 0.5), v(0.1, 0.2, 3.0)] {
            let mut cut = 0;
            for n in normals {
                for (name, polygon) in [("triangle", &triangle[..]), ("arrow", &arrow), ("ell", &ell)] {
                    let closed = from_polygon(p, n, polygon);
                    check(&format!("{name} at {p}, normal {n}"), closed, quadrature(p, n, polygon));
                    let below = polygon.iter().filter(|v| (**v - p).dot(n) < 0.0).count();
                    cut += usize::from(below > 0 && below < polygon.len());
                    // Seen from the other side it is the same light.
                    let backwards: Vec<DVec3> = polygon.iter().rev().copied().collect();
                    assert!((from_polygon(p, n, &backwards) - closed).abs() < 1e-14);
                }
            }
            assert!(cut >= 3, "no horizon was crossed at {p}");
        }
        assert_eq!(from_polygon(DVec3::ZERO, DVec3::NEG_Z, &triangle), 0.0);
        // All of the upper half space, nearly.
        let huge = [v(-1e9, -1e9, 1.0), v(1e9, -1e9, 1.0), v(1e9, 1e9, 1.0), v(-1e9, 1e9, 1.0)];
        assert!((from_polygon(DVec3::ZERO, DVec3::Z, &huge) - PI).abs() < 1e-12);
    }

    #[test]
    fn a_sphere_is_the_integral_over_its_cone() {
        for distance in [1.05, 1.5, 4.0, 30.0] {
            for degrees in [0.0, 30.0, 60.0, 80.0, 89.0, 90.0, 92.0, 100.0, 120.0, 170.0] {
                let angle = f64::to_radians(degrees);
                let n = DVec3::new(angle.sin(), 0.0, angle.cos());
                let center = DVec3::new(0.3, -0.2, 0.1 + distance);
                let (rows, columns) = (1000, 1000);
                let edge = 1.0 - (1.0 - 1.0 / (distance * distance)).sqrt();
                let mut sum = 0.0;
                for i in 0..rows {
                    let cos = 1.0 - edge * (i as f64 + 0.5) / rows as f64;
                    let sin = (1.0 - cos * cos).sqrt();
                    for j in 0..columns {
                        let phi = (j as f64 + 0.5) / columns as f64 * PI;
                        sum += (n.x * sin * phi.cos() + n.z * cos).max(0.0);
                    }
                }
                let quadrature = sum * 2.0 * PI * edge / (rows * columns) as f64;
                let closed = from_sphere(DVec3::new(0.3, -0.2, 0.1), n, center, 1.0);
                check(&format!("{degrees}° at {distance}"), closed, quadrature);
            }
        }
        assert_eq!(from_sphere(DVec3::ZERO, DVec3::X, DVec3::new(0.2, 0.1, 0.3), 1.0), PI);
    }

    #[test]
    fn a_disk_is_the_limit_of_polygons() {
        // The polygon of k corners with the disk's area differs by a share of order 1/k².
        let corners = 100_000;
        let turn = 2.0 * PI / f64::from(corners);
        for (h, a, r) in [(1.0, 0.0, 1.0), (0.5, 0.3, 1.0), (2.0, 3.0, 0.7), (0.2, 1.0, 1.0)] {
            let grown = r * (turn / turn.sin()).sqrt();
            let corner =
                |i: u32| DVec3::new(a + grown * (f64::from(i) * turn).cos(), grown * (f64::from(i) * turn).sin(), h);
            let polygon: Vec<DVec3> = (0..corners).map(corner).collect();
            let (limit, closed) = (from_polygon(DVec3::ZERO, DVec3::Z, &polygon), from_parallel_disk(h, a, r));
            assert!((limit / closed - 1.0).abs() < 1e-8, "{h}, {a}, {r}: {closed}, polygon {limit}");
        }
    }
}
