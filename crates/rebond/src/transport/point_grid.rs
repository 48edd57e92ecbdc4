//! All points within one radius: a hashed grid of cells twice as wide.
//!
//! Points are sorted by cell, cells that follow each other along x beside each other, so that the two of them that a query meets
//! are one run. Of the table's runs a query reads four; what else the hash brings there is told apart by its place.

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
    /// Where the items of each cell begin; one number more than there are cells.
    starts: Vec<u32>,
    /// Cell of each item, as they came.
    cells: Vec<u32>,
    mask: u32,
    /// 1 / side of a cell.
    scale: f32,
    squared_radius: f32,
}

/// Items of two cells beside each other.
#[derive(Clone, Copy, Debug, Default)]
struct Run {
    from: u32,
    to: u32,
    /// Where the cells are along y and z.
    row: [i32; 2],
    /// Whether the second is the first of the table.
    wraps: bool,
}

/// The cell of whole coordinates.
#[inline(always)]
fn row(y: i32, z: i32) -> u32 {
    (y as u32).wrapping_mul(0x9e37_79b1) ^ (z as u32).wrapping_mul(0x85eb_ca6b).rotate_left(13)
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
        std::thread::scope(|scope| {
            for run in of_parts.chunks_mut(share) {
                scope.spawn(move || {
                    for (items, cells) in run {
                        for (item, cell) in items.iter().zip(cells.iter_mut()) {
                            let [x, y, z] = item.place().map(|c| (c * scale).floor() as i32);
                            *cell = (x as u32).wrapping_add(row(y, z)) & mask;
                        }
                    }
                });
            }
        });

        // Each thread counts, then places, what falls into its share of the table.
        let (cells, threads) = (&self.cells[..], threads.min(64));
        let share = table.div_ceil(threads);
        let totals: Vec<u32> = std::thread::scope(|scope| {
            let count = |(number, counts): (usize, &mut [u32])| {
                let first = (number * share) as u32;
                for cell in cells {
                    if let Some(count) = counts.get_mut(cell.wrapping_sub(first) as usize) {
                        *count += 1;
                    }
                }
                counts.iter().sum()
            };
            let shares = self.starts[..table].chunks_mut(share).enumerate();
            let jobs: Vec<_> = shares.map(|counts| scope.spawn(move || count(counts))).collect();
            jobs.into_iter().map(|job| job.join().expect("counting does not fail")).collect()
        });
        std::thread::scope(|scope| {
            let (mut items, mut places, mut before) = (&mut self.items[..], &mut self.places[..], 0);
            for (number, (starts, total)) in self.starts[..table].chunks_mut(share).zip(totals).enumerate() {
                let (own, after) = items.split_at_mut(total as usize);
                items = after;
                let (own_places, after) = places.split_at_mut(total as usize);
                places = after;
                let (first, base) = ((number * share) as u32, before);
                before += total;
                scope.spawn(move || {
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
            }
        });
        self.starts[table] = count as u32;
    }

    /// Calls `f` for each item within the radius of each of these places, place by place, with the place's number, the item's
    /// (for [`PointGrid::item`]) and the squared distance. What is waited for is memory, so the runs of many places are looked up
    /// before the first is read; whoever reads items should first know them all, too.
    #[inline(always)]
    pub fn within(&self, places: &[[f32; 3]], mut f: impl FnMut(usize, u32, f32)) {
        const MANY: usize = 16;
        if self.items.is_empty() {
            return;
        }
        for (part, number) in places.chunks(MANY).zip((0..).step_by(MANY)) {
            let mut runs = [[Run::default(); 4]; MANY];
            for (p, runs) in part.iter().zip(&mut runs) {
                *runs = self.runs(*p);
            }
            let first = |run: &Run| self.places.get(run.from as usize).map_or(0, |p| p[0].to_bits());
            std::hint::black_box(runs[..part.len()].iter().flatten().fold(0, |all, run| all ^ first(run)));
            for (number, (p, runs)) in (number..).zip(part.iter().zip(&runs)) {
                for run in runs {
                    let mut look = |from: u32, to: u32| {
                        for (at, q) in (from..).zip(&self.places[from as usize..to as usize]) {
                            let [dx, dy, dz] = [q[0] - p[0], q[1] - p[1], q[2] - p[2]];
                            let d2 = dx * dx + dy * dy + dz * dz;
                            // Two rows may share cells: each counts its own.
                            if d2 < self.squared_radius && [self.cell(q[1]), self.cell(q[2])] == run.row {
                                f(number, at, d2);
                            }
                        }
                    };
                    look(run.from, run.to);
                    if run.wraps {
                        look(0, self.starts[1]);
                    }
                }
            }
        }
    }

    /// The runs of cells that a ball around p meets: two cells along each axis.
    #[inline(always)]
    fn runs(&self, p: [f32; 3]) -> [Run; 4] {
        let [x, y, z] = p.map(|c| (c * self.scale - 0.5).floor() as i32);
        [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(dy, dz)| {
            let row_of = [y.wrapping_add(dy), z.wrapping_add(dz)];
            let first = (x as u32).wrapping_add(row(row_of[0], row_of[1])) & self.mask;
            let wraps = first == self.mask;
            let last = if wraps { first + 1 } else { first + 2 };
            Run { from: self.starts[first as usize], to: self.starts[last as usize], row: row_of, wraps }
        })
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
            grid.within(&asked, |number, item, _| all_found[number].push(grid.item(item).map(f32::to_bits)));
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
