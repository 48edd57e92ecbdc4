//! An integrator at work: pass by pass, its error measured in between.

use super::measure;
use super::reference::Reference;
use crate::Failure;
use crate::output::{forget_peak_memory, peak_memory_bytes, warn};
use crate::progress::{Progress, is_interrupted};
use crate::render::sampler;
use rebond::film::{Film, Image};
use rebond::integrators::IntegratorSettings;
use rebond::render::{Budget, Engine, Integrator, Rays, Region, render};
use rebond::sampling::Sampler;
use rebond::scene::Scene;
use rebond_io::{SceneFiles, SceneSource, from_settings};
use std::path::PathBuf;
use std::time::Instant;

/// Fewest samples per pixel by which an error is judged, as renders do.
const FIRST_JUDGEMENT: u32 = 16;

/// The scene, built, and how to work on it.
pub struct Stage {
    pub source: SceneSource,
    pub scene: Scene,
    pub threads: usize,
    pub quiet: bool,
}

/// An integrator that takes part.
#[derive(Clone)]
pub struct Contender {
    /// As on the command line.
    pub text: String,
    pub settings: IntegratorSettings,
    pub seed: u64,
    /// Name of its files without extension.
    pub file: String,
}

/// How wrong it was at some moment.
#[derive(Clone, Copy)]
pub struct Point {
    /// Per pixel, on average.
    pub samples: f64,
    pub seconds: f64,
    pub rays: u64,
    pub mse: f64,
    pub rel_mse: f64,
}

/// What an integrator did.
pub struct Run {
    pub contender: Contender,
    pub image: Image,
    pub curve: Vec<Point>,
    pub samples: u64,
    pub rays: u64,
    /// What it had to make ready included.
    pub seconds: f64,
    pub dropped: u64,
    /// The most memory that the program had meanwhile, the scene included.
    pub memory: Option<u64>,
    pub interrupted: bool,
}

impl Run {
    /// On average.
    pub fn samples_per_pixel(&self) -> f64 {
        self.samples as f64 / (f64::from(self.image.width) * f64::from(self.image.height))
    }
}

impl Contender {
    /// Reads `name:key=value,…`.
    pub fn parse(text: &str, seed: u64) -> Result<Self, Failure> {
        let settings: IntegratorSettings = from_settings(text)?.0;
        let file = text.replace(|c: char| !c.is_ascii_alphanumeric() && !"-_+.".contains(c), "_");
        Ok(Self { text: text.into(), settings, seed, file: file.chars().take(80).collect() })
    }

    /// The same with a number in the name of its files, which may be like another's otherwise.
    pub fn numbered(self, number: u64) -> Self {
        Self { file: format!("{number}-{}", self.file), ..self }
    }

    /// A film for it.
    pub fn film(&self, [width, height]: [u32; 2]) -> Result<Film, Failure> {
        let film = Film::try_new(width, height, &self.settings.own_layers());
        film.ok_or_else(|| Failure::Run(format!("not enough memory for a film of {width}x{height} pixels")))
    }
}

impl Stage {
    pub fn new(source: SceneSource, threads: usize, quiet: bool) -> Result<Self, Failure> {
        let scene = source.build()?;
        Ok(Self { source, scene, threads, quiet })
    }

    pub fn size(&self) -> [u32; 2] {
        [self.source.description.film.width, self.source.description.film.height]
    }

    pub fn region(&self) -> Region {
        let [width, height] = self.size();
        Region::whole(width, height)
    }

    /// Opens the files that an integrator names, and makes sure that it goes with the scene.
    pub fn check(&self, contender: &mut Contender) -> Result<(), Failure> {
        let files = SceneFiles::Folder(PathBuf::new());
        let said = |e: rebond::integrators::IntegratorError| {
            Failure::usage(format!("{}: {}", contender.text, e.message), e.help)
        };
        contender.settings.open(|file| files.solution(file, &self.scene)).map_err(said)?;
        // All but radiosity, which solves the scene when it is made.
        if contender.settings.is_adaptable() { self.integrator(contender, None).map(drop) } else { Ok(()) }
    }

    /// The integrator, for this many samples if they are known.
    pub fn integrator(&self, contender: &Contender, spp: Option<u32>) -> Result<Box<dyn Integrator + '_>, Failure> {
        let sampler = Sampler::new(sampler(&self.source, spp), contender.seed);
        let made = contender.settings.integrator(&self.scene, sampler, Engine::Wavefront);
        made.map_err(|e| Failure::usage(format!("{}: {}", contender.text, e.message), e.help))
    }
}

/// Lets an integrator work until its budget is used up.
pub fn run(stage: &Stage, contender: Contender, reference: &Reference, budget: &Budget) -> Result<Run, Failure> {
    forget_peak_memory();
    let start = Instant::now();
    let integrator = stage.integrator(&contender, budget.samples)?;
    let mut seconds = start.elapsed().as_secs_f64();
    let region = stage.region();
    let mut film = contender.film(stage.size())?;
    let last = budget.samples.unwrap_or(u32::MAX);
    let progress = Progress::new(*budget, region.pixels(), stage.quiet);
    let (mut at, mut next, mut curve, mut rays) = (0, 1, Vec::new(), Rays::default());
    let mut interrupted = false;
    while at < last && !interrupted {
        let left = budget.time.map(|t| t.saturating_sub(std::time::Duration::from_secs_f64(seconds)));
        if at > 0 && left.is_some_and(|t| t.is_zero()) {
            break;
        }
        let samples = next.min(last) - at;
        let pass = Budget { samples: Some(samples), time: left, ..Budget::default() };
        let done = render(&*integrator, &mut film, region, at, &pass, stage.threads, &progress);
        seconds += done.seconds;
        rays.merge(&done.rays);
        interrupted = done.interrupted || is_interrupted();
        at += samples;
        let samples = film.samples() as f64 / region.pixels() as f64;
        let [mse, rel_mse] = measure::errors(reference, &film.develop())?;
        curve.push(Point { samples, seconds, rays: rays.total(), mse, rel_mse });
        next = at.saturating_mul(2);
        if let Some(target) = budget.error.filter(|_| at >= FIRST_JUDGEMENT) {
            let error = film.relative_error();
            if error <= target {
                break;
            }
            // The error falls with the root of the number of samples.
            let needed = f64::from(at) * (error / target).powi(2);
            next = next.min(needed.ceil().min(f64::from(u32::MAX)) as u32).max(at.saturating_add(1));
        }
    }
    progress.finish();
    if at == 0 {
        return Err(Failure::Interrupted);
    }
    if !stage.quiet {
        warn(&*integrator, &format!("{}: ", contender.text));
    }
    drop(integrator);
    let (image, samples, dropped) = (film.develop(), film.samples(), film.dropped_samples());
    let memory = peak_memory_bytes();
    Ok(Run { contender, image, curve, samples, rays: rays.total(), seconds, dropped, memory, interrupted })
}
