//! How views are asked for, and in which state of the service.

use argus_scene::{PlanRequest, Search};

/// How views are asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Mode {
    /// The plan is left open.
    Default,
    /// From the triangles.
    Direct,
    /// From samples: a request that names a search waits for them.
    Warp,
}

impl Mode {
    pub(super) const ALL: [Self; 3] = [Self::Default, Self::Direct, Self::Warp];

    pub(super) fn name(self) -> &'static str {
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

/// What the service has done before, and how much is asked of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Phase {
    /// Nothing: its processes have just been started.
    Cold,
    /// It has answered the same walk, and had time to settle.
    Warm,
    /// Warm, with twice the load that direct views carry.
    Twice,
    /// Warm, with four times that load.
    Fourfold,
}

impl Phase {
    /// All of them, in the order of rows.
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
