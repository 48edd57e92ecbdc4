//! All points within one radius: a hashed grid of cells twice as wide.
//!
//! Points are sorted by cell, cells that follow each other along x beside each other, so that the two of them that a query meets
//! are one run. Of the table's runs a query reads four; what else the hash brings there is told apart by its place.

use rebond_lanes::prefetch;
use std::sync::atomic::{AtomicU64, Ordering};

/// Something that has a place.
pub trait Placed: Copy + Default + Send + Sync {
    /// Where.
    fn place(&self) -> [f32; 3];
}

/// Points, ready to be asked. Its memory is kept when it is filled again.
#[derive(Debug, Default)]
pub struct PointGrid<T> {
    /// Cell by cell.
    items: Vec<T>,
    /// Where they are: most that a query looks at are too far away, and this is all it needs to know.
    places: Vec<[f32; 3]>,
    /// Bit by bit, which of them were of use to somebody.
    used: Vec<AtomicU64>,
    /// Where the items of each cell begin; one number more than there are cells.
    starts: Vec<u32>,
    /// Cell of each item, as they came.
    cells: Vec<u32>,
    mask: u32,
    /// 1 / side of a cell.
    scale: f32,
    squared_radius: f32,
}

/// What a query looks at: first at cells, then at the items in them. Both are far apart in memory, so each is asked for before it is
/// needed; what the caller does between the steps hides the wait.
#[derive(Clone, Copy, Debug, Default)]
pub struct Query {
    p: [f32; 3],
    runs: [Run; 4],
}

/// Items of two cells beside each other.
#[derive(Clone, Copy, Debug, Default)]
struct Run {
    /// The first cell.
    cell: u32,
    /// Its items, and those of the second.
    from: u32,
    to: u32,
    /// Where the cells are along y and z.
    row: [i32; 2],
}

/// The cell of whole coordinates.
#[inline(always)]
fn row(y: i32, z: i32) -> u32 {
    (y as u32).wrapping_mul(0x9e37_79b1) ^ (z as u32).wrapping_mul(0x85eb_ca6b).rotate_left(13)
}

/// Does jobs, each on a thread of its own, the last on this one.
fn side_by_side<J: Send, R: Send>(jobs: impl Iterator<Item = J>, work: impl Fn(J) -> R + Sync) -> Vec<R> {
    let mut jobs: Vec<J> = jobs.collect();
    let Some(last) = jobs.pop() else { return Vec::new() };
    std::thread::scope(|scope| {
        let others: Vec<_> = jobs.into_iter().map(|job| scope.spawn(|| work(job))).collect();
        let result = work(last);
        others.into_iter().map(|job| job.join().expect("no job panics")).chain([result]).collect()
    })
}

impl<T: Placed> PointGrid<T> {
    /// Fills it anew with the items of these parts, to be asked with this radius. The order within a cell is the order of the
    /// parts, whatever the number of threads.
    pub fn fill(&mut self, parts: &[&[T]], radius: f32, threads: usize) {
        let count = parts.iter().map(|p| p.len()).sum::<usize>();
        // A thread is not begun for less.
        let threads = threads.clamp(1, 1 + count / 8192);
        let table = count.next_power_of_two().max(2);
        self.mask = table as u32 - 1;
        self.scale = 0.5 / radius;
        self.squared_radius = radius * radius;
        self.items.resize(count, T::default());
        self.places.resize(count, [0.0; 3]);
        self.cells.resize(count, 0);
        self.used.clear();
        self.used.resize_with(count.div_ceil(64), AtomicU64::default);
        self.starts.clear();
        self.starts.resize(table + 1, 0);

        // The cell of each item, part by part.
        let (scale, mask) = (self.scale, self.mask);
        let mut rest = &mut self.cells[..];
        let mut of_parts = Vec::with_capacity(parts.len());
        for part in parts {
            let (cells, after) = rest.split_at_mut(part.len());
            of_parts.push((*part, cells));
            rest = after;
        }
        let share = parts.len().div_ceil(threads).max(1);
        side_by_side(of_parts.chunks_mut(share), |run| {
            for (items, cells) in run {
                for (item, cell) in items.iter().zip(cells.iter_mut()) {
                    let [x, y, z] = item.place().map(|c| (c * scale).floor() as i32);
                    *cell = (x as u32).wrapping_add(row(y, z)) & mask;
                }
            }
        });

        // Each thread counts, then places, what falls into its share of the table.
        let (cells, threads) = (&self.cells[..], threads.min(64));
        let share = table.div_ceil(threads);
        let shares = self.starts[..table].chunks_mut(share).enumerate();
        let totals: Vec<u32> = side_by_side(shares, |(number, counts)| {
            let first = (number * share) as u32;
            for cell in cells {
                if let Some(count) = counts.get_mut(cell.wrapping_sub(first) as usize) {
                    *count += 1;
                }
            }
            counts.iter().sum()
        });
        let (mut items, mut places, mut before) = (&mut self.items[..], &mut self.places[..], 0);
        let shares = self.starts[..table].chunks_mut(share).zip(totals).enumerate().map(|(number, (starts, total))| {
            let (own, after) = std::mem::take(&mut items).split_at_mut(total as usize);
            items = after;
            let (own_places, after) = std::mem::take(&mut places).split_at_mut(total as usize);
            places = after;
            let base = before;
            before += total;
            ((number * share) as u32, base, starts, own, own_places)
        });
        side_by_side(shares, |(first, base, starts, own, own_places)| {
            // Ends first; filled from the back they become beginnings.
            let mut end = base;
            for start in starts.iter_mut() {
                end += *start;
                *start = end;
            }
            let all = parts.iter().rev().flat_map(|part| part.iter().rev());
            for (item, cell) in all.zip(cells.iter().rev()) {
                if let Some(start) = starts.get_mut(cell.wrapping_sub(first) as usize) {
                    *start -= 1;
                    own[(*start - base) as usize] = *item;
                    own_places[(*start - base) as usize] = item.place();
                }
            }
        });
        self.starts[table] = count as u32;
    }

    /// Begins to look around p: two cells along each axis.
    #[inline(always)]
    pub fn ask(&self, p: [f32; 3]) -> Query {
        let [x, y, z] = p.map(|c| (c * self.scale - 0.5).floor() as i32);
        let runs = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(dy, dz)| {
            let row_of = [y.wrapping_add(dy), z.wrapping_add(dz)];
            let cell = (x as u32).wrapping_add(row(row_of[0], row_of[1])) & self.mask;
            self.starts.get(cell as usize).map(prefetch);
            Run { cell, from: 0, to: 0, row: row_of }
        });
        Query { p, runs }
    }

    /// Goes on with queries: where the items are.
    #[inline(always)]
    pub fn find(&self, query: &mut Query) {
        for run in query.runs.iter_mut().filter(|_| !self.items.is_empty()) {
            let last = if run.cell == self.mask { run.cell + 1 } else { run.cell + 2 };
            (run.from, run.to) = (self.starts[run.cell as usize], self.starts[last as usize]);
            self.places.get(run.from as usize).map(prefetch);
        }
    }

    /// Calls `f` for each item within the radius of the query's place, with its number (for [`PointGrid::item`]) and the squared
    /// distance. Items are far apart, too: whoever reads them should first know them all.
    #[inline(always)]
    pub fn within(&self, query: &Query, mut f: impl FnMut(u32, f32)) {
        for run in query.runs.iter().filter(|_| !self.items.is_empty()) {
            let mut look = |from: u32, to: u32| {
                for (at, q) in (from..).zip(&self.places[from as usize..to as usize]) {
                    let [dx, dy, dz] = [q[0] - query.p[0], q[1] - query.p[1], q[2] - query.p[2]];
                    let d2 = dx * dx + dy * dy + dz * dz;
                    // Two rows may share cells: each counts its own.
                    if d2 < self.squared_radius && [self.cell(q[1]), self.cell(q[2])] == run.row {
                        f(at, d2);
                    }
                }
            };
            look(run.from, run.to);
            // The cell beside the last is the first.
            if run.cell == self.mask {
                look(0, self.starts[1]);
            }
        }
    }

    /// The cell along one axis.
    #[inline(always)]
    fn cell(&self, c: f32) -> i32 {
        (c * self.scale).floor() as i32
    }

    /// The item of this number.
    pub fn item(&self, number: u32) -> &T {
        &self.items[number as usize]
    }

    /// Notes that the item of this number was of use.
    #[inline(always)]
    pub fn use_item(&self, number: u32) {
        // Most were before, and what is only read all threads can have beside them.
        let (used, bit) = (&self.used[number as usize / 64], 1 << (number % 64));
        if used.load(Ordering::Relaxed) & bit == 0 {
            used.fetch_or(bit, Ordering::Relaxed);
        }
    }

    /// How many items were of use to nobody.
    pub fn unused(&self) -> usize {
        self.len() - self.used.iter().map(|used| used.load(Ordering::Relaxed).count_ones() as usize).sum::<usize>()
    }

    /// How many items.
    pub fn len(&self) -> usize {
        self.items.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.items.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::seeded_pairs;

    impl Placed for [f32; 3] {
        fn place(&self) -> [f32; 3] {
            *self
        }
    }

    fn points(n: u32, seed: u64) -> Vec<[f32; 3]> {
        let pairs = seeded_pairs(n, seed).zip(seeded_pairs(n, seed + 1));
        pairs.map(|([x, y], [z, flat])| [x - 0.5, y - 0.5, if flat < 0.5 { 0.0 } else { z - 0.5 }]).collect()
    }

    /// All that are within, each once, in small tables too, where rows collide; in one order for any number of threads.
    #[test]
    fn finds_what_brute_force_finds() {
        for (n, radius) in [(0, 0.1_f32), (1, 0.1), (3, 1.0), (40, 0.3), (3000, 2.0), (40_000, 0.03)] {
            let all = points(n, 1);
            let parts: Vec<&[[f32; 3]]> = all.chunks(7).collect();
            let (mut grid, mut same) = (PointGrid::default(), PointGrid::default());
            // What was there before is forgotten.
            grid.fill(&[&points(50, 9)], 0.5, 1);
            grid.fill(&parts, radius, 1);
            same.fill(&parts, radius, 5);
            assert_eq!((&grid.items, &grid.starts), (&same.items, &same.starts));
            let asked = points(200, 5);
            let mut all_found = vec![Vec::new(); asked.len()];
            for (p, found) in asked.iter().zip(&mut all_found) {
                let mut query = grid.ask(*p);
                grid.find(&mut query);
                grid.within(&query, |item, _| found.push(grid.item(item).map(f32::to_bits)));
            }
            for (q, mut found) in asked.into_iter().zip(all_found) {
                let d2 = |p: &[f32; 3]| (0..3).map(|i| (p[i] - q[i]) * (p[i] - q[i])).sum::<f32>();
                let near = all.iter().filter(|p| d2(p) < radius * radius);
                let mut expected: Vec<_> = near.map(|p| p.map(f32::to_bits)).collect();
                found.sort_unstable();
                expected.sort_unstable();
                assert_eq!(found, expected, "{n} points, radius {radius}");
            }
        }
    }
}
