//! The finished tree over one geometry, or over the instances.

use crate::Filter;
use crate::node::{Child, Node, Target};
use crate::ray::{Best, SingleRay};
use crate::shape::Shape;
use crate::single::Shapes;
use crate::triangle::{Block, in_f64};

/// A tree and what its leaves hold.
///
/// Every child of every node refers to an element that is there, and no way from `root` down needs more than
/// [`STACK`](crate::single::STACK) places of a stack: [`Tree::new`] sees to both.
#[derive(Debug)]
pub(crate) struct Tree {
    nodes: Vec<Node>,
    blocks: Vec<Block>,
    shapes: Vec<Shape>,
    root: Option<Child>,
    /// All triangles again if they are few, in pairs where that can be; and the corners they share.
    pairs: Vec<Pair>,
    corners: Vec<[f32; 3]>,
    /// Bounds of everything; lower above upper if there is nothing.
    pub bounds: ([f32; 3], [f32; 3]),
    /// Places of a stack that no way down needs more of, with eight to spare.
    pub places: usize,
    /// Largest absolute coordinate of the bounds.
    pub extent: f32,
    /// Too large for the cache: fetch ahead.
    pub large: bool,
}

pub(crate) const NO_BOUNDS: ([f32; 3], [f32; 3]) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);

/// One of few triangles, a b c; or two of them that share an edge, a b c and a c d.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pair {
    /// Three times the places of a, b, c and d among the corners of the tree, which are at most [`FEW_CORNERS`]. For
    /// one triangle d is c, and the second is never hit.
    pub corners: [u32; 4],
    pub primitives: [u32; 2],
}

/// Up to so many triangles and shapes, sixteen rays look at all of them.
const FEW: usize = 64;
pub(crate) const FEW_CORNERS: usize = 96;
const FEW_SHAPES: usize = 8;

/// In trees of fewer bytes than this, rays to any hit stay together even if they go different ways.
const SMALL: usize = 32 << 10;

/// In trees of more bytes than this, packets and single rays fetch children ahead.
const LARGE: usize = 4 << 20;

impl Tree {
    /// A tree of nothing.
    pub fn empty() -> Self {
        Self {
            nodes: Vec::new(),
            blocks: Vec::new(),
            shapes: Vec::new(),
            root: None,
            pairs: Vec::new(),
            corners: Vec::new(),
            bounds: NO_BOUNDS,
            places: 0,
            extent: 0.0,
            large: false,
        }
    }

    /// None if the tree is too deep for the queries' stack.
    ///
    /// # Panics
    /// If a child refers to something that is not there, or to a node before its parent.
    pub fn new(
        nodes: Vec<Node>,
        blocks: Vec<Block>,
        shapes: Vec<Shape>,
        root: Child,
        bounds: ([f32; 3], [f32; 3]),
    ) -> Option<Self> {
        // Children come after their parents, so one pass from the back finds how much stack each subtree needs.
        let mut need = vec![0_u16; nodes.len()];
        let check = |child: Child| match child.target() {
            Target::Node(index) => assert!((index as usize) < nodes.len()),
            Target::Blocks { first, count } => assert!((first + count) as usize <= blocks.len()),
            Target::Shape(index) => assert!((index as usize) < shapes.len()),
        };
        check(root);
        for (i, node) in nodes.iter().enumerate().rev() {
            let (mut children, mut deepest) = (0_u16, 0);
            for (slot, &child) in node.children.iter().enumerate() {
                check(child);
                if node.planes[0][slot] <= node.planes[1][slot] {
                    children += 1;
                    if let Target::Node(index) = child.target() {
                        assert!(index as usize > i);
                        deepest = deepest.max(need[index as usize]);
                    }
                }
            }
            need[i] = (deepest + children).min(u16::MAX / 2);
        }
        let deepest = if let Target::Node(index) = root.target() { need[index as usize] } else { 0 };
        let places = usize::from(deepest) + 8;
        if places > crate::single::STACK {
            return None;
        }
        let extent = bounds.0.iter().chain(&bounds.1).fold(0.0, |m: f32, x| m.max(x.abs()));
        let (pairs, corners) = few(&blocks, &shapes);
        let root = Some(root);
        let mut tree = Self { nodes, blocks, shapes, root, pairs, corners, bounds, places, extent, large: false };
        tree.large = tree.bytes() > LARGE;
        Some(tree)
    }

    pub fn bytes(&self) -> usize {
        size_of_val(&*self.nodes) + size_of_val(&*self.blocks) + size_of_val(&*self.shapes)
    }
    /// All triangles, if every primitive is either one of these or one of the few shapes.
    pub fn pairs(&self) -> &[Pair] {
        &self.pairs
    }
    /// Their corners, at most [`FEW_CORNERS`].
    pub fn corners(&self) -> &[[f32; 3]] {
        &self.corners
    }
    /// Whether sixteen rays had better look at everything.
    pub fn is_tiny(&self) -> bool {
        self.shapes.len() <= FEW_SHAPES && (self.blocks.is_empty() || !self.pairs.is_empty())
    }
    /// Whether sixteen rays to any hit had better stay together.
    pub fn is_small(&self) -> bool {
        self.bytes() < SMALL
    }
    pub fn nodes(&self) -> &[Node] {
        &self.nodes
    }
    pub fn blocks(&self) -> &[Block] {
        &self.blocks
    }
    pub fn shapes(&self) -> &[Shape] {
        &self.shapes
    }
    pub fn root(&self) -> Option<Child> {
        self.root
    }

    /// The nearest hit by looking at everything, in f64.
    #[cold]
    pub fn scan(&self, ray: &SingleRay, instance: u32, filter: &impl Filter, shapes: &impl Shapes, best: &mut Best) {
        for block in &self.blocks {
            for i in 0..4 {
                let primitive = block.primitive(i);
                if let Some([t, u, v]) = in_f64(block.corners(i), ray)
                    && best.yields_to(t, primitive, instance)
                    && filter.keep(primitive, instance, u, v)
                {
                    *best = Best { t, u, v, primitive, instance };
                }
            }
        }
        for shape in &self.shapes {
            shapes.closest(shape, ray, best);
        }
    }
}

/// All triangles and their corners, each once, if there are few of them and none is thin.
fn few(blocks: &[Block], shapes: &[Shape]) -> (Vec<Pair>, Vec<[f32; 3]>) {
    let none = (Vec::new(), Vec::new());
    let thin = |block: &Block| (0..4).any(|i| block.is_thin(i));
    if blocks.len() > FEW || shapes.len() > FEW_SHAPES || blocks.iter().any(thin) {
        return none;
    }
    let each = |block: &Block| std::array::from_fn::<_, 4, _>(|i| (block.corners(i), block.primitive(i)));
    let mut all: Vec<([[f32; 3]; 3], u32)> = blocks.iter().flat_map(each).collect();
    all.sort_unstable_by_key(|t| t.1);
    all.dedup_by_key(|t| t.1);
    let mut corners: Vec<[f32; 3]> = Vec::new();
    let mut place = |p: [f32; 3]| {
        let same = |q: &[f32; 3]| q.map(f32::to_bits) == p.map(f32::to_bits);
        corners.iter().position(same).unwrap_or_else(|| {
            corners.push(p);
            corners.len() - 1
        })
    };
    let triangles: Vec<([usize; 3], u32)> = all.iter().map(|(c, number)| (c.map(&mut place), *number)).collect();
    if triangles.len() > FEW || corners.len() > FEW_CORNERS {
        return none;
    }
    // The halves of a flat quadrilateral face the same way; of others a ray may meet both.
    let is_flat = |a: &[usize; 3], b: &[usize; 3]| {
        let (m, n) = (normal(a.map(|i| corners[i])), normal(b.map(|i| corners[i])));
        let dot = |p: &[f64; 3], q: &[f64; 3]| p.iter().zip(q).map(|(x, y)| x * y).sum::<f64>();
        dot(&m, &n) > 0.999 * (dot(&m, &m) * dot(&n, &n)).sqrt()
    };
    let mut pairs: Vec<Pair> = Vec::new();
    let mut taken = vec![false; triangles.len()];
    for (i, (a, primitive)) in triangles.iter().enumerate() {
        if taken[i] {
            continue;
        }
        let other = triangles
            .iter()
            .enumerate()
            .skip(i + 1)
            .find(|(j, (b, _))| !taken[*j] && (b[0], b[1]) == (a[0], a[2]) && is_flat(a, b));
        let (d, second) = match other {
            Some((j, (b, second))) => {
                taken[j] = true;
                (b[2], *second)
            }
            None => (a[2], *primitive),
        };
        let corners = [a[0], a[1], a[2], d].map(|place| 3 * place as u32);
        pairs.push(Pair { corners, primitives: [*primitive, second] });
    }
    (pairs, corners)
}

/// A normal of a triangle, not of unit length.
fn normal([p, q, r]: [[f32; 3]; 3]) -> [f64; 3] {
    let from_p = |x: [f32; 3]| std::array::from_fn::<_, 3, _>(|k| f64::from(x[k]) - f64::from(p[k]));
    let (a, b) = (from_p(q), from_p(r));
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}
