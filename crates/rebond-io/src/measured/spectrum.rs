//! Reflectance spectra to linear Rec. 709, under daylight D65 (CIE 015:2018): grey stays grey.

/// From 380 nm on in steps of 10: x̄, ȳ, z̄ of the CIE 1931 standard observer (2°), and the standard illuminant D65.
const STANDARDS: [[f64; 4]; 41] = [
    [0.001368, 0.000039, 0.00645, 49.9755],
    [0.004243, 0.00012, 0.02005, 54.6482],
    [0.01431, 0.000396, 0.06785, 82.7549],
    [0.04351, 0.00121, 0.2074, 91.486],
    [0.13438, 0.004, 0.6456, 93.4318],
    [0.2839, 0.0116, 1.3856, 86.6823],
    [0.34828, 0.023, 1.74706, 104.865],
    [0.3362, 0.038, 1.77211, 117.008],
    [0.2908, 0.06, 1.6692, 117.812],
    [0.19536, 0.09098, 1.28764, 114.861],
    [0.09564, 0.13902, 0.81295, 115.923],
    [0.03201, 0.20802, 0.46518, 108.811],
    [0.0049, 0.323, 0.272, 109.354],
    [0.0093, 0.503, 0.1582, 107.802],
    [0.06327, 0.71, 0.07825, 104.79],
    [0.1655, 0.862, 0.04216, 107.689],
    [0.2904, 0.954, 0.0203, 104.405],
    [0.43345, 0.99495, 0.00875, 104.046],
    [0.5945, 0.995, 0.0039, 100.0],
    [0.7621, 0.952, 0.0021, 96.3342],
    [0.9163, 0.87, 0.00165, 95.788],
    [1.0263, 0.757, 0.0011, 88.6856],
    [1.0622, 0.631, 0.0008, 90.0062],
    [1.0026, 0.503, 0.00034, 89.5991],
    [0.85445, 0.381, 0.00019, 87.6987],
    [0.6424, 0.265, 0.00005, 83.2886],
    [0.4479, 0.175, 0.00002, 83.6992],
    [0.2835, 0.107, 0.0, 80.0268],
    [0.1649, 0.061, 0.0, 80.2146],
    [0.0874, 0.032, 0.0, 82.2778],
    [0.04677, 0.017, 0.0, 78.2842],
    [0.0227, 0.00821, 0.0, 69.7213],
    [0.011359, 0.004102, 0.0, 71.6091],
    [0.00579, 0.002091, 0.0, 74.349],
    [0.002899, 0.001047, 0.0, 61.604],
    [0.00144, 0.00052, 0.0, 69.8856],
    [0.00069, 0.000249, 0.0, 75.087],
    [0.000332, 0.00012, 0.0, 63.5927],
    [0.000166, 0.00006, 0.0, 46.4182],
    [0.000083, 0.00003, 0.0, 66.8054],
    [0.000042, 0.000015, 0.0, 63.3828],
];

/// XYZ to linear Rec. 709.
const TO_RGB: [[f64; 3]; 3] = [
    [3.240_454_2, -1.537_138_5, -0.498_531_4],
    [-0.969_266, 1.876_010_8, 0.041_556],
    [0.055_643_4, -0.204_025_9, 1.057_225_2],
];

/// What each wavelength (nm, growing) adds to red, green and blue, for a spectrum that is linear between them and constant
/// beyond them. The weights of each channel add up to 1.
pub(super) fn weights(wavelengths: &[f32]) -> Vec<[f64; 3]> {
    let mut weights = vec![[0.0; 3]; wavelengths.len()];
    for nm in 380..=780_u32 {
        let (i, part) = (((nm - 380) / 10) as usize, f64::from(nm % 10) / 10.0);
        let (a, b) = (STANDARDS[i], STANDARDS[(i + 1).min(40)]);
        let standard = |k: usize| a[k] + (b[k] - a[k]) * part;
        let xyz = [0, 1, 2].map(|k| standard(k) * standard(3));
        let rgb = TO_RGB.map(|row| row[0] * xyz[0] + row[1] * xyz[1] + row[2] * xyz[2]);
        let nm = f64::from(nm);
        let after = wavelengths.partition_point(|w| f64::from(*w) <= nm);
        let (low, high) = (after.saturating_sub(1), after.min(wavelengths.len() - 1));
        let (from, to) = (f64::from(wavelengths[low]), f64::from(wavelengths[high]));
        let part = if to > from { ((nm - from) / (to - from)).clamp(0.0, 1.0) } else { 0.0 };
        for c in 0..3 {
            weights[low][c] += rgb[c] * (1.0 - part);
            weights[high][c] += rgb[c] * part;
        }
    }
    let sums = [0, 1, 2].map(|c| weights.iter().map(|w| w[c]).sum::<f64>());
    weights.iter().map(|w| std::array::from_fn(|c| w[c] / sums[c])).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn color(wavelengths: &[f32], spectrum: impl Fn(f32) -> f64) -> [f64; 3] {
        let mut sum = [0.0; 3];
        for (nm, weight) in wavelengths.iter().zip(weights(wavelengths)) {
            (0..3).for_each(|c| sum[c] += spectrum(*nm) * weight[c]);
        }
        sum
    }

    #[test]
    fn grey_stays_grey_and_hues_are_what_they_are() {
        let even: Vec<f32> = (0..81).map(|i| 380.0 + 5.0 * i as f32).collect();
        let uneven = [400.0, 450.0, 500.0, 530.0, 580.0, 600.0, 700.0];
        for wavelengths in [&even[..], &uneven, &[550.0]] {
            for channel in color(wavelengths, |_| 0.5) {
                assert!((channel - 0.5).abs() < 1e-12);
            }
        }
        let [r, g, b] = color(&even, |nm| f64::from(u8::from(nm > 600.0)));
        assert!(r > 0.5 && r > 5.0 * g && g.abs() < 0.2 && b.abs() < 0.05, "{r} {g} {b}");
        let [r, g, b] = color(&even, |nm| f64::from(u8::from(nm < 480.0)));
        assert!(b > 0.7 && r < 0.2 && g < 0.2, "{r} {g} {b}");
        // Linear spectra do not hang on where they were sampled.
        let (fine, coarse) = (color(&even, f64::from), color(&[380.0, 780.0], f64::from));
        assert!((0..3).all(|c| (fine[c] / coarse[c] - 1.0).abs() < 1e-9), "{fine:?} {coarse:?}");
    }

    #[test]
    fn white_is_the_white_of_rec_709() {
        // Before channels are normalised: x = 0.3127, y = 0.3290 is what the matrix takes for white.
        let mut xyz = [0.0; 3];
        for [x, y, z, d65] in STANDARDS {
            [x, y, z].iter().zip(&mut xyz).for_each(|(s, sum)| *sum += s * d65);
        }
        let sum: f64 = xyz.iter().sum();
        assert!((xyz[0] / sum - 0.3127).abs() < 2e-4 && (xyz[1] / sum - 0.3290).abs() < 2e-4, "{xyz:?}");
    }
}
