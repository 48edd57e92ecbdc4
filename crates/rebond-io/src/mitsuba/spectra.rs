//! Spectra as Mitsuba's `rgb` variants read them: integrated once, when the scene is loaded, into linear Rec. 709.
//!
//! ```text
//! XYZ = Δλ / Y₀ Σ s(λᵢ) x̄ȳz̄(λᵢ) [d(λᵢ)],    λᵢ = 360 … 830 nm, a thousand of them
//! ```
//!
//! s is linear between its samples and 0 beyond them. Reflectances and indices of refraction are seen under d, daylight D65 scaled to
//! what keeps white white; light is what it is. Y₀ is the integral of ȳ. Negative channels become 0, and what must be a
//! reflectance is cut off at 1. So much for lists; one value for all wavelengths is that grey if it reflects, and the colour of
//! XYZ = (1, 1, 1) if it shines.

/// From 360 nm on in steps of 5: x̄, ȳ, z̄ of the CIE 1931 standard observer (2°), and the standard illuminant D65 (CIE
/// 015:2018).
const STANDARDS: [[f64; 4]; 95] = [
    [0.0001299, 0.000003917, 0.0006061, 46.6383],
    [0.0002321, 0.000006965, 0.001086, 49.3637],
    [0.0004149, 0.00001239, 0.001946, 52.0891],
    [0.0007416, 0.00002202, 0.003486, 51.0323],
    [0.001368, 0.000039, 0.00645, 49.9755],
    [0.002236, 0.000064, 0.01055, 52.3118],
    [0.004243, 0.00012, 0.02005, 54.6482],
    [0.00765, 0.000217, 0.03621, 68.7015],
    [0.01431, 0.000396, 0.06785, 82.7549],
    [0.02319, 0.00064, 0.1102, 87.1204],
    [0.04351, 0.00121, 0.2074, 91.486],
    [0.07763, 0.00218, 0.3713, 92.4589],
    [0.13438, 0.004, 0.6456, 93.4318],
    [0.21477, 0.0073, 1.03905, 90.057],
    [0.2839, 0.0116, 1.3856, 86.6823],
    [0.3285, 0.01684, 1.62296, 95.7736],
    [0.34828, 0.023, 1.74706, 104.865],
    [0.34806, 0.0298, 1.7826, 110.936],
    [0.3362, 0.038, 1.77211, 117.008],
    [0.3187, 0.048, 1.7441, 117.41],
    [0.2908, 0.06, 1.6692, 117.812],
    [0.2511, 0.0739, 1.5281, 116.336],
    [0.19536, 0.09098, 1.28764, 114.861],
    [0.1421, 0.1126, 1.0419, 115.392],
    [0.09564, 0.13902, 0.81295, 115.923],
    [0.05795, 0.1693, 0.6162, 112.367],
    [0.03201, 0.20802, 0.46518, 108.811],
    [0.0147, 0.2586, 0.3533, 109.082],
    [0.0049, 0.323, 0.272, 109.354],
    [0.0024, 0.4073, 0.2123, 108.578],
    [0.0093, 0.503, 0.1582, 107.802],
    [0.0291, 0.6082, 0.1117, 106.296],
    [0.06327, 0.71, 0.07825, 104.79],
    [0.1096, 0.7932, 0.05725, 106.239],
    [0.1655, 0.862, 0.04216, 107.689],
    [0.22575, 0.91485, 0.02984, 106.047],
    [0.2904, 0.954, 0.0203, 104.405],
    [0.3597, 0.9803, 0.0134, 104.225],
    [0.43345, 0.99495, 0.00875, 104.046],
    [0.51205, 1.0, 0.00575, 102.023],
    [0.5945, 0.995, 0.0039, 100.0],
    [0.6784, 0.9786, 0.00275, 98.1671],
    [0.7621, 0.952, 0.0021, 96.3342],
    [0.8425, 0.9154, 0.0018, 96.0611],
    [0.9163, 0.87, 0.00165, 95.788],
    [0.9786, 0.8163, 0.0014, 92.2368],
    [1.0263, 0.757, 0.0011, 88.6856],
    [1.0567, 0.6949, 0.001, 89.3459],
    [1.0622, 0.631, 0.0008, 90.0062],
    [1.0456, 0.5668, 0.0006, 89.8026],
    [1.0026, 0.503, 0.00034, 89.5991],
    [0.9384, 0.4412, 0.00024, 88.6489],
    [0.85445, 0.381, 0.00019, 87.6987],
    [0.7514, 0.321, 0.0001, 85.4936],
    [0.6424, 0.265, 0.00005, 83.2886],
    [0.5419, 0.217, 0.00003, 83.4939],
    [0.4479, 0.175, 0.00002, 83.6992],
    [0.3608, 0.1382, 0.00001, 81.863],
    [0.2835, 0.107, 0.0, 80.0268],
    [0.2187, 0.0816, 0.0, 80.1207],
    [0.1649, 0.061, 0.0, 80.2146],
    [0.1212, 0.04458, 0.0, 81.2462],
    [0.0874, 0.032, 0.0, 82.2778],
    [0.0636, 0.0232, 0.0, 80.281],
    [0.04677, 0.017, 0.0, 78.2842],
    [0.0329, 0.01192, 0.0, 74.0027],
    [0.0227, 0.00821, 0.0, 69.7213],
    [0.01584, 0.005723, 0.0, 70.6652],
    [0.0113592, 0.004102, 0.0, 71.6091],
    [0.00811092, 0.002929, 0.0, 72.979],
    [0.00579035, 0.002091, 0.0, 74.349],
    [0.00410946, 0.001484, 0.0, 67.9765],
    [0.00289933, 0.001047, 0.0, 61.604],
    [0.00204919, 0.00074, 0.0, 65.7448],
    [0.00143997, 0.00052, 0.0, 69.8856],
    [0.000999949, 0.0003611, 0.0, 72.4863],
    [0.000690079, 0.0002492, 0.0, 75.087],
    [0.000476021, 0.0001719, 0.0, 69.3398],
    [0.000332301, 0.00012, 0.0, 63.5927],
    [0.000234826, 0.0000848, 0.0, 55.0054],
    [0.00016615, 0.00006, 0.0, 46.4182],
    [0.000117413, 0.0000424, 0.0, 56.6118],
    [0.0000830753, 0.00003, 0.0, 66.8054],
    [0.0000587065, 0.0000212, 0.0, 65.0941],
    [0.0000415099, 0.00001499, 0.0, 63.3828],
    [0.0000293533, 0.0000106, 0.0, 63.8434],
    [0.0000206738, 0.0000074657, 0.0, 64.304],
    [0.0000145598, 0.0000052578, 0.0, 61.8779],
    [0.000010254, 0.0000037029, 0.0, 59.4519],
    [0.00000722146, 0.0000026078, 0.0, 55.7054],
    [0.00000508587, 0.0000018366, 0.0, 51.959],
    [0.00000358165, 0.0000012934, 0.0, 54.6998],
    [0.00000252252, 0.00000091093, 0.0, 57.4406],
    [0.00000177651, 0.00000064153, 0.0, 58.8765],
    [0.00000125114, 0.00000045181, 0.0, 60.3125],
];

const FIRST: f64 = 360.0;
const LAST: f64 = 830.0;
const SAMPLES: usize = 1000;

/// The integral of ȳ by which light of spectrum 1 has the luminance 1; and what D65 is divided by for the same.
const LUMINANCE: f64 = 106.750_259_399_414_06;
const DAYLIGHT: f64 = 98.997_410_689_307_61;

/// XYZ to linear Rec. 709.
const TO_RGB: [[f64; 3]; 3] =
    [[3.240_479, -1.537_150, -0.498_535], [-0.969_256, 1.875_991, 0.041_556], [0.055_648, -0.204_043, 1.057_311]];

fn to_rgb(xyz: [f64; 3]) -> [f64; 3] {
    TO_RGB.map(|row| (row[0] * xyz[0] + row[1] * xyz[1] + row[2] * xyz[2]).max(0.0))
}

/// What a spectrum stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Use {
    /// A share of light, in [0, 1].
    Reflectance,
    /// Any other property of a surface, such as an index of refraction.
    Unbounded,
    /// Light.
    Light,
}

/// The colour of a spectrum that is the same at all wavelengths.
pub fn flat(value: f64, purpose: Use) -> [f64; 3] {
    match purpose {
        Use::Light => to_rgb([1.0; 3]).map(|x| x * value),
        Use::Reflectance | Use::Unbounded => [value; 3],
    }
}

/// The colour of a spectrum of values at growing wavelengths (nm).
pub fn of_samples(samples: &[(f64, f64)], purpose: Use) -> [f64; 3] {
    let value = |nm: f64| {
        let after = samples.partition_point(|(w, _)| *w <= nm);
        match (after.checked_sub(1).map(|i| samples[i]), samples.get(after)) {
            (Some((a, x)), Some(&(b, y))) => x + (y - x) * (nm - a) / (b - a),
            (Some((a, x)), None) if a == nm => x,
            _ => 0.0,
        }
    };
    integrate(value, purpose)
}

/// The colour of a black body's light, which has the radiance of Planck's law: per nanometre, W·sr⁻¹·m⁻²·nm⁻¹.
pub fn blackbody(kelvin: f64) -> [f64; 3] {
    const C: f64 = 299_792_458.0;
    const H: f64 = 6.626_070_15e-34;
    const K: f64 = 1.380_649e-23;
    let planck = |nm: f64| {
        let m = nm * 1e-9;
        1e-9 * 2.0 * H * C * C / (m.powi(5) * (H * C / (m * K * kelvin)).exp_m1())
    };
    integrate(planck, Use::Light)
}

fn integrate(value: impl Fn(f64) -> f64, purpose: Use) -> [f64; 3] {
    let mut xyz = [0.0; 3];
    for i in 0..SAMPLES {
        let nm = FIRST + (LAST - FIRST) * i as f64 / (SAMPLES - 1) as f64;
        let at = (nm - FIRST) / 5.0;
        let (i, part) = ((at as usize).min(STANDARDS.len() - 2), at - (at as usize).min(STANDARDS.len() - 2) as f64);
        let standard = |k: usize| STANDARDS[i][k] + (STANDARDS[i + 1][k] - STANDARDS[i][k]) * part;
        let light = if purpose == Use::Light { 1.0 } else { standard(3) / DAYLIGHT };
        let weight = value(nm) * light;
        (0..3).for_each(|k| xyz[k] += standard(k) * weight);
    }
    let rgb = to_rgb(xyz.map(|x| x * (LAST - FIRST) / SAMPLES as f64 / LUMINANCE));
    match purpose {
        Use::Reflectance => rgb.map(|x| x.min(1.0)),
        Use::Unbounded | Use::Light => rgb,
    }
}

/// Reads an `.spd` file: a wavelength (nm) and a value to a line; `#` begins a comment.
pub fn read_spd(bytes: &[u8]) -> Result<Vec<(f64, f64)>, String> {
    let text = std::str::from_utf8(bytes).map_err(|_| "not a spectrum: it is not text")?;
    let mut pairs = Vec::new();
    for (i, line) in text.lines().enumerate() {
        let line = line.split('#').next().unwrap_or_default();
        let words: Vec<&str> = line.split_whitespace().collect();
        match words[..] {
            [] => {}
            [wavelength, value] => {
                let number = |word: &str| match word.parse::<f64>() {
                    Ok(x) if x.is_finite() => Ok(x),
                    _ => Err(format!("line {}: \"{word}\" is not a number", i + 1)),
                };
                pairs.push((number(wavelength)?, number(value)?));
            }
            _ => return Err(format!("line {}: expected a wavelength and a value", i + 1)),
        }
    }
    if pairs.is_empty() {
        return Err("there are no values in it".into());
    }
    Ok(pairs)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn near(a: [f64; 3], b: [f64; 3], tolerance: f64) -> bool {
        a.iter().zip(b).all(|(a, b)| (a - b).abs() <= tolerance * b.abs().max(1e-3))
    }

    #[test]
    fn grey_stays_grey_and_even_light_is_warm() {
        assert_eq!(flat(0.3, Use::Reflectance), [0.3; 3]);
        // Seen under daylight a grey list is that grey, but for how finely it is summed.
        assert!(near(of_samples(&[(300.0, 0.5), (900.0, 0.5)], Use::Reflectance), [0.5; 3], 2e-3));
        let even = flat(2.0, Use::Light);
        assert!(near(of_samples(&[(300.0, 2.0), (900.0, 2.0)], Use::Light), even, 2e-3));
        // The row sums of the matrix.
        assert!(near(even, [2.409_588, 1.896_582, 1.817_832], 1e-6), "{even:?}");
        assert!(of_samples(&[(300.0, 9.0), (900.0, 9.0)], Use::Unbounded)[0] > 8.9);
        assert_eq!(of_samples(&[(300.0, 9.0), (900.0, 9.0)], Use::Reflectance), [1.0; 3]);
    }

    #[test]
    fn lists_are_what_mitsuba_makes_of_them() {
        let list = [(400.0, 0.1), (500.0, 0.5), (600.0, 0.9), (700.0, 0.2)];
        // By Mitsuba 3.9.1's scalar_rgb.
        assert!(near(of_samples(&list, Use::Reflectance), [0.833_825_8, 0.689_121_5, 0.265_242_6], 1e-5));
        assert!(near(of_samples(&list, Use::Light), [0.974_323_7, 0.661_608_1, 0.229_710_8], 1e-5));
        let line = of_samples(&[(499.0, 0.0), (500.0, 10.0), (501.0, 0.0)], Use::Light);
        assert!(near(line, [0.0, 0.057_214_8, 0.020_770_4], 1e-4), "no channel is negative: {line:?}");
    }

    #[test]
    fn black_bodies_obey_their_laws() {
        // The chromaticity of Planck's locus at 6500 K and 2856 K (CIE illuminant A).
        for (kelvin, x, y) in [(6500.0, 0.3135, 0.3237), (2856.0, 0.4476, 0.4074)] {
            let rgb = blackbody(kelvin);
            let m = [
                [0.412_453, 0.357_580, 0.180_423],
                [0.212_671, 0.715_160, 0.072_169],
                [0.019_334, 0.119_193, 0.950_227],
            ];
            let xyz = m.map(|row| row[0] * rgb[0] + row[1] * rgb[1] + row[2] * rgb[2]);
            let sum: f64 = xyz.iter().sum();
            assert!((xyz[0] / sum - x).abs() < 5e-4 && (xyz[1] / sum - y).abs() < 5e-4, "{kelvin} K: {xyz:?}");
        }
        // Where hν ≫ kT doubling nothing but T multiplies by Wien's exponential; in the limit of heat, Rayleigh and Jeans: ∝ T.
        let ratio = blackbody(2e7)[1] / blackbody(1e7)[1];
        assert!((ratio - 2.0).abs() < 2e-2, "{ratio}");
    }

    #[test]
    fn spd_files() {
        assert_eq!(read_spd(b"# a\n400 0.5\n\n500\t1 # b\n"), Ok(vec![(400.0, 0.5), (500.0, 1.0)]));
        assert_eq!(read_spd(b"400 x").unwrap_err(), "line 1: \"x\" is not a number");
        assert_eq!(read_spd(b"400").unwrap_err(), "line 1: expected a wavelength and a value");
        assert!(read_spd(b"# nothing").is_err());
    }
}
