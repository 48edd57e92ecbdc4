//! Surfaces cut into patches: a conforming mesh of triangles.
//!
//! A triangle is cut in half at the middle of its longest edge, and so are, at the same time, all others at that edge
//! (Rivara 1984): where the edge is not their longest, they are cut first until it is. So no corner of one patch lies
//! within an edge of another, triangles get rounder rather than thinner, and cutting some more than others is as good as
//! cutting all alike. Corners at the very same place are one: surfaces that share edges are one mesh, whichever shapes
//! they belong to. Surfaces that merely touch, such as a block on a floor, are not.
//!
//! The halves of halves are a binary tree. It leads from a point of a triangle to its patch, and is the hierarchy that the
//! hierarchical solver works on.

use crate::scene::{Face, Scene};
use glam::DVec3;
use std::cmp::Ordering;
use std::collections::{BinaryHeap, HashMap};

/// No element.
pub const NONE: u32 = u32::MAX;

/// A triangle of the mesh: a face, or a half of another.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Element {
    /// Places of the corners in [`Patches::vertices`].
    pub corners: [u32; 3],
    /// First of its two halves, or [`NONE`] if it is a patch.
    pub child: u32,
    /// Which edge is cut: from this corner to the next.
    pub edge: u32,
    /// Face that it is part of.
    pub face: u32,
}

/// A scene's surfaces, cut into patches.
#[derive(Clone, Debug, PartialEq)]
pub struct Patches {
    /// Corners.
    pub vertices: Vec<DVec3>,
    /// Triangles; the scene's faces come first, in order.
    pub elements: Vec<Element>,
    /// The elements that are patches: those of a face side by side.
    pub leaves: Vec<u32>,
    /// Patch of each element, or [`NONE`].
    pub patch_of: Vec<u32>,
    /// Instance, primitive, whether it is the side behind (0 or 1), and shape, of each face.
    pub faces: Vec<[u32; 4]>,
    /// For each instance, where it begins in `places`, and its first primitive.
    instances: Vec<[u32; 2]>,
    /// Face of each triangle's front, and of its back.
    places: Vec<[u32; 2]>,
}

/// The cutting of faces under way.
struct Cutter {
    vertices: Vec<DVec3>,
    elements: Vec<Element>,
    /// The uncut elements at each edge.
    edges: HashMap<(u32, u32), Vec<u32>>,
    leaves: usize,
}

fn key(a: u32, b: u32) -> (u32, u32) {
    (a.min(b), a.max(b))
}

impl Cutter {
    fn new(vertices: Vec<DVec3>, elements: Vec<Element>) -> Self {
        let mut cutter = Self { vertices, elements: Vec::new(), edges: HashMap::new(), leaves: 0 };
        for (i, e) in elements.iter().enumerate().filter(|(_, e)| e.child == NONE) {
            cutter.enter(i as u32, e.corners);
            cutter.leaves += 1;
        }
        cutter.elements = elements;
        cutter
    }

    fn enter(&mut self, element: u32, c: [u32; 3]) {
        for k in 0..3 {
            self.edges.entry(key(c[k], c[(k + 1) % 3])).or_default().push(element);
        }
    }

    fn leave(&mut self, element: u32, c: [u32; 3]) {
        for k in 0..3 {
            if let Some(all) = self.edges.get_mut(&key(c[k], c[(k + 1) % 3])) {
                all.retain(|e| *e != element);
            }
        }
    }

    /// The uncut elements at an edge, in order.
    fn at(&self, edge: (u32, u32)) -> Vec<u32> {
        let mut elements = self.edges.get(&edge).cloned().unwrap_or_default();
        elements.sort_unstable();
        elements
    }

    /// The longest edge of an element; of equally long ones the one that all elements at it would choose.
    fn longest(&self, element: u32) -> (u32, (u32, u32)) {
        let c = self.elements[element as usize].corners;
        let length = |a: u32, b: u32| (self.vertices[a as usize] - self.vertices[b as usize]).length_squared();
        let edges = [0, 1, 2].map(|k: usize| (c[k], c[(k + 1) % 3])).map(|(a, b)| (key(a, b), length(a, b)));
        let longer = |a: &(usize, &((u32, u32), f64)), b: &(usize, &((u32, u32), f64))| {
            // Lengths that differ by rounding only are the same.
            let same = (a.1.1 - b.1.1).abs() <= 1e-9 * a.1.1.max(b.1.1);
            if same { a.1.0.cmp(&b.1.0) } else { a.1.1.total_cmp(&b.1.1) }
        };
        let (k, (edge, _)) = edges.iter().enumerate().max_by(longer).unwrap_or((0, &edges[0]));
        (k as u32, *edge)
    }

    /// Cuts an element, and first whatever must be cut for it.
    fn cut(&mut self, element: u32) {
        let mut waiting = vec![element];
        while let Some(&top) = waiting.last() {
            if self.elements[top as usize].child != NONE {
                waiting.pop();
                continue;
            }
            let (_, edge) = self.longest(top);
            let others = self.at(edge);
            // Edges grow along the way, so it ends; the bound is for lengths that are equal but for rounding.
            let other = others.iter().find(|e| self.longest(**e).1 != edge && !waiting.contains(*e));
            match other {
                Some(e) => waiting.push(*e),
                None => {
                    let (a, b) = edge;
                    let middle = self.vertices.len() as u32;
                    self.vertices.push((self.vertices[a as usize] + self.vertices[b as usize]) * 0.5);
                    for e in others {
                        self.halve(e, edge, middle);
                    }
                    waiting.pop();
                }
            }
        }
    }

    fn halve(&mut self, element: u32, edge: (u32, u32), middle: u32) {
        let Element { corners, face, .. } = self.elements[element as usize];
        let Some(k) = (0..3).find(|k| key(corners[*k], corners[(k + 1) % 3]) == edge) else { return };
        let (a, b, c) = (corners[k], corners[(k + 1) % 3], corners[(k + 2) % 3]);
        self.leave(element, corners);
        let child = self.elements.len() as u32;
        self.elements[element as usize].child = child;
        self.elements[element as usize].edge = k as u32;
        for (i, corners) in [[a, middle, c], [middle, b, c]].into_iter().enumerate() {
            self.elements.push(Element { corners, child: NONE, edge: 0, face });
            self.enter(child + i as u32, corners);
        }
        self.leaves += 1;
    }

    fn area(&self, element: u32) -> f64 {
        let [a, b, c] = self.elements[element as usize].corners.map(|v| self.vertices[v as usize]);
        (b - a).cross(c - a).length() / 2.0
    }
}

/// An element waiting to be cut, the most urgent first.
#[derive(PartialEq)]
struct Urgent(f64, u32);

impl Eq for Urgent {}
impl PartialOrd for Urgent {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}
impl Ord for Urgent {
    fn cmp(&self, other: &Self) -> Ordering {
        self.0.total_cmp(&other.0).then(other.1.cmp(&self.1))
    }
}

impl Patches {
    /// Cuts a scene's faces until there are at least `count` patches, the largest first.
    pub fn new(scene: &Scene, faces: &[Face], count: usize) -> Self {
        let mut vertices = Vec::new();
        let mut welded = HashMap::new();
        let mut elements = Vec::with_capacity(2 * count);
        for (face, f) in faces.iter().enumerate() {
            let corners = f.corners.map(|p| {
                // Zeros of both signs are one place.
                let place = p.to_array().map(|x| (x as f32 + 0.0).to_bits());
                *welded.entry(place).or_insert_with(|| {
                    vertices.push(p);
                    vertices.len() as u32 - 1
                })
            });
            elements.push(Element { corners, child: NONE, edge: 0, face: face as u32 });
        }
        let mut cutter = Cutter::new(vertices, elements);
        let mut waiting: BinaryHeap<Urgent> = (0..faces.len() as u32).map(|e| Urgent(cutter.area(e), e)).collect();
        while cutter.leaves < count {
            let Some(Urgent(_, element)) = waiting.pop() else { break };
            let before = cutter.elements.len() as u32;
            cutter.cut(element);
            waiting.extend((before..cutter.elements.len() as u32).map(|e| Urgent(cutter.area(e), e)));
        }
        let mut instances = Vec::new();
        let mut places = Vec::new();
        for i in 0..scene.instance_count() {
            let [first, triangles] = scene.triangles_of(i);
            instances.push([places.len() as u32, first]);
            places.resize(places.len() + triangles as usize, [NONE; 2]);
        }
        for (n, f) in faces.iter().enumerate() {
            let [start, first] = instances[f.instance as usize];
            places[(start + f.primitive - first) as usize][usize::from(f.behind)] = n as u32;
        }
        let faces = faces.iter().map(|f| [f.instance, f.primitive, f.behind.into(), f.shape]).collect();
        Self::of(cutter, faces, instances, places)
    }

    fn of(cutter: Cutter, faces: Vec<[u32; 4]>, instances: Vec<[u32; 2]>, places: Vec<[u32; 2]>) -> Self {
        let Cutter { vertices, elements, .. } = cutter;
        let mut patches = Self {
            vertices,
            leaves: Vec::new(),
            patch_of: vec![NONE; elements.len()],
            elements,
            faces,
            instances,
            places,
        };
        // Depth first, so that patches that are near in space are near in number.
        let mut stack: Vec<u32> = (0..patches.faces.len() as u32).rev().collect();
        while let Some(e) = stack.pop() {
            match patches.elements[e as usize].child {
                NONE => {
                    patches.patch_of[e as usize] = patches.leaves.len() as u32;
                    patches.leaves.push(e);
                }
                child => stack.extend([child + 1, child]),
            }
        }
        patches
    }

    /// The same surfaces, cut further where patches are most `urgent` until there are at least `count`.
    pub fn refined(&self, urgent: &[f64], count: usize) -> Self {
        let mut cutter = Cutter::new(self.vertices.clone(), self.elements.clone());
        let mut order: Vec<usize> = (0..self.len()).collect();
        order.sort_by(|a, b| urgent[*b].total_cmp(&urgent[*a]).then(a.cmp(b)));
        for patch in order {
            if cutter.leaves >= count {
                break;
            }
            cutter.cut(self.leaves[patch]);
        }
        Self::of(cutter, self.faces.clone(), self.instances.clone(), self.places.clone())
    }

    /// How a mesh was cut: child and edge of each element. With the scene it says all.
    pub fn cuts(&self) -> Vec<[u32; 2]> {
        self.elements.iter().map(|e| [e.child, e.edge]).collect()
    }

    /// The mesh of a scene that was cut this way; none if these are no cuts of its faces.
    pub fn from_cuts(scene: &Scene, faces: &[Face], cuts: &[[u32; 2]]) -> Option<Self> {
        let whole = Self::new(scene, faces, 0);
        let mut cutter = Cutter::new(whole.vertices, whole.elements);
        // Middles are numbered in the order of the cuts that made them, all elements at an edge together.
        let mut order: Vec<usize> = (0..cuts.len()).filter(|e| cuts[*e][0] != NONE).collect();
        order.sort_by_key(|e| cuts[*e][0]);
        for e in order {
            let element = cutter.elements.get(e)?;
            if element.child != NONE {
                if [element.child, element.edge] != cuts[e] {
                    return None;
                }
                continue;
            }
            if cuts[e][0] as usize != cutter.elements.len() || cuts[e][1] > 2 {
                return None;
            }
            let (c, k) = (element.corners, cuts[e][1] as usize);
            let edge = key(c[k], c[(k + 1) % 3]);
            let middle = cutter.vertices.len() as u32;
            cutter.vertices.push((cutter.vertices[edge.0 as usize] + cutter.vertices[edge.1 as usize]) * 0.5);
            for other in cutter.at(edge) {
                cutter.halve(other, edge, middle);
            }
        }
        let found = Self::of(cutter, whole.faces, whole.instances, whole.places);
        (found.elements.len() == cuts.len()).then_some(found)
    }

    /// How many patches there are.
    pub fn len(&self) -> usize {
        self.leaves.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.leaves.is_empty()
    }

    /// Corners of an element.
    pub fn corners(&self, element: u32) -> [DVec3; 3] {
        self.elements[element as usize].corners.map(|v| self.vertices[v as usize])
    }

    /// Corners of a patch, as places in [`Patches::vertices`].
    pub fn triangle(&self, patch: usize) -> [u32; 3] {
        self.elements[self.leaves[patch] as usize].corners
    }

    /// Area of an element.
    pub fn area(&self, element: u32) -> f64 {
        let [a, b, c] = self.corners(element);
        (b - a).cross(c - a).length() / 2.0
    }

    /// Unit normal of an element.
    pub fn normal(&self, element: u32) -> DVec3 {
        let [a, b, c] = self.corners(element);
        (b - a).cross(c - a).normalize()
    }

    /// Face of a triangle's side.
    #[inline]
    pub fn face(&self, instance: u32, primitive: u32, behind: bool) -> Option<u32> {
        let [start, first] = *self.instances.get(instance as usize)?;
        let [front, back] = *self.places.get((start + primitive.wrapping_sub(first)) as usize)?;
        let face = if behind { back } else { front };
        (face != NONE).then_some(face)
    }

    /// The patch at a point of a face, given by the weights of its corners; and the weights of the patch's.
    #[inline]
    pub fn locate(&self, face: u32, weights: [f32; 3]) -> (usize, [f32; 3]) {
        let (mut element, mut w) = (face as usize, weights);
        loop {
            let e = &self.elements[element];
            if e.child == NONE {
                return (self.patch_of[element] as usize, w);
            }
            let k = e.edge as usize;
            let (a, b, c) = (w[k], w[(k + 1) % 3], w[(k + 2) % 3]);
            // p = a A + b B + c C with A + B = 2 M.
            let near_a = a >= b;
            w = if near_a { [a - b, 2.0 * b, c] } else { [2.0 * a, b - a, c] };
            element = e.child as usize + usize::from(!near_a);
        }
    }
}

/// Barycentric weights of a point of a triangle's plane.
pub fn weights_of(p: DVec3, [a, b, c]: [DVec3; 3]) -> [f64; 3] {
    let n = (b - a).cross(c - a);
    let area = n.length_squared();
    let part = |q: DVec3, r: DVec3| (q - p).cross(r - p).dot(n) / area;
    [part(b, c), part(c, a), part(a, b)]
}
