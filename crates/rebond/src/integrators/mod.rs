//! The algorithms. Each estimates the rendering equation (Kajiya 1986),
//!
//! ```text
//! L(x, ωo) = Le(x, ωo) + ∫ L(x', −ωi) f_r(x, ωi, ωo) |cosθi| dωi
//! ```
//!
//! by the mean of N independent samples of each pixel,
//!
//! ```text
//! I ≈ 1/N Σ f(X_i) / pdf(X_i)
//! ```
//!
//! and differs from the others in how it draws the paths X_i. One file per algorithm; none imports another.

mod ambient_occlusion;
mod aov;
mod bidirectional;
mod direct;
mod light;
mod path;
mod photon;
pub mod radiosity;
mod recursive;
mod vcm;

pub use crate::transport::{Heuristic, Kernel, Roulette};
pub use ambient_occlusion::{AmbientOcclusionSampling, AmbientOcclusionSettings};
pub use aov::AovSettings;
pub use bidirectional::BidirectionalSettings;
pub use direct::{DirectSampling, DirectSettings, Factor};
pub use light::LightSettings;
pub use path::{PathMode, PathSettings};
pub use photon::PhotonSettings;
pub use radiosity::RadiositySettings;
pub use recursive::RecursiveSettings;
pub use vcm::{VcmMode, VcmSettings};

use crate::emitter::LightSampling;
use crate::render::{Engine, Integrator, PathClasses, PathExpression, PathLayer};
use crate::sampling::Sampler;
use crate::scene::Scene;
use serde::{Deserialize, Serialize};

/// Which algorithm, with its settings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum IntegratorSettings {
    /// Ambient occlusion.
    AmbientOcclusion(AmbientOcclusionSettings),
    /// Direct light.
    Direct(DirectSettings),
    /// Path tracing.
    Path(PathSettings),
    /// N rays at every hit.
    Recursive(RecursiveSettings),
    /// Light tracing.
    Light(LightSettings),
    /// Bidirectional path tracing.
    Bidirectional(BidirectionalSettings),
    /// Photon mapping.
    Photon(PhotonSettings),
    /// Vertex connection and merging.
    Vcm(VcmSettings),
    /// Radiosity.
    Radiosity(Box<RadiositySettings>),
    /// What camera rays meet.
    Aov(AovSettings),
}

impl Default for IntegratorSettings {
    fn default() -> Self {
        Self::Path(PathSettings::default())
    }
}

/// What one integrator is, for lists.
#[derive(Clone, Copy, Debug)]
pub struct IntegratorInfo {
    /// Name in scene files and on the command line.
    pub name: &'static str,
    /// What it does, in a few words.
    pub summary: &'static str,
    /// Its settings.
    pub settings: &'static [(&'static str, &'static str)],
}

/// The integrators there are.
pub const INTEGRATORS: &[IntegratorInfo] = &[
    IntegratorInfo {
        name: "ambient-occlusion",
        summary: "how much of an even sky a point sees",
        settings: ambient_occlusion::SETTINGS,
    },
    IntegratorInfo {
        name: "direct",
        summary: "emission and direct light, by a choice of samplings",
        settings: direct::SETTINGS,
    },
    IntegratorInfo {
        name: "path",
        summary: "path tracing: implicit, explicit, or both weighed against each other",
        settings: path::SETTINGS,
    },
    IntegratorInfo {
        name: "recursive",
        summary: "N rays at every hit, to see why one is enough",
        settings: recursive::SETTINGS,
    },
    IntegratorInfo {
        name: "light",
        summary: "light tracing: paths from the lights, each vertex connected to the camera",
        settings: light::SETTINGS,
    },
    IntegratorInfo {
        name: "bidirectional",
        summary: "bidirectional path tracing: paths from both ends, connected in every way, weighed against each other",
        settings: bidirectional::SETTINGS,
    },
    IntegratorInfo {
        name: "photon",
        summary: "photon mapping: light from stored particles, seen directly, by a final gather, or progressively",
        settings: photon::SETTINGS,
    },
    IntegratorInfo {
        name: "vcm",
        summary: "vertex connection and merging: bidirectional path tracing and photon mapping, weighed against each other",
        settings: vcm::SETTINGS,
    },
    IntegratorInfo {
        name: "radiosity",
        summary: "diffuse light between patches, solved once for all views",
        settings: radiosity::SETTINGS,
    },
    IntegratorInfo {
        name: "aov",
        summary: "what camera rays meet: distance, place, normal and the like",
        settings: aov::SETTINGS,
    },
];

/// Settings that do not go together, or not with the scene.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{message}")]
pub struct IntegratorError {
    /// What is wrong.
    pub message: String,
    /// What to do.
    pub help: String,
}

/// Whether paths end, and how.
fn check_ending(
    roulette: Roulette,
    survival: f32,
    max_depth: Option<std::num::NonZeroU32>,
) -> Result<(), IntegratorError> {
    let error = |message: String, help: &str| Err(IntegratorError { message, help: help.into() });
    if !(survival > 0.0 && survival <= 1.0) {
        return error(format!("survival = {survival} is no probability above 0"), "give one such as 0.8");
    }
    if (roulette == Roulette::None || survival == 1.0) && max_depth.is_none() {
        let message = "paths would never end where light is not absorbed".to_owned();
        return error(message, "add max_depth=N, or roulette=throughput and survival below 1");
    }
    Ok(())
}

/// Whether a radius may be one, and shrink so.
fn check_radius(radius: Option<f32>, alpha: f32) -> Result<(), IntegratorError> {
    let error = |message: String, help: &str| Err(IntegratorError { message, help: help.into() });
    if let Some(radius) = radius.filter(|r| !(*r > 0.0 && r.is_finite())) {
        return error(format!("radius = {radius} is not above 0"), "give one in the units of the scene");
    }
    if let Some(radius) = radius.filter(|r| !(r * r).is_normal()) {
        let message = format!("radius = {radius:e} has no area that can be told");
        return error(message, "give one nearer to the size of what the scene has");
    }
    if !(alpha > 0.0 && alpha < 1.0) {
        return error(format!("alpha = {alpha} is not between 0 and 1"), "give one such as 0.7");
    }
    Ok(())
}

impl IntegratorSettings {
    /// Its name.
    pub fn name(&self) -> &'static str {
        match self {
            Self::AmbientOcclusion(_) => "ambient-occlusion",
            Self::Direct(_) => "direct",
            Self::Path(_) => "path",
            Self::Recursive(_) => "recursive",
            Self::Light(_) => "light",
            Self::Bidirectional(_) => "bidirectional",
            Self::Photon(_) => "photon",
            Self::Vcm(_) => "vcm",
            Self::Radiosity(_) => "radiosity",
            Self::Aov(_) => "aov",
        }
    }

    /// Whether its expectation differs from the rendering equation's solution.
    pub fn is_biased(&self) -> bool {
        self.leaves_out().is_some()
    }

    /// What it leaves out of the rendering equation's solution, in words.
    pub fn leaves_out(&self) -> Option<String> {
        match self {
            Self::AmbientOcclusion(_) => Some("ambient occlusion is not light".into()),
            Self::Direct(_) => Some("light that was reflected before is left out".into()),
            Self::Path(settings) => settings.leaves_out(),
            Self::Recursive(settings) => {
                Some(format!("paths of more than depth={} segments are left out", settings.depth))
            }
            Self::Light(settings) => Some(settings.leaves_out()),
            Self::Bidirectional(settings) => settings.leaves_out(),
            Self::Photon(settings) => Some(settings.leaves_out()),
            Self::Vcm(settings) => settings.leaves_out(),
            Self::Radiosity(_) => Some("light is known per patch".into()),
            Self::Aov(settings) => Some(format!("{} is not light", settings.show.name())),
        }
    }

    /// What of this scene it does not show as it is, in words.
    pub fn warnings(&self, scene: &Scene) -> Vec<String> {
        match self {
            Self::Radiosity(settings) => radiosity::dropped(scene, settings),
            _ => Vec::new(),
        }
    }

    /// Whether all of its samples have one expectation, so that pixels may have more or fewer of them.
    pub fn is_adaptable(&self) -> bool {
        match self {
            Self::Radiosity(_) | Self::Vcm(_) => false,
            Self::Photon(settings) => !settings.progressive,
            _ => true,
        }
    }

    /// The paths that count; all if none are named.
    fn paths(&self) -> Option<&PathExpression> {
        match self {
            Self::AmbientOcclusion(_)
            | Self::Direct(_)
            | Self::Recursive(_)
            | Self::Photon(_)
            | Self::Vcm(_)
            | Self::Radiosity(_)
            | Self::Aov(_) => None,
            Self::Path(settings) => settings.paths.as_ref(),
            Self::Light(settings) => settings.paths.as_ref(),
            Self::Bidirectional(settings) => settings.paths.as_ref(),
        }
    }

    /// Names of the layers that it writes by itself. Its films have them after those that paths are sorted into.
    pub fn own_layers(&self) -> Vec<String> {
        match self {
            Self::Bidirectional(settings) => settings.layers(),
            Self::Photon(settings) => settings.layers(),
            _ => Vec::new(),
        }
    }

    /// Opens the files that the settings name, by a reader of solutions of radiosity.
    pub fn open(
        &mut self,
        read: impl FnOnce(&str) -> Result<radiosity::Solution, String>,
    ) -> Result<(), IntegratorError> {
        if let Self::Radiosity(settings) = self
            && let Some(file) = &settings.solution
        {
            let help = "it is to be a file that `rebond radiosity` wrote".to_owned();
            let solution = read(file).map_err(|message| IntegratorError { message, help })?;
            settings.loaded = Some(std::sync::Arc::new(solution));
        }
        Ok(())
    }

    /// The integrator.
    pub fn integrator<'a>(
        &self,
        scene: &'a Scene,
        sampler: Sampler,
        engine: Engine,
    ) -> Result<Box<dyn Integrator + 'a>, IntegratorError> {
        self.layered_integrator(scene, sampler, engine, &[])
    }

    /// The integrator, its light also laid into these layers: those of its films.
    pub fn layered_integrator<'a>(
        &self,
        scene: &'a Scene,
        sampler: Sampler,
        engine: Engine,
        layers: &[PathLayer],
    ) -> Result<Box<dyn Integrator + 'a>, IntegratorError> {
        let classes =
            match (self.paths(), layers) {
                (None, []) => None,
                (paths, layers) => {
                    let all = PathExpression::all();
                    Some(PathClasses::new(paths.unwrap_or(&all), layers).map_err(|message| IntegratorError {
                        message,
                        help: "use fewer or shorter expressions".into(),
                    })?)
                }
            };
        let tells_apart = matches!(self, Self::Path(_) | Self::Direct(_) | Self::Light(_) | Self::Bidirectional(_));
        if classes.is_some() && !tells_apart {
            let message = format!("{} does not tell paths apart", self.name());
            return Err(IntegratorError {
                message,
                help: "use path, direct, light or bidirectional, or leave out --split".into(),
            });
        }
        let picture = match self {
            Self::AmbientOcclusion(settings) => {
                let shade = ambient_occlusion::AmbientOcclusion::new(*settings)?;
                engine.integrator(scene, sampler, shade, classes)
            }
            Self::Direct(settings) => {
                engine.integrator(scene, sampler, direct::Direct::new(*settings, scene)?, classes)
            }
            Self::Path(settings) => match settings.light_sampling {
                LightSampling::Area => {
                    engine.integrator(scene, sampler, path::Path::<false>::new(settings, scene)?, classes)
                }
                LightSampling::SolidAngle => {
                    engine.integrator(scene, sampler, path::Path::<true>::new(settings, scene)?, classes)
                }
            },
            Self::Recursive(settings) => Box::new(recursive::Recursive::new(*settings, scene, sampler)?),
            Self::Light(settings) => Box::new(light::Light::new(settings, scene, sampler, engine, classes)?),
            Self::Bidirectional(settings) => {
                Box::new(bidirectional::Bidirectional::new(settings, scene, sampler, engine, classes)?)
            }
            Self::Photon(settings) => settings.integrator(scene, sampler, engine)?,
            Self::Vcm(settings) => Box::new(vcm::Vcm::new(settings, scene, sampler, engine)?),
            Self::Radiosity(settings) => {
                Box::new(radiosity::Radiosity::new((**settings).clone(), scene, sampler, engine)?)
            }
            Self::Aov(settings) => settings.integrator(scene, sampler, engine),
        };
        Ok(aov::beside(picture, scene, sampler, engine))
    }
}
