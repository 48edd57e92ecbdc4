//! Particles of light where they landed, and those that a vertex of the eye's walk may be merged with.

use super::{Placed, PointGrid, Vertex};
use crate::bsdf::TransportMode;
use crate::math::{Rgb, Vec3};
use rebond_lanes::{Mask, Real};

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
    /// What a vertex reflects of the flux, and the density with which the eye's walk would go on to where it came from. Flux is
    /// that through the surface as it is, radiance is reflected by the surface as it is shaded: so cosines differ.
    #[inline(always)]
    pub fn reflected(&self, vertex: &Vertex<'_, F>) -> (Rgb<F>, F) {
        let value = vertex.bsdf.eval(vertex.surface.wo, self.w, TransportMode::Radiance, self.mask);
        let factor = (vertex.bsdf.normal().dot(self.w) / vertex.surface.ng.dot(self.w)).abs();
        let light = value.f * self.power * factor;
        (light.masked(self.mask & factor.is_finite()), value.pdf.0)
    }
}

/// Numbers of a [`Near`].
const COLUMNS: usize = 9;

/// Finds particles, lane by lane, and hands them out side by side.
#[derive(Debug, Default)]
pub struct Neighbours {
    found: Vec<[f32; COLUMNS]>,
}

impl Neighbours {
    /// Calls `f` with the particles within the radius of vertices at `p`, whose paths have at most `longest` segments.
    #[inline(always)]
    pub fn each<F: Real>(
        &mut self,
        grid: &PointGrid<Particle>,
        p: Vec3<F>,
        longest: u32,
        mask: F::Mask,
        mut f: impl FnMut(&Near<F>),
    ) {
        self.found.clear();
        let mut ends = [0; 16];
        let lanes = mask.bits();
        for (lane, end) in ends[..F::LANES].iter_mut().enumerate() {
            if lanes >> lane & 1 == 1 {
                grid.within(p.lane(lane), |particle, squared| {
                    if particle.segments <= longest {
                        let ([x, y, z], [r, g, b]) = (particle.w, particle.power);
                        self.found.push([x, y, z, r, g, b, particle.near, particle.far, squared]);
                    }
                });
            }
            *end = self.found.len();
        }
        let first = |lane: usize| if lane == 0 { 0 } else { ends[lane - 1] };
        let most = (0..F::LANES).map(|lane| ends[lane] - first(lane)).max().unwrap_or(0);
        for number in 0..most {
            let mut columns = [[0.0; 16]; COLUMNS];
            let mut present = 0_u32;
            for lane in 0..F::LANES {
                let at = first(lane) + number;
                if at < ends[lane] {
                    present |= 1 << lane;
                    columns.iter_mut().zip(self.found[at]).for_each(|(column, x)| column[lane] = x);
                }
            }
            let [x, y, z, r, g, b, near, far, squared] = columns.map(|column| F::load(&column));
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
