//! How views are requested, and the state of the service.

use argus_scene::{PlanRequest, Search};

/// How views are requested.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Mode {
    /// The service chooses the plan.
    Default,
    /// Rendered from triangles.
    Direct,
    /// Warped from samples: a request that names a search waits for them.
    Warp,
}

impl Mode {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Default, Self::Direct, Self::Warp];

    /// The name in arguments and rows.
    pub fn name(self) -> &'static str {
        match self {
            Self::Default => "default",
            Self::Direct => "direct",
            Self::Warp => "warp",
        }
    }

    pub(super) fn plan(self) -> PlanRequest {
        match self {
            Self::Default => PlanRequest::default(),
            Self::Direct => PlanRequest { direct: true, ..PlanRequest::default() },
            Self::Warp => PlanRequest { search: Some(Search::Splat), ..PlanRequest::default() },
        }
    }
}

/// What the service did before, and the load on it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Phase {
    /// Its processes have just been started.
    Cold,
    /// It has answered the same walk and had time to settle.
    Warm,
    /// Warm, at twice the capacity for direct views.
    Twice,
    /// Warm, at four times that capacity.
    Fourfold,
}

impl Phase {
    /// All phases, in the order of rows.
    pub(super) const ALL: [Self; 4] = [Self::Cold, Self::Warm, Self::Twice, Self::Fourfold];

    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Cold => "cold",
            Self::Warm => "warm",
            Self::Twice => "2x load",
            Self::Fourfold => "4x load",
        }
    }
}
