//! Instances: rays brought into a geometry's space.

use crate::build::bounds::Bounds;
use crate::{Affine, BuildError, Instance};

/// A geometry put somewhere.
#[derive(Clone, Debug)]
pub(crate) struct Placed {
    pub geometry: u32,
    motion: Motion,
}

#[derive(Clone, Debug)]
enum Motion {
    Identity,
    /// World to object.
    Still([[f64; 4]; 3]),
    /// Object to world.
    Moving(Vec<(f32, Affine)>),
}

const IDENTITY: Affine = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];

fn determinant(m: &[[f64; 4]; 3]) -> f64 {
    m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[2][1]) - m[0][1] * (m[1][0] * m[2][2] - m[1][2] * m[2][0])
        + m[0][2] * (m[1][0] * m[2][1] - m[1][1] * m[2][0])
}

fn inverse(m: &[[f64; 4]; 3]) -> Option<[[f64; 4]; 3]> {
    let det = determinant(m);
    if !(det != 0.0 && (1.0 / det).is_finite()) {
        return None;
    }
    let mut out = [[0.0; 4]; 3];
    for i in 0..3 {
        for j in 0..3 {
            let (a, b, c, d) = ((j + 1) % 3, (j + 2) % 3, (i + 1) % 3, (i + 2) % 3);
            out[i][j] = (m[a][c] * m[b][d] - m[a][d] * m[b][c]) / det;
        }
    }
    for row in &mut out {
        row[3] = -(0..3).map(|k| row[k] * m[k][3]).sum::<f64>();
    }
    Some(out)
}

fn widen(m: &Affine) -> [[f64; 4]; 3] {
    m.map(|row| row.map(f64::from))
}

impl Placed {
    pub fn new(index: usize, instance: &Instance) -> Result<Self, BuildError> {
        let keys = &instance.keyframes;
        let Some((_, first)) = keys.first() else {
            return Err(BuildError::NoKeyframe { instance: index });
        };
        let finite = keys.iter().all(|(time, m)| time.is_finite() && m.iter().flatten().all(|x| x.is_finite()));
        if !finite {
            return Err(BuildError::NonFiniteMatrix { instance: index });
        }
        if keys.windows(2).any(|pair| pair[0].0 >= pair[1].0) {
            return Err(BuildError::KeyframeOrder { instance: index });
        }
        let singular = || BuildError::SingularMatrix { instance: index };
        let side = |m: &Affine| inverse(&widen(m)).map(|_| determinant(&widen(m)) > 0.0);
        let first_side = side(first).ok_or_else(singular)?;
        // A determinant that changes its sign passes through zero.
        if keys.iter().any(|(_, m)| side(m) != Some(first_side)) {
            return Err(singular());
        }
        let motion = if keys.iter().any(|(_, m)| m != first) {
            Motion::Moving(keys.clone())
        } else if *first == IDENTITY {
            Motion::Identity
        } else {
            Motion::Still(inverse(&widen(first)).ok_or_else(singular)?)
        };
        Ok(Self { geometry: instance.geometry, motion })
    }

    pub fn is_identity(&self) -> bool {
        matches!(self.motion, Motion::Identity)
    }

    /// World to object at a time; none where the matrix cannot be inverted.
    #[inline]
    pub fn to_object(&self, time: f32) -> Option<[[f64; 4]; 3]> {
        match &self.motion {
            Motion::Identity => Some(widen(&IDENTITY)),
            Motion::Still(matrix) => Some(*matrix),
            Motion::Moving(keys) => inverse(&at(keys, time)),
        }
    }
}

/// Object to world at a time.
fn at(keys: &[(f32, Affine)], time: f32) -> [[f64; 4]; 3] {
    let next = keys.partition_point(|(t, _)| *t <= time);
    if next == 0 || next == keys.len() {
        return widen(&keys[next.saturating_sub(1)].1);
    }
    let ((t0, a), (t1, b)) = (&keys[next - 1], &keys[next]);
    let w = (f64::from(time) - f64::from(*t0)) / (f64::from(*t1) - f64::from(*t0));
    let (a, b) = (widen(a), widen(b));
    std::array::from_fn(|i| std::array::from_fn(|j| a[i][j] * (1.0 - w) + b[i][j] * w))
}

/// The box in the world of a box that moves, from one time to another; every point moves along straight lines between
/// keyframes.
pub(crate) fn world_bounds(instance: &Instance, (lo, hi): ([f32; 3], [f32; 3]), [from, to]: [f32; 2]) -> Bounds {
    if (0..3).any(|k| lo[k] > hi[k]) {
        return Bounds::EMPTY;
    }
    // An axis that does not count does not, however far the box goes along it.
    let product = |m: f64, x: f32| if m == 0.0 { 0.0 } else { m * f64::from(x) };
    let mut low = [f64::INFINITY; 3];
    let mut high = [f64::NEG_INFINITY; 3];
    let keys = &instance.keyframes;
    let between = keys.iter().filter(|(t, _)| from < *t && *t < to).map(|(_, m)| widen(m));
    for m in between.chain([at(keys, from), at(keys, to)]) {
        for k in 0..3 {
            let (mut a, mut b) = (m[k][3], m[k][3]);
            for j in 0..3 {
                let (x, y) = (product(m[k][j], lo[j]), product(m[k][j], hi[j]));
                a += x.min(y);
                b += x.max(y);
            }
            low[k] = low[k].min(a);
            high[k] = high[k].max(b);
        }
    }
    // Rounded outwards, and a little more for the rounding of rays on their way into the object's space.
    let slack = |a: f64, b: f64| 4.0 * f64::from(f32::EPSILON) * a.abs().max(b.abs());
    let clamp = |x: f64| x.clamp(-f64::from(f32::MAX), f64::from(f32::MAX)) as f32;
    Bounds::new(
        std::array::from_fn(|k| clamp(low[k] - slack(low[k], high[k])).next_down().max(f32::MIN)),
        std::array::from_fn(|k| clamp(high[k] + slack(low[k], high[k])).next_up().min(f32::MAX)),
    )
}

/// A point and a direction through a matrix, rounded once.
#[inline]
pub(crate) fn transform(m: &[[f64; 4]; 3], o: [f32; 3], d: [f32; 3]) -> ([f32; 3], [f32; 3]) {
    let (o, d) = (o.map(f64::from), d.map(f64::from));
    (
        std::array::from_fn(|i| (m[i][0] * o[0] + m[i][1] * o[1] + m[i][2] * o[2] + m[i][3]) as f32),
        std::array::from_fn(|i| (m[i][0] * d[0] + m[i][1] * d[1] + m[i][2] * d[2]) as f32),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn inverse_undoes() {
        let m = [[2.0, 0.5, 0.0, 3.0], [0.0, 1.0, -0.25, -1.0], [1.0, 0.0, 4.0, 2.0]];
        let (o, d) = transform(&m, [1.0, 2.0, 3.0], [0.5, -1.0, 2.0]);
        let (o, d) = transform(&inverse(&m).unwrap(), o, d);
        for k in 0..3 {
            assert!((o[k] - [1.0, 2.0, 3.0][k]).abs() < 1e-6 && (d[k] - [0.5, -1.0, 2.0][k]).abs() < 1e-6);
        }
    }

    #[test]
    fn keyframes() {
        let shifted = |x: f32| [[1.0, 0.0, 0.0, x], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];
        let keys = [(0.0, shifted(0.0)), (1.0, shifted(2.0)), (3.0, shifted(-2.0))];
        for (time, x) in [(-1.0, 0.0), (0.0, 0.0), (0.25, 0.5), (1.0, 2.0), (2.0, 0.0), (9.0, -2.0), (f32::NAN, 0.0)] {
            assert_eq!(at(&keys, time)[0][3], x, "{time}");
        }
        let instance = Instance { geometry: 0, keyframes: keys.to_vec() };
        let always = [f32::NEG_INFINITY, f32::INFINITY];
        let (lo, hi) = world_bounds(&instance, ([-1.0; 3], [1.0; 3]), [0.25, 0.5]).corners();
        assert!(lo[0] <= -0.5 && lo[0] > -0.501 && hi[0] >= 2.0 && hi[0] < 2.001);
        let (lo, hi) = world_bounds(&instance, ([-1.0; 3], [1.0; 3]), [0.5, 2.5]).corners();
        assert!(lo[0] <= -2.0 && lo[0] > -2.001 && hi[0] >= 3.0 && hi[0] < 3.001);
        let (lo, hi) = world_bounds(&instance, ([-1.0; 3], [1.0; 3]), always).corners();
        assert!(lo[0] <= -3.0 && hi[0] >= 3.0 && hi[1] < 1.001);
        assert!(Placed::new(0, &instance).is_ok());
        let (far, none) = (f32::INFINITY, [f32::INFINITY; 3]);
        let (lo, hi) = world_bounds(&instance, ([-1.0, -far, 0.0], [1.0, far, far]), always).corners();
        assert_eq!((lo[1], hi[1], hi[2]), (f32::MIN, f32::MAX, f32::MAX));
        assert!(lo[0] <= -3.0 && lo[0] > -3.001 && hi[0] >= 3.0 && hi[0] < 3.001);
        assert!(world_bounds(&instance, (none, none.map(|x| -x)), always).is_empty());
        let mirrored = [[-1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];
        let bad = Instance { geometry: 0, keyframes: vec![(0.0, IDENTITY), (1.0, mirrored)] };
        assert!(matches!(Placed::new(4, &bad), Err(BuildError::SingularMatrix { instance: 4 })));
    }
}
