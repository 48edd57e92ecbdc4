//! Moving bits, lanes and records on any machine.

use crate::Record;
use wide::{f32x16, u32x16};

/// The bits of every lane in reverse order.
#[inline(always)]
pub(super) fn reverse_bits(x: u32x16) -> u32x16 {
    let swap = |x: u32x16, mask: u32, by: u32| {
        let mask = u32x16::splat(mask);
        ((x >> by) & mask) | ((x & mask) << by)
    };
    let steps = [(0x5555_5555, 1), (0x3333_3333, 2), (0x0f0f_0f0f, 4), (0x00ff_00ff, 8), (0x0000_ffff, 16)];
    steps.into_iter().fold(x, |x, (mask, by)| swap(x, mask, by))
}

/// The lanes whose bits are set, side by side; returns how many they are. What is behind them is unspecified.
#[inline(always)]
pub(super) fn compress(x: f32x16, bits: u32, to: &mut [f32; 16]) -> usize {
    let mut n = 0;
    for (lane, value) in x.as_array().iter().enumerate() {
        to[n.min(15)] = *value;
        n += (bits >> lane & 1) as usize;
    }
    n
}

/// The first, second, third and fourth numbers of the records at these places.
///
/// # Safety
/// The places are in the table.
#[inline(always)]
pub(super) unsafe fn records(table: &[Record], at: &[u32; 16]) -> [f32x16; 4] {
    let mut out = [[0.0; 16]; 4];
    for lane in 0..16 {
        // SAFETY: the places are in the table (caller).
        let record = unsafe { table.get_unchecked(at[lane] as usize).0 };
        for word in 0..4 {
            out[word][lane] = record[word];
        }
    }
    out.map(f32x16::new)
}
