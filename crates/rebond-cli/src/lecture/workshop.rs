//! What sections work with: scenes that are built once, renders of them, and the commands that make the same.

use super::Quality;
use super::language::Language;
use super::page::{Findings, Picture};
use crate::Failure;
use crate::output::warn;
use crate::page::shell;
use crate::progress::{Progress, is_interrupted};
use rebond::film::{Film, Image};
use rebond::integrators::IntegratorSettings;
use rebond::render::{Budget, Engine, Region, RenderStatistics, render};
use rebond::sampling::{Sampler, SamplerSettings};
use rebond::scene::Scene;
use rebond_io::{BUILT_IN_SCENES, ImageFormat, PngOptions, SceneFiles, SceneSource, from_settings, write_image};
use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering};

/// How to work.
pub struct Workshop {
    quality: Quality,
    language: Language,
    seed: u64,
    threads: usize,
    quiet: bool,
    dropped: AtomicU64,
}

/// A scene of one size, built.
pub struct Stage {
    source: SceneSource,
    scene: Scene,
}

/// What to render on a stage.
#[derive(Clone)]
pub struct Shot<'a> {
    /// As on the command line.
    pub integrator: &'a str,
    pub samples: Range<u32>,
    /// The scene's own if not given.
    pub sampler: Option<SamplerSettings>,
    /// Added to the seed.
    pub seed: u64,
    /// One pixel only.
    pub pixel: Option<[u32; 2]>,
    /// Stops by which its picture is brightened.
    pub exposure: f32,
}

impl<'a> Shot<'a> {
    /// This many samples of every pixel.
    pub fn new(integrator: &'a str, samples: u32) -> Self {
        Self { integrator, samples: 0..samples, sampler: None, seed: 0, pixel: None, exposure: 0.0 }
    }

    /// The same with independent random numbers, for which theory says the variance.
    pub fn independent(self, seed: u64) -> Self {
        Self { sampler: Some(SamplerSettings::Independent {}), seed, ..self }
    }

    /// The same of one pixel.
    pub fn of(self, pixel: [u32; 2]) -> Self {
        Self { pixel: Some(pixel), ..self }
    }
}

impl Stage {
    pub fn size(&self) -> [u32; 2] {
        [self.source.description.film.width, self.source.description.film.height]
    }

    pub fn scene(&self) -> &Scene {
        &self.scene
    }
}

impl Workshop {
    pub fn new(quality: Quality, language: Language, seed: u64, threads: usize, quiet: bool) -> Self {
        Self { quality, language, seed, threads, quiet, dropped: AtomicU64::new(0) }
    }

    /// What a section begins with.
    pub fn findings(&self) -> Findings {
        Findings::new(self.language)
    }

    /// Words in the page's language, of English and French ones.
    pub fn say<T>(&self, words: [T; 2]) -> T {
        self.language.say(words)
    }

    /// One of these: for a draft, for a quick page, or for a full one.
    pub fn pick<T>(&self, [draft, quick, full]: [T; 3]) -> T {
        match self.quality {
            Quality::Draft => draft,
            Quality::Quick => quick,
            Quality::Full => full,
        }
    }

    /// A seed of its own for each `n`.
    pub fn seed(&self, n: u64) -> u64 {
        self.seed.wrapping_add(n)
    }

    pub fn dropped_samples(&self) -> u64 {
        self.dropped.load(Ordering::Relaxed)
    }

    /// What makes one section alone.
    pub fn command_of(&self, section: &str) -> String {
        let seed = if self.seed == 0 { String::new() } else { format!(" --seed {}", self.seed) };
        let language = self.say(["", " --lang fr"]);
        format!("rebond lecture --only {section} --quality {}{seed}{language}", self.quality.name())
    }

    /// How the page was made.
    pub fn made(&self) -> String {
        let (version, quality, seed) = (env!("CARGO_PKG_VERSION"), self.quality.name(), self.seed);
        self.say([
            format!("Every picture and number below was computed by rebond {version} (quality {quality}, seed {seed})."),
            format!(
                "Toutes les images et tous les nombres ci-dessous ont été calculés par rebond {version} (qualité {quality}, \
                 graine {seed})."
            ),
        ])
    }

    /// A built-in scene.
    pub fn stage(&self, scene: &str, [width, height]: [u32; 2]) -> Result<Stage, Failure> {
        let mut source = SceneSource::open(scene)?;
        (source.description.film.width, source.description.film.height) = (width, height);
        let scene = source.build()?;
        Ok(Stage { source, scene })
    }

    /// A built-in scene, its text changed in one place.
    pub fn stage_changed(&self, scene: &str, from: &str, to: &str) -> Result<Stage, Failure> {
        let built_in = BUILT_IN_SCENES.iter().find(|b| b.name == scene && b.text.contains(from));
        let built_in = built_in.ok_or_else(|| Failure::Run(format!("the scene {scene} has no \"{from}\"")))?;
        let source = SceneSource::parse(&built_in.text.replace(from, to), scene, scene, SceneFiles::BuiltIn)?;
        let scene = source.build()?;
        Ok(Stage { source, scene })
    }

    /// Renders.
    pub fn film(&self, stage: &Stage, shot: &Shot) -> Result<(Film, RenderStatistics), Failure> {
        let settings: IntegratorSettings = from_settings(shot.integrator)?.0;
        let sampler = Sampler::new(shot.sampler.unwrap_or(stage.source.description.sampler), self.seed(shot.seed));
        let integrator = settings
            .integrator(&stage.scene, sampler, Engine::Wavefront)
            .map_err(|e| Failure::usage(e.message, e.help))?;
        let [width, height] = stage.size();
        let region = match shot.pixel {
            None => Region::whole(width, height),
            Some([x, y]) => Region { x, y, width: 1, height: 1, full_width: width },
        };
        let film = Film::try_new(region.width, region.height, &settings.own_layers());
        let mut film = film.ok_or_else(|| Failure::Run("not enough memory for a picture".into()))?;
        let budget = Budget { samples: Some(shot.samples.len() as u32), ..Budget::default() };
        let progress = Progress::new(budget, region.pixels(), self.quiet);
        let (first, threads) = (shot.samples.start, self.threads);
        let statistics = render(&*integrator, &mut film, region, first, &budget, threads, &progress);
        progress.finish();
        if !self.quiet {
            warn(&*integrator, &format!("{}: ", shot.integrator));
        }
        self.dropped.fetch_add(film.dropped_samples(), Ordering::Relaxed);
        if statistics.interrupted || is_interrupted() { Err(Failure::Interrupted) } else { Ok((film, statistics)) }
    }

    /// A picture by its command, and its film.
    pub fn shot<T: Into<String>, U: Into<String>>(
        &self,
        stage: &Stage,
        integrator: &str,
        samples: u32,
        name: &str,
        caption: [T; 2],
        alt: [U; 2],
    ) -> Result<(Picture, Film), Failure> {
        // What a lamp sends is bright.
        let exposure = if integrator.ends_with("factor=le") { -3.0 } else { 0.0 };
        let shot = Shot { exposure, ..Shot::new(integrator, samples) };
        let (film, _) = self.film(stage, &shot)?;
        Ok((self.picture(stage, &shot, &film, name, caption, alt)?, film))
    }

    /// A film as a picture, with the command that makes the same.
    pub fn picture<T: Into<String>, U: Into<String>>(
        &self,
        stage: &Stage,
        shot: &Shot,
        film: &Film,
        name: &str,
        caption: [T; 2],
        alt: [U; 2],
    ) -> Result<Picture, Failure> {
        let ([width, height], scene) = (stage.size(), &stage.source.name);
        let exposure = if shot.exposure == 0.0 { String::new() } else { format!(" --exposure {}", shot.exposure) };
        let command = format!(
            "rebond render {scene} -i {} --size {width}x{height} --spp {} --seed {}{exposure} -o {name}.png",
            shell(shot.integrator),
            shot.samples.end,
            self.seed(shot.seed)
        );
        let plain = shot.sampler.is_none() && shot.samples.start == 0 && shot.pixel.is_none();
        let png = png(&film.develop(), shot.exposure)?;
        let (caption, alt) = (self.say(caption).into(), self.say(alt).into());
        Ok(Picture { name: name.into(), png, alt, caption, command: plain.then_some(command) })
    }
}

/// A picture as a PNG file, brightened by some stops.
pub fn png(image: &Image, exposure: f32) -> Result<Vec<u8>, Failure> {
    Ok(write_image(image, ImageFormat::Png, &PngOptions { exposure, ..PngOptions::default() })?)
}
