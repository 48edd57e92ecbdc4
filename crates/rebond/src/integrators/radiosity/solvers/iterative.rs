//! Jacobi's and Gauss and Seidel's iterations, over form factors that are stored once for both directions.
//!
//! ```text
//! L_i ← S_i + ρ_i/A_i Σ_j A_i F_ij L_j
//! ```
//!
//! Jacobi takes all L_j of the last round, Gauss and Seidel those of this one where they are known: about half as many
//! rounds. Each round loses what is left of the error to ρ, on average.

use super::{Channels, MOST_ITERATIONS, Problem, add_scaled, dot, gain};
use crate::integrators::radiosity::form_factors::Symmetric;
use crate::render::Observer;
use rayon::prelude::*;

/// Parts that the rows of a matrix are divided into, whatever the number of threads, so that sums are the same.
const PARTS: usize = 32;

/// `S + T L`.
pub fn step(matrix: &Symmetric, problem: &Problem, light: &Channels) -> Channels {
    let n = matrix.side();
    // Of a triangle, equal areas.
    let bound = |p: usize| ((p as f64 / PARTS as f64).sqrt() * n as f64).round() as usize;
    let parts: Vec<Channels> = (0..PARTS)
        .into_par_iter()
        .map(|p| {
            let mut sums = problem.zeros();
            for i in bound(p)..bound(p + 1) {
                let row = matrix.row(i);
                let own = dot(row, light);
                add_scaled(row, [0, 1, 2].map(|c| light[c][i]), &mut sums);
                (0..3).for_each(|c| sums[c][i] += own[c] as f32);
            }
            sums
        })
        .collect();
    let mut next = problem.source.clone();
    for i in 0..n {
        let gain = gain(problem, i);
        for c in 0..3 {
            let arriving: f64 = parts.iter().map(|p| f64::from(p[c][i])).sum();
            next[c][i] += (gain[c] * arriving) as f32;
        }
    }
    next
}

fn change(a: &Channels, b: &Channels) -> f32 {
    let of = |c: usize| a[c].iter().zip(&b[c]).map(|(x, y)| (x - y).abs()).fold(0.0, f32::max);
    (0..3).map(of).fold(0.0, f32::max)
}

/// Jacobi's iteration; with how many rounds it took. None if told to stop.
pub fn jacobi(matrix: &Symmetric, problem: &Problem, observer: &dyn Observer) -> Option<(Channels, u32)> {
    let mut light = problem.source.clone();
    for round in 1..=MOST_ITERATIONS {
        if observer.should_stop() {
            return None;
        }
        let next = step(matrix, problem, &light);
        let changed = change(&next, &light);
        light = next;
        if changed <= problem.threshold(&light) {
            return Some((light, round));
        }
    }
    Some((light, MOST_ITERATIONS))
}

/// Gauss and Seidel's iteration; with how many rounds it took. None if told to stop.
pub fn gauss_seidel(matrix: &Symmetric, problem: &Problem, observer: &dyn Observer) -> Option<(Channels, u32)> {
    let n = matrix.side();
    let mut light = problem.source.clone();
    // What arrives from patches after each one, by their last values.
    let mut later = problem.zeros();
    (0..n).for_each(|i| add_scaled(matrix.row(i), [0, 1, 2].map(|c| light[c][i]), &mut later));
    for round in 1..=MOST_ITERATIONS {
        if observer.should_stop() {
            return None;
        }
        let mut next_later = problem.zeros();
        let mut changed = 0.0_f32;
        for i in 0..n {
            let row = matrix.row(i);
            let (earlier, gain) = (dot(row, &light), gain(problem, i));
            for c in 0..3 {
                let arriving = earlier[c] + f64::from(later[c][i]);
                let value = (f64::from(problem.source[c][i]) + gain[c] * arriving) as f32;
                changed = changed.max((value - light[c][i]).abs());
                light[c][i] = value;
            }
            add_scaled(row, [0, 1, 2].map(|c| light[c][i]), &mut next_later);
        }
        later = next_later;
        if changed <= problem.threshold(&light) {
            return Some((light, round));
        }
    }
    Some((light, MOST_ITERATIONS))
}
