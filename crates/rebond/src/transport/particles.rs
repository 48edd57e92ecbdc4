//! Particles of light where they landed, and those that a vertex of the eye's walk may be merged with.

use super::point_grid::Query;
use super::{Placed, PointGrid, Vertex};
use crate::math::{Rgb, Vec3};
use rebond_lanes::{Mask, Real, prefetch};

/// A particle of light on a surface: a vertex of a walk, or what is kept of it.
#[derive(Clone, Copy, Debug, Default)]
pub struct Particle {
    /// Where.
    pub p: [f32; 3],
    /// Segments of its path of light.
    pub segments: u32,
    /// Unit direction to where it came from.
    pub w: [f32; 3],
    /// A of the vertex; 0 if nothing is weighed.
    pub near: f32,
    /// What it carries, in W; the mean over all walks is light.
    pub power: [f32; 3],
    /// B of the vertex.
    pub far: f32,
}

impl Placed for Particle {
    fn place(&self) -> [f32; 3] {
        self.p
    }
}

impl Particle {
    /// Keeps the vertices of the lanes of `mask`, after so many segments.
    pub fn keep<F: Real>(vertex: &Vertex<'_, F>, segments: u32, mask: F::Mask, mut keep: impl FnMut(usize, Self)) {
        let mut lanes = mask.bits();
        while lanes != 0 {
            let lane = lanes.trailing_zeros() as usize % F::LANES;
            lanes &= lanes - 1;
            let kept = Self {
                p: vertex.surface.p.lane(lane),
                segments,
                w: vertex.surface.wo.lane(lane),
                near: vertex.near.lane(lane),
                power: vertex.throughput.lane(lane),
                far: vertex.far.lane(lane),
            };
            keep(lane, kept);
        }
    }
}

/// Particles near vertices, one of each lane.
#[derive(Clone, Copy, Debug)]
pub struct Near<F: Real> {
    /// Unit direction to where it came from.
    pub w: Vec3<F>,
    /// What it carries.
    pub power: Rgb<F>,
    /// A and B of its vertex.
    pub sums: [F; 2],
    /// The square of its distance.
    pub squared: F,
    /// Lanes that have one.
    pub mask: F::Mask,
}

impl<F: Real> Near<F> {
    /// What a vertex whose BSDF is `f` from here reflects of the flux. Flux is that through the surface as it is, radiance is
    /// reflected by the surface as it is shaded: so cosines differ.
    #[inline(always)]
    pub fn reflected(&self, vertex: &Vertex<'_, F>, f: Rgb<F>) -> Rgb<F> {
        let factor = (vertex.bsdf.normal().dot(self.w) / vertex.surface.ng.dot(self.w)).abs();
        (f * self.power * factor).masked(self.mask & factor.is_finite())
    }
}

/// Numbers of a [`Near`].
const COLUMNS: usize = 9;

/// Finds particles, lane by lane, and hands them out side by side. In three steps, between which there should be other work to
/// do: memory is slow.
#[derive(Debug, Default)]
pub struct Neighbours {
    /// Lanes, and what they ask.
    queries: Vec<(u32, Query)>,
    /// Lane, number and squared distance of those found.
    found: Vec<(u32, u32, f32)>,
    /// Row i has the i-th of each lane.
    rows: Vec<[[f32; 16]; COLUMNS]>,
}

impl Neighbours {
    /// Asks for what is within the radius of vertices at `p`.
    #[inline(always)]
    pub fn ask<F: Real>(&mut self, grid: &PointGrid<Particle>, p: Vec3<F>, mask: F::Mask) {
        let (bits, queries) = (mask.bits(), &mut self.queries);
        queries.clear();
        queries.extend((0..F::LANES).filter(|lane| bits >> lane & 1 == 1).map(|l| (l as u32, grid.ask(p.lane(l)))));
    }

    /// Goes on.
    #[inline(always)]
    pub fn find(&mut self, grid: &PointGrid<Particle>) {
        self.queries.iter_mut().for_each(|(_, query)| grid.find(query));
    }

    /// Calls `f` with the particles that were found whose paths have at most `longest` segments.
    #[inline(always)]
    pub fn each<F: Real>(&mut self, grid: &PointGrid<Particle>, longest: u32, mut f: impl FnMut(&Near<F>)) {
        self.found.clear();
        for (lane, query) in &self.queries {
            grid.within(query, |item, squared| {
                let particle = grid.item(item);
                prefetch(&particle.segments);
                prefetch(&particle.far);
                self.found.push((*lane, item, squared));
            });
        }
        let mut counts = [0; 16];
        for (lane, item, squared) in &self.found {
            let (particle, lane) = (grid.item(*item), *lane as usize % 16);
            let row = counts[lane];
            if particle.segments <= longest {
                counts[lane] += 1;
                grid.use_item(*item);
            }
            if row == self.rows.len() {
                self.rows.push([[0.0; 16]; COLUMNS]);
            }
            let ([x, y, z], [r, g, b]) = (particle.w, particle.power);
            let numbers = [x, y, z, r, g, b, particle.near, particle.far, *squared];
            self.rows[row].iter_mut().zip(numbers).for_each(|(column, number)| column[lane] = number);
        }
        let most = counts.into_iter().max().unwrap_or(0);
        for (number, row) in self.rows[..most].iter().enumerate() {
            let present = counts[..F::LANES].iter().rev().fold(0, |bits, n| bits << 1 | u32::from(*n > number));
            let [x, y, z, r, g, b, near, far, squared] = row.map(|column| F::load(&column));
            f(&Near {
                w: Vec3 { x, y, z },
                power: Rgb::new(r, g, b),
                sums: [near, far],
                squared,
                mask: F::Mask::from_bits(present),
            });
        }
    }
}
