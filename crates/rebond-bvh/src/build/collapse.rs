//! From the binary tree to the eight-wide one.
//!
//! The cheapest way to cut the binary tree into nodes of up to eight children and leaves of up to four blocks of four
//! triangles, by dynamic programming: H. Ylitie, T. Karras, S. Laine, "Efficient Incoherent Ray Traversal on GPUs
//! Through Compressed Wide BVHs", HPG 2017, section 3.1.

use super::bounds::{Binary, Reference};
use crate::node::{Child, Node};
use crate::shape::Shape;
use crate::triangle::Block;
use rayon::prelude::*;

/// What a block costs to test, in node tests: less than by itself, since fewer and larger leaves make fewer nodes and stay
/// in the cache. With 0.9, camera rays took 4 % longer on a scan of 865 k triangles and 2 % longer on 1.93 M with grass.
const BLOCK: f32 = 0.5;
/// What another shape costs to test.
const SHAPE: f32 = 1.5;
/// Most triangles of a leaf.
const LEAF: u32 = 16;
/// Subtrees of more references than this are emitted side by side.
const PARALLEL: u32 = 4096;
/// Subtrees of more nodes than this are planned side by side.
const PARALLEL_PLAN: usize = 8192;

/// The least cost of representing a subtree by at most i + 1 children of one node.
type Costs = [f32; 7];

/// How that is done.
#[derive(Clone, Copy, bytemuck::Zeroable)]
pub(crate) struct Plan {
    /// For i = 0: how many of the eight slots of its own node go to the left, 0 for a leaf. For others: how many of the
    /// i + 1 slots go to the left, 0 to use fewer slots.
    left: [u8; 7],
    only_triangles: bool,
    /// References in the subtree.
    count: u32,
}

/// Where the collapse takes its primitives from.
pub(crate) trait Primitives: Sync {
    /// The corners of a triangle and its global number; none for other shapes.
    fn triangle(&self, primitive: u32) -> Option<([[f32; 3]; 3], u32)>;
    /// Any other shape.
    fn shape(&self, primitive: u32) -> Shape;
    /// Whether there are other shapes at all.
    fn only_triangles(&self) -> bool;
    /// Asks for the triangle `soon` and for the corners of the triangle `next`, that was asked for before.
    fn prefetch(&self, soon: u32, next: u32);
}

/// The arrays of the wide tree.
#[derive(Default)]
pub(crate) struct Wide {
    pub nodes: Vec<Node>,
    pub blocks: Vec<Block>,
    pub shapes: Vec<Shape>,
}

/// `nodes` has its root first and children behind parents. It and the plans are dropped before the parts are put together, when most
/// memory is in use.
pub(crate) fn collapse(
    nodes: Vec<Binary>,
    references: &[Reference],
    primitives: &impl Primitives,
    plans: Vec<Plan>,
) -> (Wide, Child) {
    let part = Emitter { nodes: &nodes, references, primitives, plans: &plans }.part(0);
    drop((nodes, plans));
    if let Part::Subtree(wide, root) = part {
        return (wide, root);
    }
    let [nodes, blocks, shapes] = part.len();
    let mut wide = Wide {
        nodes: Vec::with_capacity(nodes),
        blocks: Vec::with_capacity(blocks),
        shapes: Vec::with_capacity(shapes),
    };
    let root = part.put(&mut wide);
    (wide, root)
}

/// The best plan for every node, and what the whole tree costs.
pub(crate) fn plan(nodes: &[Binary], references: &[Reference], primitives: &impl Primitives) -> (Vec<Plan>, f32) {
    let mut plans: Vec<Plan> = bytemuck::allocation::zeroed_vec(nodes.len());
    let mut costs: Vec<Costs> = bytemuck::allocation::zeroed_vec(nodes.len());
    plan_subtree(nodes, 0, (&mut plans, &mut costs), references, primitives);
    (plans, costs[0][0])
}

/// The same for the subtree that `nodes` hold, the first of which has the number `base`: children lie behind their
/// parents, all of the left side's before the right side's.
fn plan_subtree(
    nodes: &[Binary],
    base: u32,
    (plans, costs): (&mut [Plan], &mut [Costs]),
    references: &[Reference],
    primitives: &impl Primitives,
) {
    let root = &nodes[0];
    let mut planned = nodes.len();
    if nodes.len() > PARALLEL_PLAN && root.count().is_none() {
        let (left, right) = ((root.left - base) as usize, (root.right - base) as usize);
        let (head, tail) = plans.split_at_mut(right);
        let (head_costs, tail_costs) = costs.split_at_mut(right);
        let head = (&mut head[left..], &mut head_costs[left..]);
        rayon::join(
            || plan_subtree(&nodes[left..right], root.left, head, references, primitives),
            || plan_subtree(&nodes[right..], root.right, (tail, tail_costs), references, primitives),
        );
        planned = 1;
    }
    for (i, node) in nodes[..planned].iter().enumerate().rev() {
        if node.right == 0 {
            continue; // a place that was not used
        }
        let area = node.bounds().area();
        (plans[i], costs[i]) = if let Some(count) = node.count() {
            let only_triangles = primitives.only_triangles()
                || references[node.left as usize..][..count as usize]
                    .iter()
                    .all(|r| primitives.triangle(r.primitive()).is_some());
            let cost = area * if only_triangles { BLOCK * count.div_ceil(4) as f32 } else { SHAPE * count as f32 };
            (Plan { left: [0; 7], only_triangles, count }, [cost; 7])
        } else {
            let side = |child: u32| (&plans[(child - base) as usize], &costs[(child - base) as usize]);
            join(area, side(node.left), side(node.right))
        };
    }
}

/// The plan of a node from those of its children.
#[inline(always)]
fn join(area: f32, (l, left_costs): (&Plan, &Costs), (r, right_costs): (&Plan, &Costs)) -> (Plan, Costs) {
    // Over how many slots the left side gets.
    let share = |slots: usize| {
        let mut best = (f32::INFINITY, 0);
        for left in 1..slots {
            if left <= 7 && slots - left <= 7 {
                let cost = left_costs[left - 1] + right_costs[slots - left - 1];
                if cost < best.0 {
                    best = (cost, left as u8);
                }
            }
        }
        best
    };
    let count = l.count + r.count;
    let only_triangles = l.only_triangles && r.only_triangles;
    let mut plan = Plan { left: [0; 7], only_triangles, count };
    let mut costs = [0.0; 7];
    let (children, left) = share(8);
    (costs[0], plan.left[0]) = (area + children, left.max(1));
    if only_triangles && count <= LEAF {
        let leaf = area * BLOCK * count.div_ceil(4) as f32;
        if leaf <= costs[0] {
            (costs[0], plan.left[0]) = (leaf, 0);
        }
    }
    for slots in 2..=7 {
        let (cost, left) = share(slots);
        (costs[slots - 1], plan.left[slots - 1]) =
            if cost < costs[slots - 2] { (cost, left) } else { (costs[slots - 2], 0) };
    }
    (plan, costs)
}

/// Up to N values in place.
struct Few<T, const N: usize> {
    values: [T; N],
    len: usize,
}

impl<T: Copy, const N: usize> Few<T, N> {
    fn new(nothing: T) -> Self {
        Self { values: [nothing; N], len: 0 }
    }
    fn push(&mut self, value: T) {
        self.values[self.len] = value;
        self.len += 1;
    }
    fn all(&mut self) -> &mut [T] {
        &mut self.values[..self.len]
    }
}

/// A part of the wide tree.
enum Part {
    Fork(Box<Node>, Vec<Part>),
    /// With its root; places are within the part.
    Subtree(Wide, Child),
}

impl Part {
    /// How many nodes, blocks and shapes.
    fn len(&self) -> [usize; 3] {
        match self {
            Self::Fork(_, parts) => {
                parts.iter().map(Self::len).fold([1, 0, 0], |a, b| std::array::from_fn(|i| a[i] + b[i]))
            }
            Self::Subtree(wide, _) => [wide.nodes.len(), wide.blocks.len(), wide.shapes.len()],
        }
    }

    /// Moves it behind what is there.
    fn put(self, out: &mut Wide) -> Child {
        let [n, b, s] = [out.nodes.len(), out.blocks.len(), out.shapes.len()].map(|x| x as u32);
        match self {
            Self::Fork(node, parts) => {
                out.nodes.push(*node);
                for (slot, part) in parts.into_iter().enumerate() {
                    let child = part.put(out);
                    out.nodes[n as usize].children[slot] = child;
                }
                Child::node(n)
            }
            Self::Subtree(wide, root) => {
                out.nodes.extend(wide.nodes.into_iter().map(|mut node| {
                    for child in &mut node.children {
                        *child = child.moved(n, b, s);
                    }
                    node
                }));
                out.blocks.extend_from_slice(&wide.blocks);
                out.shapes.extend_from_slice(&wide.shapes);
                root.moved(n, b, s)
            }
        }
    }
}

struct Emitter<'a, P> {
    nodes: &'a [Binary],
    references: &'a [Reference],
    primitives: &'a P,
    plans: &'a [Plan],
}

impl<P: Primitives> Emitter<'_, P> {
    /// The roots of the subtrees that share `slots` slots.
    fn children(&self, at: u32, slots: usize, out: &mut Few<u32, 8>) {
        let node = &self.nodes[at as usize];
        let left = self.plans[at as usize].left[slots - 1];
        if slots == 1 || node.count().is_some() {
            out.push(at);
        } else if left == 0 {
            self.children(at, slots - 1, out);
        } else {
            self.children(node.left, usize::from(left), out);
            self.children(node.right, slots - usize::from(left), out);
        }
    }

    fn children_of_node(&self, at: u32) -> Few<u32, 8> {
        let mut children = Few::new(0);
        let node = &self.nodes[at as usize];
        let left = usize::from(self.plans[at as usize].left[0]);
        self.children(node.left, left, &mut children);
        self.children(node.right, 8 - left, &mut children);
        children
    }

    fn is_leaf(&self, at: u32) -> bool {
        self.nodes[at as usize].count().is_some() || self.plans[at as usize].left[0] == 0
    }

    fn node(&self, children: &[u32]) -> Node {
        let mut node = Node::EMPTY;
        for (slot, &child) in children.iter().enumerate() {
            let bounds = &self.nodes[child as usize].bounds();
            for k in 0..3 {
                node.planes[2 * k][slot] = bounds.lo(k);
                node.planes[2 * k + 1][slot] = bounds.hi(k);
            }
        }
        node
    }

    /// Emitted by several threads as far as that pays.
    fn part(&self, at: u32) -> Part {
        let count = self.plans[at as usize].count;
        if self.is_leaf(at) || count <= PARALLEL {
            let mut wide = Wide { nodes: Vec::with_capacity(count as usize / 6), ..Wide::default() };
            wide.blocks.reserve(count as usize / 3);
            let child = self.emit(at, &mut wide);
            return Part::Subtree(wide, child);
        }
        let mut children = self.children_of_node(at);
        let children = &*children.all();
        Part::Fork(Box::new(self.node(children)), children.par_iter().map(|&child| self.part(child)).collect())
    }

    fn emit(&self, at: u32, wide: &mut Wide) -> Child {
        if self.is_leaf(at) {
            return self.leaf(at, wide);
        }
        let mut children = self.children_of_node(at);
        let children = &*children.all();
        let place = wide.nodes.len();
        wide.nodes.push(self.node(children));
        for (slot, &child) in children.iter().enumerate() {
            let child = self.emit(child, wide);
            wide.nodes[place].children[slot] = child;
        }
        Child::node(place as u32)
    }

    fn leaf(&self, at: u32, wide: &mut Wide) -> Child {
        let mut primitives: Few<u32, { LEAF as usize }> = Few::new(0);
        self.gather(at, &mut primitives);
        let primitives = primitives.all();
        if self.primitives.triangle(primitives[0]).is_none() {
            wide.shapes.push(self.primitives.shape(primitives[0]));
            return Child::shape(wide.shapes.len() as u32 - 1);
        }
        // A triangle that was split may come back together here.
        primitives.sort_unstable();
        let mut n = 1;
        for i in 1..primitives.len() {
            if primitives[i] != primitives[n - 1] {
                primitives[n] = primitives[i];
                n += 1;
            }
        }
        let first = wide.blocks.len() as u32;
        for four in primitives[..n].chunks(4) {
            let mut triangles = Few::<_, 4>::new(([[0.0; 3]; 3], 0));
            four.iter().filter_map(|&i| self.primitives.triangle(i)).for_each(|triangle| triangles.push(triangle));
            wide.blocks.push(Block::new(triangles.all()));
        }
        Child::blocks(first, n.div_ceil(4) as u32)
    }

    fn gather(&self, at: u32, out: &mut Few<u32, { LEAF as usize }>) {
        let node = &self.nodes[at as usize];
        if let Some(count) = node.count() {
            let references = &self.references[node.left as usize..][..count as usize];
            references.iter().for_each(|r| out.push(r.primitive()));
            // Leaves come nearly in the order of their references.
            for i in node.left..node.left + count {
                let ahead = |n: u32| self.references.get((i + n) as usize).map(Reference::primitive);
                if let (Some(soon), Some(next)) = (ahead(32), ahead(16)) {
                    self.primitives.prefetch(soon, next);
                }
            }
        } else {
            self.gather(node.left, out);
            self.gather(node.right, out);
        }
    }
}
