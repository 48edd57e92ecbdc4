//! From surfaces to trees.

pub(crate) mod binned;
pub(crate) mod bounds;
pub(crate) mod collapse;
mod reinsert;
mod spatial;

use crate::node::Child;
use crate::shape::Shape;
use crate::simd::prefetch;
use crate::tree::Tree;
use crate::{BuildError, BuildReport, Geometry, Preset};
use bounds::{Binary, Bounds, Reference};
use collapse::Primitives;
use rayon::prelude::*;

/// A geometry and the number of its first primitive.
struct Surfaces<'a> {
    geometry: &'a Geometry,
    base: u32,
}

impl Surfaces<'_> {
    fn corners(&self, triangle: u32) -> [[f32; 3]; 3] {
        self.geometry.triangles[triangle as usize].map(|i| self.geometry.positions[i as usize])
    }
}

impl Primitives for Surfaces<'_> {
    fn triangle(&self, primitive: u32) -> Option<([[f32; 3]; 3], u32)> {
        ((primitive as usize) < self.geometry.triangles.len()).then(|| (self.corners(primitive), self.base + primitive))
    }
    fn shape(&self, primitive: u32) -> Shape {
        let i = primitive as usize - self.geometry.triangles.len();
        match self.geometry.spheres.get(i) {
            Some(&sphere) => Shape::Sphere(sphere, self.base + primitive),
            None => Shape::Disk(self.geometry.disks[i - self.geometry.spheres.len()], self.base + primitive),
        }
    }
    fn only_triangles(&self) -> bool {
        self.geometry.spheres.is_empty() && self.geometry.disks.is_empty()
    }
    fn prefetch(&self, soon: u32, next: u32) {
        let triangles = &self.geometry.triangles;
        if let (Some(soon), Some(next)) = (triangles.get(soon as usize), triangles.get(next as usize)) {
            prefetch(soon);
            prefetch(&self.geometry.positions[next[0] as usize]);
        }
    }
}

/// What becomes of a triangle.
enum Kind {
    Fine(Bounds),
    Degenerate,
    NonFinite,
}

/// Boxes of coordinates may be as wide as f32 goes; their area is found in f64.
fn classify(corners: [[f32; 3]; 3]) -> Kind {
    if !corners.iter().all(|p| p[0].is_finite() & p[1].is_finite() & p[2].is_finite()) {
        return Kind::NonFinite;
    }
    let edge = |i: usize| -> [f64; 3] { std::array::from_fn(|k| f64::from(corners[i][k]) - f64::from(corners[0][k])) };
    let (a, b) = (edge(1), edge(2));
    if a[1] * b[2] == a[2] * b[1] && a[2] * b[0] == a[0] * b[2] && a[0] * b[1] == a[1] * b[0] {
        return Kind::Degenerate;
    }
    let least = |a: f32, b: f32| if a < b { a } else { b };
    let [p, q, r] = corners;
    let lo = std::array::from_fn(|k| least(least(p[k], q[k]), r[k]));
    let hi = std::array::from_fn(|k| -least(least(-p[k], -q[k]), -r[k]));
    Kind::Fine(Bounds::new(lo, hi))
}

/// A box that may be infinite, as far as f32 goes: the builders want boxes with a centre.
fn within_f32((lo, hi): ([f32; 3], [f32; 3])) -> Bounds {
    Bounds::new(lo.map(|x| x.max(f32::MIN)), hi.map(|x| x.min(f32::MAX)))
}

/// How many primitives a geometry has.
pub(crate) fn count(geometry: &Geometry) -> usize {
    geometry.triangles.len() + geometry.spheres.len() + geometry.disks.len()
}

/// The tree over a geometry whose first primitive has the number `base`.
pub(crate) fn geometry(
    index: usize,
    geometry: &Geometry,
    base: u32,
    preset: Preset,
    report: &mut BuildReport,
) -> Result<Tree, BuildError> {
    let points = geometry.positions.len();
    if let Some(triangle) = geometry.triangles.par_iter().position_first(|t| t.iter().any(|&i| i as usize >= points)) {
        return Err(BuildError::VertexOutOfRange { geometry: index, triangle });
    }
    let surfaces = Surfaces { geometry, base };
    let reference = |i| match classify(surfaces.corners(i)) {
        Kind::Fine(bounds) => Reference::new(bounds, i),
        Kind::Degenerate | Kind::NonFinite => Reference::new(Bounds::EMPTY, i),
    };
    let mut references: Vec<_> = (0..geometry.triangles.len() as u32).into_par_iter().map(reference).collect();
    if references.par_iter().any(|r| r.bounds.is_empty()) {
        references.retain(|r| {
            if r.bounds.is_empty() {
                match classify(surfaces.corners(r.primitive())) {
                    Kind::NonFinite => report.non_finite_triangles += 1,
                    _ => report.degenerate_triangles += 1,
                }
            }
            !r.bounds.is_empty()
        });
    }
    let first = geometry.triangles.len();
    for (i, sphere) in geometry.spheres.iter().enumerate() {
        if sphere.is_valid() {
            references.push(Reference::new(within_f32(sphere.bounds()), (first + i) as u32));
        } else {
            report.invalid_shapes += 1;
        }
    }
    let first = first + geometry.spheres.len();
    for (i, disk) in geometry.disks.iter().enumerate() {
        if disk.is_valid() {
            references.push(Reference::new(within_f32(disk.bounds()), (first + i) as u32));
        } else {
            report.invalid_shapes += 1;
        }
    }
    tree(references, &surfaces, preset)
}

/// Instances, each with its box in the world.
pub(crate) fn instances(boxes: &[Option<Bounds>], preset: Preset) -> Result<Tree, BuildError> {
    struct Placed;
    impl Primitives for Placed {
        fn triangle(&self, _: u32) -> Option<([[f32; 3]; 3], u32)> {
            None
        }
        fn shape(&self, primitive: u32) -> Shape {
            Shape::Instance(primitive)
        }
        fn only_triangles(&self) -> bool {
            false
        }
        fn prefetch(&self, _: u32, _: u32) {}
    }
    let references = boxes.iter().enumerate().filter_map(|(i, b)| b.map(|b| Reference::new(b, i as u32))).collect();
    tree(references, &Placed, preset)
}

fn tree(mut references: Vec<Reference>, primitives: &impl Primitives, preset: Preset) -> Result<Tree, BuildError> {
    let n = references.len();
    if n == 0 {
        return Ok(Tree::empty());
    }
    if n > Child::MAX_BLOCKS || 2 * n >= Child::MAX_SHAPES {
        return Err(BuildError::TooManyPrimitives);
    }
    let fast = preset == Preset::Fast && primitives.only_triangles();
    let quality = preset == Preset::Quality;
    // A few of all as they are, in the order of their primitives.
    let few: Vec<_> = if quality { references.iter().step_by((n / FEW).max(8)).copied().collect() } else { Vec::new() };
    let shape = binned::Shape { leaf: if fast { 4 } else { 1 }, balanced: false, coarse: fast };
    let mut nodes = binned::build(&mut references, shape);
    let bounds = nodes[0].bounds().corners();
    if quality && nodes[0].bounds().area().is_finite() && cutting_promises(few, &references, primitives) {
        let mut pristine = references.clone();
        pristine.par_sort_unstable_by_key(Reference::primitive);
        let (cut_references, cut_nodes) = cut(pristine, primitives);
        let (_, cost) = collapse::plan(&nodes, &references, primitives);
        let (_, cut_cost) = collapse::plan(&cut_nodes, &cut_references, primitives);
        if cut_cost < WORTH_CUTTING * cost {
            (references, nodes) = (cut_references, cut_nodes);
            reinsert::order(&mut nodes);
        }
    }
    if preset != Preset::Fast {
        reinsert::improve(&mut nodes);
    }
    let (plans, _) = collapse::plan(&nodes, &references, primitives);
    let (wide, root) = collapse::collapse(&nodes, &references, primitives, &plans);
    if let Some(tree) = Tree::new(wide.nodes, wide.blocks, wide.shapes, root, bounds) {
        return Ok(tree);
    }
    // Some inputs make trees too deep for the stack; halving by number does not. Cutting leaves room unused.
    references.retain(|r| !r.bounds.is_empty());
    let nodes = binned::build(&mut references, binned::Shape { leaf: 1, balanced: true, coarse: false });
    let (plans, _) = collapse::plan(&nodes, &references, primitives);
    let (wide, root) = collapse::collapse(&nodes, &references, primitives, &plans);
    Tree::new(wide.nodes, wide.blocks, wide.shapes, root, bounds).ok_or(BuildError::TooManyPrimitives)
}

/// The tree with triangles cut, and its references.
fn cut(mut references: Vec<Reference>, primitives: &impl Primitives) -> (Vec<Reference>, Vec<Binary>) {
    let n = references.len();
    let places = n + n / 4;
    references.resize(places, Reference::new(Bounds::EMPTY, 0));
    let mut nodes = Binary::places(2 * places - 1);
    spatial::build(&mut references, n, &mut nodes, primitives);
    (references, nodes)
}

/// Whether cutting triangles brings enough for samples: a few of all of them, and some groups of neighbours if there
/// are many.
fn cutting_promises(few: Vec<Reference>, neighbours: &[Reference], primitives: &impl Primitives) -> bool {
    let n = neighbours.len();
    if n <= ALL {
        return true;
    }
    let costs = |mut sample: Vec<Reference>| {
        let (references, nodes) = cut(sample.clone(), primitives);
        let (_, with) = collapse::plan(&nodes, &references, primitives);
        let nodes = binned::build(&mut sample, binned::Shape { leaf: 1, balanced: false, coarse: false });
        [collapse::plan(&nodes, &sample, primitives).1, with]
    };
    let few = costs(few);
    if few[1] < WORTH_CUTTING * few[0] || n <= 8 * FEW {
        return few[1] < WORTH_CUTTING * few[0];
    }
    let groups = neighbours.chunks(1024).step_by(n / 1024 / 16);
    let near = groups.map(|group| costs(group.to_vec())).fold([0.0; 2], |a, b| [a[0] + b[0], a[1] + b[1]]);
    near[1] < WORTH_CUTTING * near[0]
}

/// Up to so many primitives cutting is tried without asking samples first.
const ALL: usize = 256;
/// How many of all are looked at.
const FEW: usize = 8192;
/// Triangles are cut only if that brings the tree's cost below this part of what it is without, before subtrees are
/// moved, which gains more where nothing was cut.
const WORTH_CUTTING: f32 = 0.8;
