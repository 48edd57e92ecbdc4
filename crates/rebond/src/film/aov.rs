//! What else than light a film may show: arbitrary output variables, as Mitsuba calls them and by its names.

use serde::{Deserialize, Serialize};

/// A number, or three, of what the camera's rays meet first; 0 where they meet nothing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Aov {
    /// Distance along the ray.
    #[default]
    Depth,
    /// The point.
    Position,
    /// Texture coordinates, and 0.
    Uv,
    /// Geometric normal.
    GeoNormal,
    /// Shading normal; of maps it knows nothing.
    ShNormal,
    /// What is reflected diffusely.
    Albedo,
    /// Number of the triangle within its mesh.
    PrimIndex,
    /// Number of the shape.
    ShapeIndex,
}

impl Aov {
    /// All of them.
    pub const ALL: [Self; 8] = [
        Self::Depth,
        Self::Position,
        Self::Uv,
        Self::GeoNormal,
        Self::ShNormal,
        Self::Albedo,
        Self::PrimIndex,
        Self::ShapeIndex,
    ];

    /// Its name, which is that of its layer.
    pub fn name(self) -> &'static str {
        match self {
            Self::Depth => "depth",
            Self::Position => "position",
            Self::Uv => "uv",
            Self::GeoNormal => "geo-normal",
            Self::ShNormal => "sh-normal",
            Self::Albedo => "albedo",
            Self::PrimIndex => "prim-index",
            Self::ShapeIndex => "shape-index",
        }
    }
}
