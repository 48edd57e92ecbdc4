//! Matrices that move: where things are at several times, linearly interpolated in between.

use super::{Vec3, vec3};
use rebond_lanes::{Index, Mask, Real, Record};

/// The motions of many things, side by side.
#[derive(Clone, Debug, Default)]
pub struct Keyframes {
    /// Per keyframe: [time, –, –, –] and three rows of a matrix.
    table: Vec<Record>,
    /// Keyframes of each thing; all have the same number.
    each: u32,
}

/// A matrix, by rows.
#[derive(Clone, Copy, Debug)]
pub struct Matrix<F: Real>(pub [[F; 4]; 3]);

impl Keyframes {
    /// A table of these motions, each of at least one (time, rows of a matrix).
    pub fn new<'a>(motions: impl Iterator<Item = &'a [(f32, [[f32; 4]; 3])]> + Clone) -> Self {
        let each = motions.clone().map(<[_]>::len).max().unwrap_or(1);
        let mut table = Vec::new();
        for motion in motions {
            for k in 0..each {
                let (time, rows) = motion[k.min(motion.len() - 1)];
                table.push(Record([time, 0.0, 0.0, 0.0]));
                table.extend(rows.map(Record));
            }
        }
        Self { table, each: each as u32 }
    }

    /// The rows of a thing's matrix at its keyframe `k`.
    fn rows(&self, thing: u32, k: u32) -> [[f32; 4]; 3] {
        let at = ((thing * self.each + k) * 4 + 1) as usize;
        std::array::from_fn(|r| self.table[at + r].0)
    }

    /// The rows of a thing's matrix at its first keyframe.
    pub fn first(&self, thing: u32) -> [[f32; 4]; 3] {
        self.rows(thing, 0)
    }

    /// Whether a thing moves.
    pub fn moves(&self, thing: u32) -> bool {
        (1..self.each).any(|k| self.rows(thing, k) != self.rows(thing, 0))
    }

    /// The matrix of each lane's thing at a time.
    #[inline(always)]
    pub fn at<F: Real>(&self, thing: F::Index, time: F, mask: F::Mask) -> Matrix<F> {
        let record = |k: u32, n: u32| {
            F::record(&self.table, thing * F::Index::splat(4 * self.each) + F::Index::splat(4 * k + n))
        };
        let mut rows: [[F; 4]; 3] = std::array::from_fn(|r| record(0, r as u32 + 1));
        for k in 1..self.each {
            let (t0, t1) = (record(k - 1, 0)[0], record(k, 0)[0]);
            let after = time.gt(t0) & t1.gt(t0);
            if (after & mask).none() {
                continue;
            }
            let share = ((time - t0) / (t1 - t0)).clamp(0.0, 1.0);
            for (row, n) in rows.iter_mut().zip(1..) {
                let (a, b) = (record(k - 1, n), record(k, n));
                *row = std::array::from_fn(|c| F::select(after, a[c] + (b[c] - a[c]) * share, row[c]));
            }
        }
        Matrix(rows)
    }
}

impl<F: Real> Matrix<F> {
    fn linear(&self, row: usize) -> Vec3<F> {
        vec3(self.0[row][0], self.0[row][1], self.0[row][2])
    }

    /// Where it takes the origin.
    #[inline(always)]
    pub fn translation(&self) -> Vec3<F> {
        vec3(self.0[0][3], self.0[1][3], self.0[2][3])
    }

    /// Of a vector.
    #[inline(always)]
    pub fn vector(&self, v: Vec3<F>) -> Vec3<F> {
        vec3(self.linear(0).dot(v), self.linear(1).dot(v), self.linear(2).dot(v))
    }

    /// Of a point.
    #[inline(always)]
    pub fn point(&self, p: Vec3<F>) -> Vec3<F> {
        self.vector(p) + self.translation()
    }

    /// The rows of the transposed inverse of the linear part, times its determinant; and the determinant.
    #[inline(always)]
    pub fn cofactors(&self) -> ([Vec3<F>; 3], F) {
        let [a, b, c] = [0, 1, 2].map(|r| self.linear(r));
        let columns = [b.cross(c), c.cross(a), a.cross(b)];
        (columns, a.dot(columns[0]))
    }

    /// The point that it takes to `p`.
    #[inline(always)]
    pub fn point_before(&self, p: Vec3<F>) -> Vec3<F> {
        let ([x, y, z], determinant) = self.cofactors();
        let moved = p - self.translation();
        (x * moved.x + y * moved.y + z * moved.z) * determinant.recip()
    }

    /// Bound of how much longer it makes a vector, in the largest of the coordinates.
    #[inline(always)]
    pub fn stretch(&self) -> F {
        let of_row = |r: usize| {
            let row = self.linear(r);
            row.x.abs() + row.y.abs() + row.z.abs()
        };
        of_row(0).max(of_row(1)).max(of_row(2))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rebond_lanes::scalar::Index1;

    #[test]
    fn between_keyframes_matrices_are_mixed() {
        let scaled = |s: f32, x: f32| [[s, 0.0, 0.0, x], [0.0, s, 0.0, 0.0], [0.0, 0.0, s, 0.0]];
        let moving = [(1.0, scaled(1.0, 0.0)), (2.0, scaled(3.0, 8.0)), (4.0, scaled(3.0, 0.0))];
        let resting = [(0.0, scaled(2.0, 5.0))];
        let table = Keyframes::new([&moving[..], &resting[..]].into_iter());
        for (time, scale, x) in [(0.0, 1.0, 0.0), (1.5, 2.0, 4.0), (2.0, 3.0, 8.0), (3.0, 3.0, 4.0), (9.0, 3.0, 0.0)] {
            let m = table.at::<f32>(Index1(0), time, true);
            let p = m.point(vec3(1.0, 2.0, -1.0));
            assert_eq!(p.array(), [scale + x, 2.0 * scale, -scale], "{time}");
            assert!((m.point_before(p) - vec3(1.0, 2.0, -1.0)).length() < 1e-6);
            assert_eq!(m.stretch(), scale);
            let still = table.at::<f32>(Index1(1), time, true);
            assert_eq!(still.point(vec3(1.0, 0.0, 0.0)).array(), [7.0, 0.0, 0.0], "{time}");
        }
    }
}
