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
mod direct;
mod path;
pub mod radiosity;

pub use ambient_occlusion::{AmbientOcclusionSampling, AmbientOcclusionSettings};
pub use direct::{DirectSampling, DirectSettings, Factor};
pub use path::PathSettings;
pub use radiosity::RadiositySettings;

use crate::emitter::LightSampling;
use crate::render::{Engine, Integrator};
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
    /// Radiosity.
    Radiosity(Box<RadiositySettings>),
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
        summary: "explicit path tracing with multiple importance sampling",
        settings: path::SETTINGS,
    },
    IntegratorInfo {
        name: "radiosity",
        summary: "diffuse light between patches, solved once for all views",
        settings: radiosity::SETTINGS,
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

impl IntegratorSettings {
    /// Its name.
    pub fn name(&self) -> &'static str {
        match self {
            Self::AmbientOcclusion(_) => "ambient-occlusion",
            Self::Direct(_) => "direct",
            Self::Path(_) => "path",
            Self::Radiosity(_) => "radiosity",
        }
    }

    /// Whether its expectation differs from the rendering equation's solution.
    pub fn is_biased(&self) -> bool {
        match self {
            Self::AmbientOcclusion(_) | Self::Direct(_) | Self::Radiosity(_) => true,
            Self::Path(settings) => settings.is_biased(),
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
        Ok(match self {
            Self::AmbientOcclusion(settings) => {
                let shade = ambient_occlusion::AmbientOcclusion::new(*settings)?;
                engine.integrator(scene, sampler, shade)
            }
            Self::Direct(settings) => engine.integrator(scene, sampler, direct::Direct::new(*settings, scene)?),
            Self::Path(settings) => match settings.light_sampling {
                LightSampling::Area => engine.integrator(scene, sampler, path::Path::<false>::new(*settings)),
                LightSampling::SolidAngle => engine.integrator(scene, sampler, path::Path::<true>::new(*settings)),
            },
            Self::Radiosity(settings) => {
                Box::new(radiosity::Radiosity::new((**settings).clone(), scene, sampler, engine)?)
            }
        })
    }
}
