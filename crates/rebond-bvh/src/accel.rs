//! The structure that answers ray queries.

use crate::build::bounds::Bounds;
use crate::query::Query;
use crate::tree::{NO_BOUNDS, Tree};
use crate::{Everything, Filter, Geometry, Hit, Instance, Ray, Trace, build, instance};
use instance::Placed;

/// How much time to spend on the tree.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Preset {
    /// Soonest ready: for previews and scenes that change.
    Fast,
    /// The least time for building and a typical picture together.
    #[default]
    Default,
    /// The fastest queries.
    Quality,
}

/// Settings of [`Accel::build`]. Threads come from rayon's current pool; the tree does not depend on their number.
#[derive(Clone, Copy, Debug, Default)]
#[non_exhaustive]
pub struct BuildOptions {
    /// How much time to spend.
    pub preset: Preset,
}

impl BuildOptions {
    /// The default settings with another preset.
    pub fn with_preset(preset: Preset) -> Self {
        Self { preset }
    }
}

/// What [`Accel::build`] met and made.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct BuildReport {
    /// Triangles without area, which no ray hits.
    pub degenerate_triangles: u64,
    /// Triangles with a corner that is NaN or infinite, which no ray hits.
    pub non_finite_triangles: u64,
    /// Spheres and disks that are not finite, or whose radius or normal is not positive; no ray hits them.
    pub invalid_shapes: u64,
    /// Nodes of all trees.
    pub nodes: u64,
    /// Bytes of all trees.
    pub bytes: u64,
}

/// Why there is no [`Accel`].
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum BuildError {
    /// A triangle names a corner that is not there.
    #[error("triangle {triangle} of geometry {geometry} refers to a vertex that is not there")]
    VertexOutOfRange {
        /// Place in the list of geometries.
        geometry: usize,
        /// Place in the geometry's list of triangles.
        triangle: usize,
    },
    /// An instance names a geometry that is not there.
    #[error("instance {instance} refers to geometry {geometry}, which is not there")]
    MissingGeometry {
        /// Place in the list of instances.
        instance: usize,
        /// What it refers to.
        geometry: u32,
    },
    /// An instance has no matrix.
    #[error("instance {instance} has no keyframe")]
    NoKeyframe {
        /// Place in the list of instances.
        instance: usize,
    },
    /// Times do not increase.
    #[error("the keyframes of instance {instance} are not in the order of time")]
    KeyframeOrder {
        /// Place in the list of instances.
        instance: usize,
    },
    /// A matrix cannot be inverted, at a keyframe or between two.
    #[error("the matrix of instance {instance} cannot be inverted at all times")]
    SingularMatrix {
        /// Place in the list of instances.
        instance: usize,
    },
    /// A matrix or a time is NaN or infinite.
    #[error("the matrix of instance {instance} is not finite")]
    NonFiniteMatrix {
        /// Place in the list of instances.
        instance: usize,
    },
    /// More primitives or instances than the tree can number.
    #[error("too many primitives")]
    TooManyPrimitives,
}

/// What the rays meet first.
#[derive(Debug)]
pub(crate) enum World {
    Nothing,
    /// One instance that stays where its geometry is.
    One {
        tree: usize,
        instance: u32,
    },
    /// Trees over the instances.
    Many(Slices),
}

/// A tree over the instances for each of some equal parts of the time in which they move: in a short time they sweep little.
#[derive(Debug)]
pub(crate) struct Slices {
    trees: Vec<Tree>,
    start: f32,
    per_time: f32,
    /// Largest absolute coordinate of all trees.
    pub extent: f32,
    /// Whether a way down one of these trees and down one of an instance's fits into one stack.
    pub in_turns: bool,
}

/// At most so many parts.
const MOST_SLICES: usize = 32;
/// And at most so many boxes in all.
const MOST_BOXES: usize = 1 << 22;
/// Time is cut until instances sweep boxes of at most so many times the surface that they fill at once.
const SWEPT: f64 = 1.5;
/// By how much of its length a part reaches into its neighbours: it is found by rounded numbers.
const OVERLAP: f64 = 1e-3;

impl Slices {
    /// The tree to use at a time.
    #[inline]
    pub fn at(&self, time: f32) -> &Tree {
        let slice = ((time - self.start) * self.per_time) as usize;
        &self.trees[slice.min(self.trees.len() - 1)]
    }

    /// Boxes of instances, none for those without primitives, in each part of the time.
    fn build(instances: &[Instance], trees: &[Tree], preset: Preset) -> Result<Self, BuildError> {
        let times = || instances.iter().filter(|i| i.keyframes.len() > 1).flat_map(|i| i.keyframes.iter().map(|k| k.0));
        let (start, end) = times().fold((f32::INFINITY, f32::NEG_INFINITY), |(a, b), t| (a.min(t), b.max(t)));
        let length = f64::from(end) - f64::from(start);
        let boxes = |from: f64, to: f64| -> Vec<Option<Bounds>> {
            let of = |instance: &Instance| {
                let tree = &trees[instance.geometry as usize];
                tree.root().map(|_| instance::world_bounds(instance, tree.bounds, [from as f32, to as f32]))
            };
            instances.iter().map(of).collect()
        };
        let parts = |n: usize| -> Vec<Vec<Option<Bounds>>> {
            if !(length > 0.0) {
                return vec![boxes(f64::NEG_INFINITY, f64::INFINITY)];
            }
            let at = |x: f64| f64::from(start) + length * x / n as f64;
            (0..n).map(|i| boxes(at(i as f64 - OVERLAP), at(i as f64 + 1.0 + OVERLAP))).collect()
        };
        let area = |parts: &[Vec<Option<Bounds>>]| {
            parts.iter().flatten().flatten().map(|b| f64::from(b.area())).sum::<f64>() / parts.len() as f64
        };
        let mut chosen = parts(1);
        if length > 0.0 {
            // At a few moments.
            let moment = |i: u32| {
                boxes(f64::from(start) + length * f64::from(i) / 4.0, f64::from(start) + length * f64::from(i) / 4.0)
            };
            let at_once = area(&(0..=4).map(moment).collect::<Vec<_>>());
            let most = MOST_SLICES.min(MOST_BOXES / instances.len().max(1));
            while chosen.len() < most && area(&chosen) > SWEPT * at_once {
                chosen = parts(2 * chosen.len());
            }
        }
        let per_time = if length > 0.0 { (chosen.len() as f64 / length) as f32 } else { 0.0 };
        let own = chosen.iter().map(|boxes| build::instances(boxes, preset)).collect::<Result<Vec<_>, _>>()?;
        let places = |trees: &[Tree]| trees.iter().map(|tree| tree.places).max().unwrap_or(0);
        let in_turns = places(&own) + 1 + places(trees) <= crate::single::STACK;
        let extent = own.iter().fold(0.0, |extent: f32, tree| extent.max(tree.extent));
        Ok(Self { trees: own, start: if length > 0.0 { start } else { 0.0 }, per_time, extent, in_turns })
    }
}

/// Surfaces, ready to be hit by rays. Immutable and shared between threads.
#[derive(Debug)]
pub struct Accel {
    pub(crate) trees: Vec<Tree>,
    pub(crate) instances: Vec<Placed>,
    pub(crate) world: World,
    bounds: ([f32; 3], [f32; 3]),
}

impl Accel {
    /// Builds the trees over `geometries` and over `instances` of them. Geometry without an instance is never hit.
    ///
    /// # Errors
    /// See [`BuildError`].
    pub fn build(
        geometries: Vec<Geometry>,
        instances: Vec<Instance>,
        options: &BuildOptions,
    ) -> Result<(Self, BuildReport), BuildError> {
        let mut report = BuildReport::default();
        let mut base = 0_usize;
        let mut trees = Vec::with_capacity(geometries.len());
        if u32::try_from(instances.len()).is_err() {
            return Err(BuildError::TooManyPrimitives);
        }
        let mut placed = Vec::with_capacity(instances.len());
        for (i, instance) in instances.iter().enumerate() {
            if instance.geometry as usize >= geometries.len() {
                return Err(BuildError::MissingGeometry { instance: i, geometry: instance.geometry });
            }
            placed.push(Placed::new(i, instance)?);
        }
        for (i, geometry) in geometries.into_iter().enumerate() {
            let first = base;
            base += build::count(&geometry);
            if base > crate::triangle::Block::MAX_PRIMITIVES {
                return Err(BuildError::TooManyPrimitives);
            }
            trees.push(build::geometry(i, &geometry, first as u32, options.preset, &mut report)?);
        }
        let boxes: Vec<_> = instances
            .iter()
            .map(|instance| {
                let tree = &trees[instance.geometry as usize];
                let always = [f32::NEG_INFINITY, f32::INFINITY];
                tree.root().map(|_| instance::world_bounds(instance, tree.bounds, always))
            })
            .collect();
        let bounds = match &*placed {
            [one] if one.is_identity() => trees[one.geometry as usize].bounds,
            _ => boxes.iter().flatten().copied().reduce(|a, b| a.or(&b)).map_or(NO_BOUNDS, |bounds| bounds.corners()),
        };
        let world = match &*placed {
            _ if boxes.iter().flatten().next().is_none() => World::Nothing,
            [one] if one.is_identity() => World::One { tree: one.geometry as usize, instance: 0 },
            _ => World::Many(Slices::build(&instances, &trees, options.preset)?),
        };
        let mut all: Vec<&Tree> = trees.iter().collect();
        if let World::Many(slices) = &world {
            all.extend(&slices.trees);
        }
        report.nodes = all.iter().map(|tree| tree.nodes().len() as u64).sum();
        report.bytes = all.iter().map(|tree| tree.bytes() as u64).sum();
        Ok((Self { trees, instances: placed, world, bounds }, report))
    }

    /// The nearest hit of each lane in `mask`; the other lanes miss. `coherent` says that the lanes' rays start close
    /// together and go much the same way, as camera rays do.
    ///
    /// Of two surfaces at the same distance, the one of lower instance and then lower primitive is hit. Rays that are
    /// not numbers or have no direction miss.
    #[inline]
    pub fn closest<F: Trace>(&self, ray: &Ray<F>, mask: F::Mask, coherent: bool) -> Hit<F> {
        <F as Query>::closest(self, ray, mask, coherent, &Everything)
    }

    /// Which lanes of `mask` hit anything. Whether something within rounding of `tmax` counts is left open.
    #[inline]
    pub fn occluded<F: Trace>(&self, ray: &Ray<F>, mask: F::Mask) -> F::Mask {
        <F as Query>::occluded(self, ray, mask, &Everything)
    }

    /// [`Accel::closest`] among the hits that `filter` keeps.
    #[inline]
    pub fn closest_where<F: Trace>(&self, ray: &Ray<F>, mask: F::Mask, coherent: bool, filter: &impl Filter) -> Hit<F> {
        <F as Query>::closest(self, ray, mask, coherent, filter)
    }

    /// [`Accel::occluded`] by the hits that `filter` keeps.
    #[inline]
    pub fn occluded_where<F: Trace>(&self, ray: &Ray<F>, mask: F::Mask, filter: &impl Filter) -> F::Mask {
        <F as Query>::occluded(self, ray, mask, filter)
    }

    /// The box around everything at all times: its lowest and its highest corner. For an empty scene the lowest is
    /// above the highest.
    pub fn bounds(&self) -> ([f32; 3], [f32; 3]) {
        self.bounds
    }
}
