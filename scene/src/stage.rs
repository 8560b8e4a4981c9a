//! Times of the steps of the work.

use serde::{Deserialize, Serialize};

/// One timed step of the work.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Stage {
    /// A phrase, such as `splat samples`.
    pub name: String,
    /// Milliseconds.
    pub ms: f64,
}

impl Stage {
    /// Cost of frames that were discarded because they exceeded the request's error bound.
    pub const REFUSED: &str = "refused frames";

    /// Names of the stages in which a view waits or travels.
    const ON_THE_WAY: [&str; 5] = ["samples", "queue", "encode", "relay", Self::DETOUR];

    /// The redirected client's way to the worker that rendered its frame, and back.
    pub const DETOUR: &str = "detour";

    /// Whether a stage is transport or waiting rather than rendering.
    pub fn is_on_the_way(name: &str) -> bool {
        Self::ON_THE_WAY.contains(&name)
    }

    /// A stage with its duration.
    pub fn new(name: impl Into<String>, ms: f64) -> Self {
        Self { name: name.into(), ms }
    }
}
