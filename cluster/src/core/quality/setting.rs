//! Settings: plans without their sample ids, among which the model chooses.

use argus_scene::{FaceMasks, Holes, Plan, PlanRequest, SampleId, Search, Warp};
use serde::{Deserialize, Serialize};

/// A plan without its sample ids.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Setting {
    /// [`Plan::Direct`].
    Direct {
        /// Samples per pixel, a square number.
        samples_per_pixel: u32,
    },
    /// [`Plan::Warp`].
    Warp {
        /// The search for depth.
        search: Search,
        /// Steps of the search; 0 for searches without steps.
        steps: u32,
        /// Sub-pixels per side of a pixel.
        supersampling: u32,
        /// Number of samples.
        samples: u32,
        /// Treatment of pixels that no sample saw.
        holes: Holes,
    },
}

impl Setting {
    /// The setting of a plan.
    pub fn of(plan: &Plan) -> Self {
        match plan {
            Plan::Direct { samples_per_pixel, .. } => Self::Direct { samples_per_pixel: *samples_per_pixel },
            Plan::Warp(warp) => Self::Warp {
                search: warp.search,
                steps: if warp.search.takes_steps() { warp.steps } else { 0 },
                supersampling: warp.supersampling,
                samples: warp.samples.iter().filter(|id| !id.is_reflection_probe()).count() as u32,
                holes: warp.holes,
            },
        }
    }

    /// The plan of this setting with the given samples, at most [`Setting::samples`].
    pub fn plan(self, samples: Vec<SampleId>) -> Plan {
        match self {
            Self::Direct { samples_per_pixel } => Plan::direct(samples_per_pixel),
            Self::Warp { search, steps, supersampling, holes, .. } => {
                // An unused number has the default's value.
                let steps = if search.takes_steps() { steps } else { search.usual_steps() };
                let faces = FaceMasks::default();
                Plan::Warp(Warp { search, steps, supersampling, samples, faces, holes, ..Warp::default() })
            }
        }
    }

    /// Number of samples that it reconstructs from.
    pub fn samples(self) -> usize {
        match self {
            Self::Direct { .. } => 0,
            Self::Warp { samples, .. } => samples as usize,
        }
    }

    /// Whether the view is rendered from the triangles.
    pub fn is_direct(self) -> bool {
        matches!(self, Self::Direct { .. })
    }

    /// Whether pixels that no sample saw are traced.
    pub fn traces(self) -> bool {
        matches!(self, Self::Warp { holes: Holes::Trace, .. })
    }

    /// Whether it agrees with a request's explicit search, settings and treatment of holes. The request's number of
    /// samples is a maximum.
    pub fn is_allowed_by(self, request: &PlanRequest) -> bool {
        match self {
            Self::Direct { samples_per_pixel } => {
                let warped = request.search.is_some() || request.steps.is_some() || request.samples.is_some();
                let side_fits = request.supersampling.is_none_or(|side| side * side == samples_per_pixel);
                (request.direct || !warped) && side_fits
            }
            Self::Warp { search, steps, supersampling, samples, holes } => {
                !request.direct
                    && request.search.is_none_or(|asked| asked == search)
                    && request.steps.is_none_or(|asked| asked == steps || !search.takes_steps())
                    && request.supersampling.is_none_or(|asked| asked == supersampling)
                    && request.samples.is_none_or(|most| samples <= most)
                    && request.holes.is_none_or(|asked| asked == holes)
            }
        }
    }

    /// A short name for tables: `direct 4`, `splat 4×2² traced`.
    pub fn name(self) -> String {
        match self {
            Self::Direct { samples_per_pixel } => format!("direct {samples_per_pixel}"),
            Self::Warp { search, steps, supersampling, samples, holes } => {
                let steps = if search.takes_steps() { format!(" {steps}") } else { String::new() };
                let traced = if holes == Holes::Trace { " traced" } else { "" };
                format!("{}{steps} of {samples}, {supersampling}²{traced}", search.name())
            }
        }
    }
}
