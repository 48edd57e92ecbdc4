//! One path, told vertex by vertex: what `rebond trace` prints.
//!
//! The reference engine keeps the journal while it runs the very estimator that renders; what only the estimator knows, its
//! weights, it adds itself. Every other render has the journal `()`, which keeps nothing and costs nothing.

use super::path_state::PathState;
use crate::bsdf::Event;
use crate::scene::{Scene, is_hit};
use rebond_bvh::Hit;
use rebond_lanes::{Index, Mask, Real};

/// Who keeps what became of a path.
pub trait Journal {
    /// Lets `write` add to the vertices so far.
    fn write(&mut self, write: impl FnOnce(&mut Vec<Vertex>));
    /// Lets `write` add to the last vertex.
    #[inline(always)]
    fn last(&mut self, write: impl FnOnce(&mut Vertex)) {
        self.write(|vertices| {
            if let Some(vertex) = vertices.last_mut() {
                write(vertex);
            }
        });
    }
}

impl Journal for () {
    #[inline(always)]
    fn write(&mut self, _: impl FnOnce(&mut Vec<Vertex>)) {}
}

impl Journal for Vec<Vertex> {
    fn write(&mut self, write: impl FnOnce(&mut Vec<Vertex>)) {
        write(self);
    }
}

/// A path that was traced once more.
#[derive(Clone, Debug, PartialEq)]
pub struct Story {
    /// Its vertices but for the eye's.
    pub vertices: Vec<Vertex>,
    /// The sample that the film gets: the sum of what the vertices contribute, from the first to the last.
    pub radiance: [f32; 3],
}

/// What a ray of the path met, and what came of it.
#[derive(Clone, Debug, PartialEq)]
pub struct Vertex {
    /// Segments up to here.
    pub depth: u32,
    /// Where the ray started.
    pub origin: [f32; 3],
    /// Its unit direction.
    pub direction: [f32; 3],
    /// Density per solid angle with which the direction was drawn; ∞ if only its sampler finds it.
    pub pdf: f32,
    /// What light that comes along the ray counts.
    pub throughput: [f32; 3],
    /// The surface that it met; none if it left the scene.
    pub place: Option<Place>,
    /// How light was weighed, in the order in which the estimator met it.
    pub weights: Vec<Weight>,
    /// The light that the ray itself brought, weighed.
    pub found: [f32; 3],
    /// The light that was asked whether it comes here.
    pub asked: Option<Asked>,
    /// All that the vertex contributes.
    pub contribution: [f32; 3],
    /// The probability with which Russian roulette let it go on, where it was played.
    pub survival: Option<f32>,
    /// What happened to the light here; none if the path ended.
    pub event: Option<Event>,
}

/// A point of a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// The point.
    pub position: [f32; 3],
    /// Its shading normal.
    pub normal: [f32; 3],
    /// Number of its material.
    pub material: u32,
    /// Whether it is part of a light.
    pub emits: bool,
}

/// A ray towards a light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Asked {
    /// Its unit direction.
    pub direction: [f32; 3],
    /// How far the light is; ∞ for surroundings.
    pub distance: f32,
    /// What it brings if nothing is in the way, weighed.
    pub light: [f32; 3],
    /// Whether something is.
    pub blocked: bool,
}

/// What light counts that can be found in two ways.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Weight {
    /// Whether a ray found it; else a point of the light was drawn.
    pub found: bool,
    /// Density per solid angle of the way that was taken; ∞ if it is the only one.
    pub pdf: f32,
    /// That of the other way.
    pub other: f32,
    /// What it counts.
    pub weight: f32,
}

impl Weight {
    /// Of the first lane.
    pub fn of<F: Real>(found: bool, pdf: F, other: F, weight: F) -> Self {
        Self { found, pdf: pdf.lane(0), other: other.lane(0), weight: weight.lane(0) }
    }
}

impl Vertex {
    /// What the first lane's ray met.
    pub(super) fn new<F: Real>(scene: &Scene, path: &PathState<F>, hit: &Hit<F>) -> Self {
        let found = is_hit(hit);
        let place = (found.bits() & 1 == 1).then(|| {
            let surface = scene.surface(&path.ray(), hit, found);
            Place {
                position: surface.p.lane(0),
                normal: surface.frame.n.lane(0),
                material: surface.material.lane(0),
                emits: surface.is_emitter().bits() & 1 == 1,
            }
        });
        Self {
            depth: path.depth.lane(0),
            origin: path.origin().lane(0),
            direction: path.direction().lane(0),
            pdf: path.pdf.lane(0),
            throughput: path.throughput().lane(0),
            place,
            weights: Vec::new(),
            found: [0.0; 3],
            asked: None,
            contribution: [0.0; 3],
            survival: None,
            event: None,
        }
    }
}
