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
pub(crate) struct Wide {
    pub nodes: Vec<Node>,
    pub blocks: Vec<Block>,
    pub shapes: Vec<Shape>,
}

/// `nodes` has its root first and children behind parents, all of the left side's before the right side's.
pub(crate) fn collapse(
    nodes: &[Binary],
    references: &[Reference],
    primitives: &impl Primitives,
    plans: &[Plan],
) -> (Wide, Child) {
    let emitter = Emitter { nodes, references, primitives, plans };
    let part = emitter.measure(0);
    let [n, b, s] = part.size;
    // In place from the start: the arrays are what takes most memory, and are not there twice.
    let mut wide = Wide {
        nodes: bytemuck::allocation::zeroed_vec(n),
        blocks: bytemuck::allocation::zeroed_vec(b),
        shapes: vec![Shape::Instance(0); s],
    };
    let all = Places { nodes: &mut wide.nodes, blocks: &mut wide.blocks, shapes: &mut wide.shapes, first: [0; 3] };
    let root = emitter.part(&part, all);
    (wide, root)
}

/// The best plan for every node, and what the whole tree costs.
pub(crate) fn plan(nodes: &[Binary], references: &[Reference], primitives: &impl Primitives) -> (Vec<Plan>, f32) {
    let mut plans: Vec<Plan> = bytemuck::allocation::zeroed_vec(nodes.len());
    let costs = plan_subtree(nodes, 0, &mut plans, references, primitives);
    (plans, costs[0])
}

/// The same for the subtree that `nodes` hold, the first of which has the number `base`: children lie behind their
/// parents, all of the left side's before the right side's. Returns what its root costs.
fn plan_subtree(
    nodes: &[Binary],
    base: u32,
    plans: &mut [Plan],
    references: &[Reference],
    primitives: &impl Primitives,
) -> Costs {
    let root = &nodes[0];
    if nodes.len() > PARALLEL_PLAN && root.count().is_none() {
        let (left, right) = ((root.left - base) as usize, (root.right - base) as usize);
        let (head, tail) = plans.split_at_mut(right);
        let (left_costs, right_costs) = rayon::join(
            || plan_subtree(&nodes[left..right], root.left, &mut head[left..], references, primitives),
            || plan_subtree(&nodes[right..], root.right, tail, references, primitives),
        );
        let (plan, costs) = join(root.bounds().area(), (&plans[left], &left_costs), (&plans[right], &right_costs));
        plans[0] = plan;
        return costs;
    }
    // Not by recursion: moved subtrees may make long chains.
    let mut costs: Vec<Costs> = bytemuck::allocation::zeroed_vec(nodes.len());
    for (i, node) in nodes.iter().enumerate().rev() {
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
    costs[0]
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

fn sum(a: [usize; 3], b: [usize; 3]) -> [usize; 3] {
    std::array::from_fn(|i| a[i] + b[i])
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

/// A part of the wide tree, and how many nodes, blocks and shapes it has.
struct Part {
    at: u32,
    size: [usize; 3],
    /// What its root's children are, if they are emitted side by side.
    parts: Vec<Part>,
}

/// Where a part's nodes, blocks and shapes go.
struct Places<'a> {
    nodes: &'a mut [Node],
    blocks: &'a mut [Block],
    shapes: &'a mut [Shape],
    /// The numbers of the first of each.
    first: [u32; 3],
}

impl<'a> Places<'a> {
    /// Takes away the first few of each.
    fn take(&mut self, [n, b, s]: [usize; 3]) -> Self {
        let first = self.first;
        self.first = [first[0] + n as u32, first[1] + b as u32, first[2] + s as u32];
        Self {
            first,
            nodes: self.nodes.split_off_mut(..n).expect("as many as were counted"),
            blocks: self.blocks.split_off_mut(..b).expect("as many as were counted"),
            shapes: self.shapes.split_off_mut(..s).expect("as many as were counted"),
        }
    }
    /// Takes away the first node.
    fn node(&mut self) -> (&'a mut Node, Child) {
        let Self { nodes, first, .. } = self.take([1, 0, 0]);
        (&mut nodes[0], Child::node(first[0]))
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

    /// How large the subtree's part will be, counted by several threads as far as that pays.
    fn measure(&self, at: u32) -> Part {
        if self.is_leaf(at) || self.plans[at as usize].count <= PARALLEL {
            return Part { at, size: self.count(at), parts: Vec::new() };
        }
        let mut children = self.children_of_node(at);
        let parts: Vec<Part> = children.all().par_iter().map(|&child| self.measure(child)).collect();
        Part { at, size: parts.iter().fold([1, 0, 0], |size, part| sum(size, part.size)), parts }
    }

    /// How many nodes, blocks and shapes the subtree takes.
    fn count(&self, at: u32) -> [usize; 3] {
        if self.is_leaf(at) {
            let plan = &self.plans[at as usize];
            return if plan.only_triangles { [0, plan.count.div_ceil(4) as usize, 0] } else { [0, 0, 1] };
        }
        self.children_of_node(at).all().iter().fold([1, 0, 0], |size, &child| sum(size, self.count(child)))
    }

    /// Emitted by several threads as far as that pays.
    fn part(&self, part: &Part, mut places: Places) -> Child {
        if part.parts.is_empty() {
            return self.emit(part.at, &mut places);
        }
        let (node, place) = places.node();
        let own: Vec<(&Part, Places)> = part.parts.iter().map(|part| (part, places.take(part.size))).collect();
        let children: Vec<Child> = own.into_par_iter().map(|(part, places)| self.part(part, places)).collect();
        let roots: Vec<u32> = part.parts.iter().map(|part| part.at).collect();
        *node = self.node(&roots);
        node.children[..children.len()].copy_from_slice(&children);
        place
    }

    fn emit(&self, at: u32, places: &mut Places) -> Child {
        if self.is_leaf(at) {
            return self.leaf(at, places);
        }
        let mut children = self.children_of_node(at);
        let children = &*children.all();
        let (node, place) = places.node();
        *node = self.node(children);
        for (slot, &child) in children.iter().enumerate() {
            node.children[slot] = self.emit(child, places);
        }
        place
    }

    fn leaf(&self, at: u32, places: &mut Places) -> Child {
        let Places { blocks, shapes, first, .. } = places.take(self.count(at));
        let mut primitives: Few<u32, { LEAF as usize }> = Few::new(0);
        self.gather(at, &mut primitives);
        let primitives = primitives.all();
        if let Some(shape) = shapes.first_mut() {
            *shape = self.primitives.shape(primitives[0]);
            return Child::shape(first[2]);
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
        // If so, blocks may be left over, which nothing refers to; they repeat the last.
        let fours = primitives[..n].chunks(4);
        let last = primitives[..n].chunks(4).last();
        for (block, four) in blocks.iter_mut().zip(fours.chain(last.into_iter().cycle())) {
            let mut triangles = Few::<_, 4>::new(([[0.0; 3]; 3], 0));
            four.iter().filter_map(|&i| self.primitives.triangle(i)).for_each(|triangle| triangles.push(triangle));
            *block = Block::new(triangles.all());
        }
        Child::blocks(first[1], n.div_ceil(4) as u32)
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
