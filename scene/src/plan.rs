//! Plans: how a view is rendered.

use serde::{Deserialize, Serialize};

use crate::{Camera, Detail, FaceMasks, SampleId, SurfaceLight};

/// Method of a compositor to find a pixel's depth, before the depth-corrected inverse warping.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Search {
    /// Forward splat of the samples' texels into the view, then one filtered fetch per sample.
    #[default]
    Splat,
    /// The cluster paper's search (section 4.2): linear steps along the view ray until it is inside every camera's
    /// surface, then binary refinement; the most conservative surface wins.
    Linear,
    /// A coarse splat gives the start, fixed-point steps refine it, a short linear search finishes.
    Seeded,
    /// Exact: the ray is followed through a min/max pyramid of each sample's inverse range.
    Pyramid,
}

impl Search {
    /// All searches, in the order of tables.
    pub const ALL: [Self; 4] = [Self::Splat, Self::Linear, Self::Seeded, Self::Pyramid];

    /// Its name on the command line and in JSON.
    pub fn name(self) -> &'static str {
        match self {
            Self::Splat => "splat",
            Self::Linear => "linear",
            Self::Seeded => "seeded",
            Self::Pyramid => "pyramid",
        }
    }

    /// Default number of steps: more of them gain little.
    pub fn usual_steps(self) -> u32 {
        match self {
            Self::Seeded => 4,
            _ => 64,
        }
    }

    /// Whether it uses [`Warp::steps`].
    pub fn takes_steps(self) -> bool {
        matches!(self, Self::Linear | Self::Seeded)
    }
}

/// Method of rendering a view; changes only between frames.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum Plan {
    /// Rendered from the triangles.
    Direct {
        /// Samples per pixel on a regular grid, a square number: 1, 4, 16, ….
        samples_per_pixel: u32,
        /// How much of it is rendered.
        #[serde(default)]
        detail: Detail,
        /// Where sky and indirect light are from; `None`: light cells if they are filled, else rays. A frame of a set with light cells
        /// says which it was.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        light: Option<SurfaceLight>,
    },
    /// Reconstructed from samples.
    Warp(Warp),
}

impl Plan {
    /// From triangles, in full detail.
    pub fn direct(samples_per_pixel: u32) -> Self {
        Self::Direct { samples_per_pixel, detail: Detail::Full, light: None }
    }

    /// Where a plan from triangles has sky and indirect light from, if it names that.
    pub fn light(&self) -> Option<SurfaceLight> {
        match self {
            Self::Direct { light, .. } => *light,
            Self::Warp(_) => None,
        }
    }

    /// The same plan with sky and indirect light from there, if it is from triangles.
    #[must_use]
    pub fn with_light(self, light: Option<SurfaceLight>) -> Self {
        match self {
            Self::Direct { samples_per_pixel, detail, .. } => {
                Self::Direct { samples_per_pixel, detail, light }
            }
            warp @ Self::Warp(_) => warp,
        }
    }

    /// Whether all of the view is rendered, in full detail.
    pub fn is_whole(&self) -> bool {
        !matches!(self, Self::Direct { detail, .. } if *detail != Detail::Full)
    }

    /// Sub-pixels that are rendered for a view of so many pixels.
    pub fn sub_pixels(&self, pixels: u64) -> u64 {
        match self {
            Self::Direct { samples_per_pixel, detail, .. } => {
                let rendered = pixels.div_ceil(u64::from(detail.scale()).pow(2));
                rendered.saturating_mul(u64::from(*samples_per_pixel))
            }
            Self::Warp(warp) => pixels.saturating_mul(u64::from(warp.supersampling).pow(2)),
        }
    }

    /// The direct frames that it warps; none if it is from triangles alone, or from samples of a set.
    pub fn frames(&self) -> &[FrameSource] {
        match self {
            Self::Direct { .. } => &[],
            Self::Warp(warp) => &warp.frames,
        }
    }

    /// Whether it uses samples of a set. Other plans need triangles alone: a direct view, or a view that is warped from
    /// direct frames.
    pub fn needs_samples(&self) -> bool {
        matches!(self, Self::Warp(warp) if warp.frames.is_empty())
    }
}

/// Settings of a view's reconstruction from samples.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Warp {
    /// Search for a pixel's depth.
    pub search: Search,
    /// Linear or fixed-point steps of the searches that [take them](Search::takes_steps).
    pub steps: u32,
    /// Sub-pixels per pixel and side, whose mean is the pixel.
    pub supersampling: u32,
    /// The samples, best first. Their order is part of the plan. Empty if the plan warps direct frames.
    pub samples: Vec<SampleId>,
    /// Direct frames that are warped in place of samples, best first. They are never warped themselves, so that errors do
    /// not add up.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub frames: Vec<FrameSource>,
    /// The faces of each camera that are used. A sample that has more gives the same frame.
    #[serde(default, skip_serializing_if = "FaceMasks::are_all")]
    pub faces: FaceMasks,
    /// Treatment of pixels that none of the samples saw.
    pub holes: Holes,
}

impl Default for Warp {
    /// The splat without samples: for `..Warp::default()`.
    fn default() -> Self {
        Self {
            search: Search::Splat,
            steps: 64,
            supersampling: 1,
            samples: Vec::new(),
            frames: Vec::new(),
            faces: FaceMasks::default(),
            holes: Holes::Mark,
        }
    }
}

/// Treatment of pixels that no sample saw.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Holes {
    /// Fill them with the background around them; mark them in the mask and count them.
    #[default]
    Mark,
    /// Trace their rays by a sampler.
    Trace,
}

/// A direct frame that a view is warped from. With the state, specification and device of the warped frame, it is all
/// that the direct frame's bytes are a function of, so that any worker can render it again.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct FrameSource {
    /// The frame's viewpoint.
    pub camera: Camera,
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Samples per pixel on a regular grid, a square number.
    pub samples_per_pixel: u32,
    /// Rows of pixels that are rendered together, 0 for all: [`crate::ViewJob::band_rows`]. 0 in a purchase: the worker chooses.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub band_rows: u32,
    /// Where sky and indirect light are from. `None` in an order: as the worker has the frame; its reply says which.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub light: Option<SurfaceLight>,
}

#[allow(clippy::trivially_copy_pass_by_ref, reason = "serde passes a reference")]
fn is_zero(number: &u32) -> bool {
    *number == 0
}
