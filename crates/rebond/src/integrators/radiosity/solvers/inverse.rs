//! The inverse: `L = (I − T)⁻¹ S`, precomputed once, so that other lights need one product.
//!
//! T is not symmetric, but what it is made of is. With `w_i = √(ρ_i/A_i)` and `C_ij = w_i A_i F_ij w_j`,
//!
//! ```text
//! (I − T)⁻¹ = I + W X W⁻¹,    X = (I − C)⁻¹ − I
//! ```
//!
//! and I − C is symmetric and positive definite, since no eigenvalue of C is above the largest ρ: Cholesky's factors take half of
//! the work of LU's, need no pivots, and the inverse of the product is symmetric again, so that half of it is all there is to save.
//! One for each colour: they share F, but no factor of it.
//!
//! The product takes only the columns of patches that shine, which for the usual lamp is a small share of all. W⁻¹ wants
//! ρ > 0: black patches count as of ρ = 10⁻⁴ here, and then reflect nothing.

use super::{Channels, Problem, dot_one};
use crate::integrators::radiosity::form_factors::Symmetric;
use crate::render::Observer;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor::{LltParams, cholesky_in_place, cholesky_in_place_scratch};
use faer::linalg::matmul::triangular::{BlockStructure, matmul};
use faer::linalg::triangular_inverse::invert_lower_triangular;
use faer::prelude::{Reborrow, ReborrowMut};
use faer::{Accum, MatMut, Par, Spec};
use rayon::prelude::*;

/// Reflectance that black counts as.
const BLACK: f32 = 1e-4;
/// Rows of a product that one thread does at a time.
const ROWS: usize = 1024;

/// X of each colour, whole.
#[derive(Clone, Debug, PartialEq)]
pub struct Inverse {
    n: usize,
    columns: [Vec<f32>; 3],
}

/// Bytes of the inverses of all colours, and of what is needed meanwhile by `threads`.
pub fn bytes_of(n: usize, threads: usize) -> u64 {
    4 * (n as u64).pow(2) * (3 + threads.min(3) as u64) + Symmetric::bytes_of(n)
}

fn weights(problem: &Problem, c: usize) -> Vec<f32> {
    let of = |(r, a): (&f32, &f64)| (f64::from(r.max(BLACK)) / a).sqrt() as f32;
    problem.reflectance[c].iter().zip(&problem.areas).map(of).collect()
}

impl Inverse {
    /// Inverts. None if told to stop, or if the matrix is not positive definite, which form factors and reflectances up to 1
    /// can only come to by way of a closed room of ρ = 1.
    pub fn new(matrix: &Symmetric, problem: &Problem, observer: &dyn Observer) -> Option<Self> {
        let columns: Vec<Option<Vec<f32>>> = (0..3)
            .into_par_iter()
            .with_max_len(1)
            .map(|c| if observer.should_stop() { None } else { inverse(matrix, &weights(problem, c)) })
            .collect();
        let columns: Option<Vec<Vec<f32>>> = columns.into_iter().collect();
        Some(Self { n: matrix.side(), columns: columns?.try_into().ok()? })
    }

    /// From what [`Inverse::lower`] gave; none if that is not three triangles of n rows.
    pub fn from_lower(n: usize, lower: [&[f32]; 3]) -> Option<Self> {
        if lower.iter().any(|l| l.len() != n * (n + 1) / 2) {
            return None;
        }
        let columns = lower.map(|l| {
            let mut whole = vec![0.0; n * n];
            let mut rest = l;
            for i in 0..n {
                let (row, others) = rest.split_at(i + 1);
                whole[i * n..i * n + i + 1].copy_from_slice(row);
                rest = others;
            }
            mirror(&mut whole, n);
            whole
        });
        Some(Self { n, columns })
    }

    /// The lower triangle of a colour's X, the diagonal included, row after row.
    pub fn lower(&self, channel: usize) -> impl Iterator<Item = &[f32]> {
        (0..self.n).map(move |i| &self.columns[channel][i * self.n..i * self.n + i + 1])
    }

    /// `(I − T)⁻¹ S`.
    pub fn solve(&self, problem: &Problem) -> Channels {
        std::array::from_fn(|c| {
            let (w, source, n) = (weights(problem, c), &problem.source[c], self.n);
            let shining: Vec<(usize, f32)> =
                source.iter().enumerate().filter(|(_, s)| **s != 0.0).map(|(j, s)| (j, s / w[j])).collect();
            let mut light = vec![0.0; n];
            let matrix = &self.columns[c];
            if shining.len() < n / 4 {
                light.par_chunks_mut(ROWS).enumerate().for_each(|(part, rows)| {
                    let first = part * ROWS;
                    for (j, s) in &shining {
                        let column = &matrix[j * n + first..j * n + first + rows.len()];
                        rows.iter_mut().zip(column).for_each(|(y, x)| *y += x * s);
                    }
                });
            } else {
                // Where most shine, memory is read from one end to the other.
                let mut all = vec![0.0; n];
                shining.iter().for_each(|(j, s)| all[*j] = *s);
                light.par_iter_mut().with_min_len(64).enumerate().for_each(|(i, y)| {
                    *y = dot_one(&matrix[i * n..(i + 1) * n], &all) as f32;
                });
            }
            for i in 0..n {
                let reflected = if problem.reflectance[c][i] > 0.0 { w[i] * light[i] } else { 0.0 };
                light[i] = source[i] + reflected;
            }
            light
        })
    }
}

/// `(I − C)⁻¹ − I`.
fn inverse(matrix: &Symmetric, w: &[f32]) -> Option<Vec<f32>> {
    let n = matrix.side();
    let mut a = vec![0.0_f32; n * n];
    // The lower triangle, column by column.
    for i in 0..n {
        for (j, g) in matrix.row(i).iter().enumerate() {
            a[j * n + i] = -w[i] * g * w[j];
        }
        a[i * n + i] = 1.0;
    }
    let mut memory = MemBuffer::new(cholesky_in_place_scratch::<f32>(n, Par::Seq, Spec::<LltParams, f32>::default()));
    let stack = MemStack::new(&mut memory);
    let mut whole = MatMut::from_column_major_slice_mut(&mut a, n, n);
    cholesky_in_place(whole.rb_mut(), Default::default(), Par::Seq, stack, Spec::default()).ok()?;
    let mut l = vec![0.0_f32; n * n];
    let mut inverted = MatMut::from_column_major_slice_mut(&mut l, n, n);
    invert_lower_triangular(inverted.rb_mut(), whole.rb(), Par::Seq);
    // (L Lᵀ)⁻¹ = L⁻ᵀ L⁻¹
    matmul(
        whole.rb_mut(),
        BlockStructure::TriangularLower,
        Accum::Replace,
        inverted.rb().transpose(),
        BlockStructure::TriangularUpper,
        inverted.rb(),
        BlockStructure::TriangularLower,
        1.0,
        Par::Seq,
    );
    drop(l);
    for i in 0..n {
        a[i * n + i] -= 1.0;
    }
    transpose_lower(&mut a, n);
    Some(a)
}

/// Side of the squares in which matrices are turned, for the cache's sake.
const BLOCK: usize = 64;

/// Copies what stands below the diagonal of columns to above it.
fn transpose_lower(a: &mut [f32], n: usize) {
    for bi in (0..n).step_by(BLOCK) {
        for bj in (0..=bi).step_by(BLOCK) {
            for j in bj..(bj + BLOCK).min(n) {
                for i in bi.max(j + 1)..(bi + BLOCK).min(n) {
                    a[i * n + j] = a[j * n + i];
                }
            }
        }
    }
}

/// The same for what stands before the diagonal of rows.
fn mirror(a: &mut [f32], n: usize) {
    for bi in (0..n).step_by(BLOCK) {
        for bj in (0..=bi).step_by(BLOCK) {
            for i in bi..(bi + BLOCK).min(n) {
                for j in bj..(bj + BLOCK).min(i) {
                    a[j * n + i] = a[i * n + j];
                }
            }
        }
    }
}
