//! How wrong a picture is: error figures, maps of them, and whether it has the expectation of another.

use super::contest::{Point, Run};
use super::reference::Reference;
use crate::Failure;
use crate::judge::t_tests;
use rebond::compare::{Flip, PIXELS_PER_DEGREE, Pair, Welch};
use rebond::film::Image;
use rebond_io::images::srgb_decode;
use rebond_io::{ImageFormat, PngOptions, write_image};

/// The least side of the blocks that the t-test compares, and the samples that a block has at least: Student's distribution
/// holds for means that are near normal, and of caustics, which few paths meet, those of fewer samples are not.
const BLOCK: u32 = 8;
const BLOCK_SAMPLES: f64 = 16384.0;
/// The chance of a false alarm of a whole verdict, which is six tests: of blocks and of the whole picture, in each channel.
pub const LEVEL: f64 = 0.01;

/// The error figures of a picture.
pub struct Measured {
    pub mse: f64,
    pub rel_mse: f64,
    /// Without the worst pixel in a thousand.
    pub rel_mse_trimmed: f64,
    /// Mean of its difference from the reference.
    pub bias: [f64; 3],
    pub flip: Flip,
    pub hdr_flip: Flip,
    /// relMSE pixel by pixel.
    pub errors: Vec<f64>,
    /// Of log relMSE over log samples, and over log seconds.
    pub slopes: [Option<Fit>; 2],
}

/// A straight line through the points of a log-log plot: y = c xˢ.
#[derive(Clone, Copy, Debug)]
pub struct Fit {
    pub slope: f64,
    pub factor: f64,
    /// From where to where it was fitted.
    pub from: f64,
    pub to: f64,
}

fn pair<'a>(reference: &'a Reference, pixels: &'a [[f32; 3]]) -> Result<Pair<'a>, Failure> {
    let image = &reference.image;
    Pair::new(&reference.pixels, pixels, image.width, image.height).map_err(|e| Failure::Run(e.to_string()))
}

fn pixels(image: &Image) -> Vec<[f32; 3]> {
    image.rgb("").unwrap_or_default()
}

/// MSE and relMSE.
pub fn errors(reference: &Reference, image: &Image) -> Result<[f64; 2], Failure> {
    let pixels = pixels(image);
    let pair = pair(reference, &pixels)?;
    Ok([pair.mse(), pair.rel_mse(0.0)])
}

impl Measured {
    pub fn new(reference: &Reference, run: &Run) -> Result<Self, Failure> {
        let pixels = pixels(&run.image);
        let pair = pair(reference, &pixels)?;
        let of_pixel = |(r, x): (&[f32; 3], &[f32; 3])| {
            let channel = |c: usize| {
                let (r, x) = (f64::from(r[c]), f64::from(x[c]));
                (x - r).powi(2) / (r * r + 0.01)
            };
            (0..3).map(channel).sum::<f64>() / 3.0
        };
        let noise = reference.noise.unwrap_or(0.0);
        Ok(Self {
            mse: pair.mse(),
            rel_mse: pair.rel_mse(0.0),
            rel_mse_trimmed: pair.rel_mse(0.001),
            bias: pair.mean_signed_error(),
            flip: pair.flip(PIXELS_PER_DEGREE),
            hdr_flip: pair.hdr_flip(PIXELS_PER_DEGREE),
            errors: reference.pixels.iter().zip(&pixels).map(of_pixel).collect(),
            slopes: [fit(&run.curve, |p| p.samples, noise), fit(&run.curve, |p| p.seconds, noise)],
        })
    }

    /// FLIP's map as a PNG file.
    pub fn flip_map(&self, size: [u32; 2]) -> Result<Vec<u8>, Failure> {
        coloured(size, self.flip.map.iter().map(|e| f64::from(*e)))
    }

    /// The map of relMSE as a PNG file: black 10⁻⁴ and less, white 1 and more.
    pub fn error_map(&self, size: [u32; 2]) -> Result<Vec<u8>, Failure> {
        coloured(size, self.errors.iter().map(|e| 1.0 + e.log10() / 4.0))
    }
}

/// The colours of maps, dark to bright.
pub fn colour(t: f64) -> [u8; 3] {
    let colour = colorous::MAGMA.eval_continuous(t.clamp(0.0, 1.0));
    [colour.r, colour.g, colour.b]
}

/// Numbers from 0 to 1 as a PNG file.
fn coloured([width, height]: [u32; 2], values: impl Iterator<Item = f64>) -> Result<Vec<u8>, Failure> {
    let pixels: Vec<[f32; 3]> = values.map(|t| colour(t).map(|c| srgb_decode(f32::from(c) / 255.0))).collect();
    let image = Image::from_rgb(width, height, &pixels);
    Ok(write_image(&image, ImageFormat::Png, &PngOptions::default())?)
}

/// Least squares through the logarithms of at least three points, where the noise of the reference is less than a quarter of
/// the error.
fn fit(curve: &[Point], x: impl Fn(&Point) -> f64, noise: f64) -> Option<Fit> {
    let good = curve.iter().filter(|p| p.rel_mse > 4.0 * noise && p.rel_mse > 0.0 && x(p) > 0.0);
    let points: Vec<[f64; 2]> = good.map(|p| [x(p).ln(), p.rel_mse.ln()]).collect();
    if points.len() < 3 {
        return None;
    }
    let n = points.len() as f64;
    let mean = |k: usize| points.iter().map(|p| p[k]).sum::<f64>() / n;
    let (mx, my) = (mean(0), mean(1));
    let across: f64 = points.iter().map(|p| (p[0] - mx) * (p[1] - my)).sum();
    let along: f64 = points.iter().map(|p| (p[0] - mx).powi(2)).sum();
    if along <= 0.0 {
        return None;
    }
    let slope = across / along;
    let ends = |f: fn(f64, f64) -> f64, start: f64| points.iter().map(|p| p[0]).fold(start, f).exp();
    let (from, to) = (ends(f64::min, f64::INFINITY), ends(f64::max, f64::NEG_INFINITY));
    Some(Fit { slope, factor: (my - slope * mx).exp(), from, to })
}

/// Samples per pixel, on average, of a picture that knows them.
fn samples(image: &Image) -> Option<f64> {
    let all = &image.layer("samples")?.channels.first()?.data;
    let mean = all.iter().map(|n| f64::from(*n)).sum::<f64>() / all.len() as f64;
    (mean > 0.0).then_some(mean)
}

/// Whether two pictures have one expectation, block by block and as a whole.
pub struct Verdict {
    /// Side of the blocks in pixels.
    pub side: u32,
    pub blocks: Vec<(&'static str, Welch)>,
    pub whole: Vec<(&'static str, Welch)>,
    /// By how much the second is brighter, relative to the first.
    pub brightness: f64,
}

impl Verdict {
    /// The verdict on a picture held to another; none where one of them does not know its variance.
    pub fn new(first: &Image, second: &Image) -> Option<Self> {
        let whole = first.width.max(first.height);
        let samples = [samples(first)?, samples(second)?].into_iter().fold(f64::INFINITY, f64::min);
        let side =
            ((BLOCK_SAMPLES / samples).sqrt().ceil().min(f64::from(whole)) as u32).next_power_of_two().max(BLOCK);
        let level = LEVEL / 6.0;
        let sum = |image: &Image| pixels(image).iter().flatten().map(|x| f64::from(*x)).sum::<f64>();
        Some(Self {
            side,
            blocks: t_tests(first, second, side, level)?,
            whole: t_tests(first, second, whole, level)?,
            brightness: sum(second) / sum(first) - 1.0,
        })
    }

    /// Whether nothing speaks against one expectation.
    pub fn agrees(&self) -> bool {
        self.blocks.iter().chain(&self.whole).all(|(_, test)| test.passes())
    }

    /// The least p-value of the whole picture's channels.
    pub fn brightness_p(&self) -> f64 {
        self.whole.iter().flat_map(|(_, w)| w.blocks.iter().flatten()).map(|b| b.p).fold(1.0, f64::min)
    }

    /// Blocks that differ by more than chance allows, of all that were tested, over channels.
    pub fn odd_blocks(&self) -> [usize; 2] {
        [self.blocks.iter().map(|(_, w)| w.significant).sum(), self.blocks.iter().map(|(_, w)| w.tested).sum()]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rebond::film::{Batch, Film};
    use rebond::integrators::{IntegratorSettings, PathSettings};
    use rebond::render::{Budget, Engine, Integrator, Observer, Pass, Rays, Region, render};
    use rebond::sampling::{Sampler, SamplerSettings};
    use rebond_io::SceneSource;
    use std::sync::Mutex;

    /// Another integrator, 2 % too bright.
    struct TooBright<'a>(Box<dyn Integrator + 'a>);

    impl Integrator for TooBright<'_> {
        fn add_samples(&self, film: &Mutex<Film>, pass: &Pass, observer: &dyn Observer) -> Rays {
            let mut rays = Rays::default();
            for n in pass.samples.clone() {
                let one = Mutex::new(Film::new(pass.region.width, pass.region.height));
                rays.merge(&self.0.add_samples(&one, &Pass { samples: n..n + 1, ..pass.clone() }, observer));
                let one = one.into_inner().expect("a film");
                let mut film = film.lock().expect("the film");
                for (to, from) in film.pixels_mut().iter_mut().zip(one.pixels()) {
                    let mut batch = Batch::default();
                    batch.add(from.mean().map(|x| 1.02 * x as f32), 1.0);
                    to.add(&batch, 1.0);
                }
            }
            rays
        }
    }

    #[test]
    fn two_percent_too_bright_is_flagged() {
        let mut source = SceneSource::open("cornell-box").expect("a scene");
        let size = 32;
        (source.description.film.width, source.description.film.height) = (size, size);
        let scene = source.build().expect("built");
        let path = |seed| {
            let settings = IntegratorSettings::Path(PathSettings::default());
            let sampler = Sampler::new(SamplerSettings::Independent {}, seed);
            settings.integrator(&scene, sampler, Engine::Wavefront).expect("an integrator")
        };
        let image = |integrator: &dyn Integrator, samples| {
            let mut film = Film::new(size, size);
            let budget = Budget { samples: Some(samples), ..Budget::default() };
            render(integrator, &mut film, Region::whole(size, size), 0, &budget, 2, &());
            film.develop()
        };
        let reference = image(&*path(1), 1024);
        let right = Verdict::new(&reference, &image(&*path(2), 256)).expect("variances");
        let wrong = Verdict::new(&reference, &image(&TooBright(path(3)), 256)).expect("variances");
        assert!(right.agrees(), "{} {}", right.brightness, right.brightness_p());
        assert!(!wrong.agrees(), "{} {}", wrong.brightness, wrong.brightness_p());
        // 2 % within four standard errors.
        let t = wrong.whole[1].1.blocks[0].expect("tested").t;
        assert!((wrong.brightness - 0.02).abs() < 4.0 * wrong.brightness / t, "{} {t}", wrong.brightness);
    }

    #[test]
    fn slopes_are_those_of_the_points() {
        let point = |n: f64, rel_mse: f64| Point { samples: n, seconds: 2.0 * n, rays: 0, mse: 0.0, rel_mse };
        let curve: Vec<Point> = (0..8).map(|k| point(f64::from(1 << k), 0.3 / f64::from(1 << k))).collect();
        let line = fit(&curve, |p| p.samples, 0.0).expect("a line");
        assert!((line.slope + 1.0).abs() < 1e-12 && (line.factor - 0.3).abs() < 1e-12, "{line:?}");
        let by_seconds = fit(&curve, |p| p.seconds, 0.0).expect("a line");
        assert!((by_seconds.slope + 1.0).abs() < 1e-12 && (by_seconds.factor - 0.6).abs() < 1e-12);
        // Points that the reference cannot judge are left out: up to 0.3/32, six of them.
        let judged = fit(&curve, |p| p.samples, 0.3 / 64.0 / 4.0).expect("a line");
        assert!((judged.to - 32.0).abs() < 1e-9, "{judged:?}");
        assert!(fit(&curve[..2], |p| p.samples, 0.0).is_none());
    }
}
