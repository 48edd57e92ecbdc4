//! What integrators are held to: a picture from a file, or one that is made, and kept for the next time.

use super::contest::{Contender, Stage};
use crate::Failure;
use crate::output::warn;
use crate::output::write_bytes;
use crate::progress::Progress;
use rebond::film::Image;
use rebond::integrators::IntegratorSettings;
use rebond::render::{Budget, render};
use rebond_io::{ImageFormat, PngOptions, SceneSource, read_image, write_image};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// A seed that contenders do not have, whose own begin at small numbers.
const SEED: u64 = 0x5eed_0fac_e0ff_7201;

/// Where a reference is to come from.
pub enum Wanted {
    File(PathBuf),
    Integrator(Box<Contender>),
    Auto,
}

/// The picture taken for right.
pub struct Reference {
    pub image: Image,
    pub pixels: Vec<[f32; 3]>,
    /// Where it comes from, in words.
    pub story: String,
    pub integrator: Option<String>,
    pub samples: Option<u32>,
    /// What it leaves out.
    pub biased: Option<String>,
    pub cached: bool,
    pub path: Option<PathBuf>,
    /// The relMSE that its own noise makes, where it knows its variance.
    pub noise: Option<f64>,
}

impl Wanted {
    pub fn parse(text: &str) -> Result<Self, Failure> {
        if text == "auto" {
            return Ok(Self::Auto);
        }
        let path = Path::new(text);
        if path.is_file() || ImageFormat::of_name(text).is_ok() {
            return Ok(Self::File(path.into()));
        }
        Ok(Self::Integrator(Box::new(Contender::parse(text, SEED)?)))
    }
}

/// Finds or makes it.
pub fn find(wanted: &Wanted, spp: u32, cache: Option<&Path>, stage: &mut Stage) -> Result<Reference, Failure> {
    let mut contender = match wanted {
        Wanted::File(path) => return of_file(path, stage.size()),
        Wanted::Integrator(contender) => (**contender).clone(),
        Wanted::Auto => best(stage)?,
    };
    stage.check(&mut contender)?;
    // A file that the settings name may hold something else the next time.
    let names_file = matches!(&contender.settings, IntegratorSettings::Radiosity(s) if s.solution.is_some());
    let folder = cache.map(Path::to_path_buf).or_else(cache_folder).filter(|_| !names_file);
    let path = folder.map(|folder| {
        key(&stage.source, &contender, spp).map(|key| folder.join(format!("{}-{key}.exr", stage.source.name)))
    });
    let path = path.transpose()?;
    let kept = path.as_deref().filter(|p| p.is_file()).and_then(|p| read(p).ok());
    let integrator = Some(contender.text.clone());
    let biased = contender.settings.leaves_out();
    let of_size = |image: &Image| [image.width, image.height] == stage.size();
    if let Some(image) = kept.filter(of_size) {
        let shown = path.as_deref().map(|p| p.display().to_string()).unwrap_or_default();
        let story = format!("{}, {spp} samples per pixel, kept in {shown}", contender.text);
        return Ok(
            Reference { integrator, samples: Some(spp), biased, cached: true, path, ..of_image(image, story)? }.known()
        );
    }
    let start = Instant::now();
    let image = make(stage, &contender, spp)?;
    let seconds = start.elapsed().as_secs_f64();
    let mut story = format!("{}, {spp} samples per pixel, made in {seconds:.1} s", contender.text);
    let path = path.filter(|path| match keep(path, &image) {
        Ok(()) => {
            story += &format!(" and kept in {}", path.display());
            true
        }
        Err(e) => {
            story += &format!("; it could not be kept in {}: {e}", path.display());
            false
        }
    });
    Ok(Reference { integrator, samples: Some(spp), biased, path, ..of_image(image, story)? }.known())
}

impl Reference {
    /// With the noise that its variance tells.
    fn known(mut self) -> Self {
        self.noise = self.image.layer("variance").map(|layer| {
            let of = |c: usize| {
                let variance = layer.channels[c].data.iter();
                variance.zip(&self.pixels).map(move |(v, p)| f64::from(*v) / (f64::from(p[c]).powi(2) + 0.01))
            };
            let count = 3 * self.pixels.len();
            (0..layer.channels.len().min(3)).flat_map(of).sum::<f64>() / count as f64
        });
        self
    }
}

fn of_image(image: Image, story: String) -> Result<Reference, Failure> {
    let missing = || Failure::usage("the reference has no colour channels", "give a picture");
    let pixels = image.rgb("").ok_or_else(missing)?;
    if !pixels.iter().flatten().all(|x| x.is_finite()) {
        return Err(Failure::usage("the reference is not finite everywhere", "give another"));
    }
    Ok(Reference {
        image,
        pixels,
        story,
        integrator: None,
        samples: None,
        biased: None,
        cached: false,
        path: None,
        noise: None,
    })
}

fn read(path: &Path) -> Result<Image, Failure> {
    let name = path.display().to_string();
    let bytes = std::fs::read(path).map_err(|e| rebond_io::Error::new(format!("cannot read \"{name}\": {e}")))?;
    Ok(read_image(&bytes, &name)?)
}

fn of_file(path: &Path, size: [u32; 2]) -> Result<Reference, Failure> {
    let image = read(path)?;
    let found = [image.width, image.height];
    if found != size {
        let message =
            format!("the reference has {}x{} pixels, the pictures {}x{}", found[0], found[1], size[0], size[1]);
        return Err(Failure::usage(message, format!("give --size {}x{}, or another reference", found[0], found[1])));
    }
    Ok(Reference { path: Some(path.into()), ..of_image(image, path.display().to_string())? }.known())
}

/// Bidirectional path tracing, or path tracing where that refuses. No short trial chooses: a few samples that miss all light look
/// free of noise.
fn best(stage: &Stage) -> Result<Contender, Failure> {
    let contender = Contender::parse("bidirectional", SEED)?;
    match stage.integrator(&contender, None) {
        Ok(_) => Ok(contender),
        Err(_) => Contender::parse("path", SEED),
    }
}

fn make(stage: &Stage, contender: &Contender, spp: u32) -> Result<Image, Failure> {
    let integrator = stage.integrator(contender, Some(spp))?;
    let mut film = contender.film(stage.size())?;
    let budget = Budget { samples: Some(spp), ..Budget::default() };
    let progress = Progress::new(budget, stage.region().pixels(), stage.quiet);
    let done = render(&*integrator, &mut film, stage.region(), 0, &budget, stage.threads, &progress);
    progress.finish();
    if !stage.quiet {
        warn(&*integrator, &format!("{}: ", contender.text));
    }
    // Half a reference is none, and is not kept.
    if done.interrupted { Err(Failure::Interrupted) } else { Ok(film.develop()) }
}

/// Where programs of this user keep what can be made again.
fn cache_folder() -> Option<PathBuf> {
    let of = |name: &str| std::env::var_os(name).filter(|v| !v.is_empty()).map(PathBuf::from);
    let folder = of("XDG_CACHE_HOME").or_else(|| of("LOCALAPPDATA")).or_else(|| Some(of("HOME")?.join(".cache")))?;
    Some(folder.join("rebond").join("references"))
}

/// A name for the picture, from all that it hangs on: the scene with its files and its size, the integrator with its settings,
/// the number of samples, and the version of the program.
fn key(source: &SceneSource, contender: &Contender, spp: u32) -> Result<String, Failure> {
    let mut description = source.clone();
    description.description.integrator = contender.settings.clone();
    let digest = description.digest(&format!("{} {spp} {}", env!("CARGO_PKG_VERSION"), contender.seed))?;
    Ok(digest[..16].to_owned())
}

fn keep(path: &Path, image: &Image) -> Result<(), String> {
    let folder = path.parent().unwrap_or(Path::new("."));
    std::fs::create_dir_all(folder).map_err(|e| e.to_string())?;
    let bytes = write_image(image, ImageFormat::Exr, &PngOptions::default()).map_err(|e| e.message)?;
    write_bytes(path, &bytes)
}
