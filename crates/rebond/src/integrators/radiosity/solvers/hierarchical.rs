//! Hierarchical radiosity (Hanrahan, Salzman, Aupperle 1991): patches exchange light as parts of larger ones where that is good enough,
//! so that N patches need a number of links near N rather than N².
//!
//! The elements are the triangles of the mesh and all that they were cut from ([`patches`](super::super::patches)). A link between two
//! elements p and q stands for all pairs of patches under them, by one number A_p F_pq. It is good enough when
//!
//! ```text
//! max(ρ_p L_q, ρ_q L_p) · A_p A_q · (max VK − min VK) ≤ ε Σ A S
//! ```
//!
//! over sixteen rays between them: what the light that it carries would be off by if the kernel were as far from its mean as
//! anywhere that they went (Lischinski, Smits, Greenberg 1994 bound it the same way). Where no ray got through, one in sixteen is
//! taken to have missed a gap. If it is not good enough, the larger of the two is cut, down to the patches.
//! At first only sources shine; links that carry more once light has spread are cut after each solution, until few are.
//!
//! A round of the solution gathers over all links, hands irradiance down the tree, and radiance up as means over area.

use super::{Channels, MOST_ITERATIONS, Problem};
use crate::integrators::radiosity::form_factors::{Closure, FormFactors, scale_of};
use crate::integrators::radiosity::patches::{NONE, Patches};
use crate::render::Observer;
use rayon::prelude::*;

/// Two elements that exchange light: `A_p F_pq`, and the bound of its error over the radiance sent.
#[derive(Clone, Copy, Debug)]
struct Link {
    p: u32,
    q: u32,
    exchange: f32,
    spread: f32,
}

/// Bytes of a link.
pub const LINK_BYTES: u64 = size_of::<Link>() as u64;
/// Most times that links are cut after a solution.
const ROUNDS: u32 = 6;
/// Bytes of all else, for each patch: two elements, their corners, columns, points and light.
pub const PATCH_BYTES: u64 = 1300;

/// What the solution took.
#[derive(Clone, Debug, Default)]
pub struct Effort {
    /// Links.
    pub links: u64,
    /// Rounds of gathering, over all solutions.
    pub iterations: u32,
    /// Rays traced.
    pub rays: u64,
    /// Seconds that linking took.
    pub linking_seconds: f64,
    /// Sums of the rows of F.
    pub closure: Closure,
    /// The residual of the last solution over what the sources send, if it was given up.
    pub residual: Option<f64>,
}

/// Why there is no solution.
pub enum Unsolved {
    /// Told to stop.
    Stopped,
    /// There would be more links than memory for them: how many there were by then.
    Memory(u64),
}

/// The elements' light.
struct Tree<'a> {
    mesh: &'a Patches,
    /// Elements from the faces down: children always follow their parents.
    areas: &'a [f64],
    problem: Problem,
    /// Largest reflectance, over colours and patches under each element.
    reflectance: Vec<f32>,
}

impl Tree<'_> {
    /// Means of the patches' values over each element.
    fn pull(&self, patches: &Channels) -> Channels {
        patches.each_ref().map(|values| {
            let mut all = vec![0.0; self.areas.len()];
            for e in (0..all.len()).rev() {
                all[e] = match self.mesh.elements[e].child as usize {
                    c if c == NONE as usize => values[self.mesh.patch_of[e] as usize],
                    c => {
                        let (a, b) = (self.areas[c], self.areas[c + 1]);
                        ((f64::from(all[c]) * a + f64::from(all[c + 1]) * b) / (a + b)) as f32
                    }
                };
            }
            all
        })
    }

    /// One round: from the elements' radiance to the patches'.
    fn gather(&self, links: &[Link], light: &[[f32; 3]]) -> Channels {
        let mut arriving = vec![[0.0_f32; 3]; light.len()];
        for l in links {
            let (p, q) = (l.p as usize, l.q as usize);
            let (to_p, to_q) = (light[q], light[p]);
            for c in 0..3 {
                arriving[p][c] += l.exchange * to_p[c];
                arriving[q][c] += l.exchange * to_q[c];
            }
        }
        let mut next = self.problem.source.clone();
        for e in 0..light.len() {
            let own = arriving[e].map(|x| x / self.areas[e] as f32);
            match self.mesh.elements[e].child as usize {
                c if c == NONE as usize => {
                    let patch = self.mesh.patch_of[e] as usize;
                    for c in 0..3 {
                        next[c][patch] += self.problem.reflectance[c][patch] * own[c];
                    }
                }
                // Children divide by their own area once more.
                child => {
                    for k in [child, child + 1] {
                        let area = self.areas[k] as f32;
                        (0..3).for_each(|c| arriving[k][c] += own[c] * area);
                    }
                }
            }
        }
        next
    }

    /// Sums of the rows of F, for the patches.
    fn row_sums(&self, links: &[Link]) -> Vec<f64> {
        let mut sums = vec![0.0; self.areas.len()];
        for l in links {
            sums[l.p as usize] += f64::from(l.exchange) / self.areas[l.p as usize];
            sums[l.q as usize] += f64::from(l.exchange) / self.areas[l.q as usize];
        }
        for e in 0..sums.len() {
            let child = self.mesh.elements[e].child as usize;
            if child != NONE as usize {
                sums[child] += sums[e];
                sums[child + 1] += sums[e];
            }
        }
        self.mesh.leaves.iter().map(|e| sums[*e as usize]).collect()
    }

    /// Rounds until there is no change; how many, and the residual if there were too many.
    fn solve(&self, links: &[Link], light: &mut Channels, observer: &dyn Observer) -> Option<(u32, Option<f64>)> {
        let mut residual = 0.0;
        for round in 1..=MOST_ITERATIONS {
            if observer.should_stop() {
                return None;
            }
            let [r, g, b] = self.pull(light);
            let all: Vec<[f32; 3]> = r.into_iter().zip(g).zip(b).map(|((r, g), b)| [r, g, b]).collect();
            let next = self.gather(links, &all);
            let changed = (0..3).flat_map(|c| next[c].iter().zip(&light[c]).map(|(a, b)| (a - b).abs()));
            let changed = changed.fold(0.0, f32::max);
            if round == MOST_ITERATIONS {
                residual = self.problem.difference(&next, light);
            }
            *light = next;
            if changed <= self.problem.threshold(light) {
                return Some((round, None));
            }
        }
        Some((MOST_ITERATIONS, Some(residual)))
    }
}

/// The solution, with errors of single links up to the share `epsilon` of what the sources send. `factors` are those of all elements of
/// the mesh, and there is room for `most` links.
pub fn solve(
    factors: &FormFactors,
    mesh: &Patches,
    problem: &Problem,
    epsilon: f32,
    most: u64,
    observer: &dyn Observer,
) -> Result<(Channels, Effort), Unsolved> {
    let brightest = |c: &Channels, i: usize| c[0][i].max(c[1][i]).max(c[2][i]);
    let largest: Vec<f32> = (0..mesh.len()).map(|i| brightest(&problem.reflectance, i)).collect();
    let mut reflectance = vec![0.0_f32; mesh.elements.len()];
    for e in (0..reflectance.len()).rev() {
        reflectance[e] = match mesh.elements[e].child as usize {
            c if c == NONE as usize => largest[mesh.patch_of[e] as usize],
            c => reflectance[c].max(reflectance[c + 1]),
        };
    }
    let mut tree = Tree { mesh, areas: &factors.areas, problem: problem.clone(), reflectance };
    let sent: f64 = (0..mesh.len()).map(|i| f64::from(brightest(&problem.source, i)) * problem.areas[i]).sum();
    let tolerance = (f64::from(epsilon) * sent) as f32;
    let mut light = problem.source.clone();
    let mut effort = Effort::default();
    let faces = mesh.faces.len() as u32;
    let mut links: Vec<Link> = Vec::new();
    let mut pending: Vec<(u32, u32)> = Vec::new();
    for round in 0..=ROUNDS {
        let [r, g, b] = tree.pull(&light);
        let bright: Vec<f32> = (0..r.len()).map(|e| r[e].max(g[e]).max(b[e])).collect();
        let linker = Linker { factors, tree: &tree, bright: &bright, tolerance };
        let before = links.len();
        let linking = std::time::Instant::now();
        if round == 0 {
            // Faces all against all, row by row.
            let mut rows = Vec::new();
            for first in (1..faces).step_by(64) {
                let chunk: Vec<(Vec<Link>, u64)> = (first..faces.min(first + 64))
                    .into_par_iter()
                    .map(|p| {
                        let mut found = (Vec::new(), 0);
                        (0..p).for_each(|q| linker.link(p, q, &mut found));
                        found
                    })
                    .collect();
                rows.push(chunk);
                let so_far: usize = rows.iter().flatten().map(|(l, _)| l.len()).sum();
                if observer.should_stop() {
                    return Err(Unsolved::Stopped);
                }
                if so_far as u64 > most {
                    return Err(Unsolved::Memory(so_far as u64));
                }
            }
            for (found, rays) in rows.into_iter().flatten() {
                links.extend(found);
                effort.rays += rays;
            }
        } else {
            links.retain(|l| {
                let good = linker.is_good(l.p, l.q, l.spread);
                if !good {
                    pending.push((l.p, l.q));
                }
                good
            });
            if round > 1 && pending.len() < before / 500 {
                // As good as before: they may stay.
                let kept: Vec<(Vec<Link>, u64)> = pending.par_iter().map(|(p, q)| linker.whole(*p, *q)).collect();
                kept.into_iter().for_each(|(l, _)| links.extend(l));
                break;
            }
            for chunk in pending.chunks(1 << 16) {
                let found: Vec<(Vec<Link>, u64)> = chunk
                    .par_iter()
                    .map(|(p, q)| {
                        let mut found = (Vec::new(), 0);
                        linker.cut(*p, *q, &mut found);
                        found
                    })
                    .collect();
                for (found, rays) in found {
                    links.extend(found);
                    effort.rays += rays;
                }
                if observer.should_stop() {
                    return Err(Unsolved::Stopped);
                }
                if links.len() as u64 > most {
                    return Err(Unsolved::Memory(links.len() as u64));
                }
            }
            pending.clear();
        }
        observer.advance(0, effort.rays);
        effort.linking_seconds += linking.elapsed().as_secs_f64();
        let sums = tree.row_sums(&links);
        let scale: Vec<f32> = sums.iter().map(|s| scale_of(*s)).collect();
        for (own, given) in tree.problem.reflectance.iter_mut().zip(&problem.reflectance) {
            own.iter_mut().zip(given).zip(&scale).for_each(|((o, g), s)| *o = g * s);
        }
        let total: f64 = problem.areas.iter().sum();
        effort.closure = Closure {
            least: sums.iter().copied().fold(f64::INFINITY, f64::min),
            mean: sums.iter().zip(&problem.areas).map(|(s, a)| s * a).sum::<f64>() / total,
            most: sums.iter().copied().fold(0.0, f64::max),
            scale,
            rays: effort.rays,
        };
        let (rounds, residual) = tree.solve(&links, &mut light, observer).ok_or(Unsolved::Stopped)?;
        effort.iterations += rounds;
        effort.residual = residual;
    }
    effort.links = links.len() as u64;
    Ok((light, effort))
}

/// Makes links.
struct Linker<'a> {
    factors: &'a FormFactors<'a>,
    tree: &'a Tree<'a>,
    /// The elements' radiance, in their brightest colour.
    bright: &'a [f32],
    tolerance: f32,
}

impl Linker<'_> {
    fn is_good(&self, p: u32, q: u32, spread: f32) -> bool {
        let (p, q) = (p as usize, q as usize);
        let carried = (self.tree.reflectance[p] * self.bright[q]).max(self.tree.reflectance[q] * self.bright[p]);
        carried * spread <= self.tolerance
    }

    /// Links two elements, or parts of them.
    fn link(&self, p: u32, q: u32, found: &mut (Vec<Link>, u64)) {
        let Some((samples, unoccluded)) = self.factors.samples(p as usize, q as usize) else { return };
        found.1 += 16;
        let areas = self.tree.areas[p as usize] * self.tree.areas[q as usize];
        let spread = (f64::from(samples.spread()) * areas) as f32;
        let leaf = |e: u32| self.tree.mesh.elements[e as usize].child == NONE;
        if self.is_good(p, q, spread) || (leaf(p) && leaf(q)) {
            let exchange = self.factors.exchange(p as usize, q as usize, unoccluded, &samples);
            let spread = if leaf(p) && leaf(q) { 0.0 } else { spread };
            if exchange > 0.0 || spread > 0.0 {
                found.0.push(Link { p, q, exchange, spread });
            }
        } else {
            self.cut(p, q, found);
        }
    }

    /// Links the halves of the larger of two elements, or of the one that has any.
    fn cut(&self, p: u32, q: u32, found: &mut (Vec<Link>, u64)) {
        let child = |e: u32| self.tree.mesh.elements[e as usize].child;
        let area = |e: u32| self.tree.areas[e as usize];
        let cut_p = child(q) == NONE || (child(p) != NONE && area(p) >= area(q));
        let (cut, other) = if cut_p { (p, q) } else { (q, p) };
        for half in [child(cut), child(cut) + 1] {
            self.link(half, other, found);
        }
    }

    /// A link that is not cut although it could be.
    fn whole(&self, p: u32, q: u32) -> (Vec<Link>, u64) {
        let Some((samples, unoccluded)) = self.factors.samples(p as usize, q as usize) else { return (Vec::new(), 0) };
        let exchange = self.factors.exchange(p as usize, q as usize, unoccluded, &samples);
        (vec![Link { p, q, exchange, spread: 0.0 }], 16)
    }
}
