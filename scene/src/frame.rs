//! Frames: the reply to a view, with what it cost, how sure it is, and where it came from.

use bytes::Bytes;
use serde::{Deserialize, Serialize};

use crate::{Output, Plan, SceneHash, Specification};

/// One timed step of the work.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Stage {
    /// A phrase, such as `splat samples`.
    pub name: String,
    /// Milliseconds.
    pub ms: f64,
}

impl Stage {
    /// What frames cost that were thrown away because they were not good enough for the request.
    pub const REFUSED: &str = "refused frames";

    /// Names of the stages in which a view waits or travels.
    const ON_THE_WAY: [&str; 5] = ["samples", "queue", "encode", "relay", Self::DETOUR];

    /// A client's way to the worker that made its frame, and back.
    pub const DETOUR: &str = "detour";

    /// Whether a stage of that name is part of a view's way to where it is rendered and back.
    pub fn is_on_the_way(name: &str) -> bool {
        Self::ON_THE_WAY.contains(&name)
    }

    /// A named duration.
    pub fn new(name: impl Into<String>, ms: f64) -> Self {
        Self { name: name.into(), ms }
    }
}

/// All that a frame's bytes are a function of, together with its camera, size and outputs.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Provenance {
    /// Scene.
    pub scene: SceneHash,
    /// Scene time.
    pub epoch: u64,
    /// How it was answered, sample ids included.
    pub plan: Plan,
    /// How its samples were rendered, or the frame itself where it comes from triangles. Every frame has one; `None` in a
    /// pin means any.
    pub specification: Option<Specification>,
    /// Adapter, driver and version. Empty in a pin means any.
    pub device: String,
    /// Whether its search began from an earlier frame ([`crate::History`]): its bytes are then a function of that one, too,
    /// and nobody can repeat it.
    pub history: bool,
}

/// How many of a frame's pixels were served in which way.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Served {
    /// By the sample whose texel gave the pixel its depth, or by seeing past everything.
    pub warped: u64,
    /// By another of the plan's samples, after that one had not seen the pixel.
    pub other_sample: u64,
    /// By a sampler that traced the pixel's rays.
    pub traced: u64,
    /// By a guess.
    pub unresolved: u64,
}

/// What is expected of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Prediction {
    /// Mean FLIP against the reference, at 67 pixels a degree, that all but a few in a hundred such frames stay
    /// below: what is held to the bound of a request. A bound that cannot be kept is exceeded by it.
    pub error: f64,
    /// Milliseconds of rendering.
    pub ms: f64,
}

/// Why a view was answered in the way that it was.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Reason {
    /// The request, or its pin, says how.
    Requested,
    /// Of several ways within the error bound, the one whose frame was predicted to be done first.
    Soonest,
    /// From triangles, since no worker with room held samples for the view.
    NoSamples,
    /// From triangles, since the samples that were held miss a part of the view or are too coarse for it.
    SamplesFallShort,
    /// From triangles, since the frame that was reconstructed from samples was not good enough.
    FrameFellShort,
    /// Beyond the error bound, since a frame within it would have come too late.
    TimeFirst,
    /// As the session's last frame: its camera stands still, or its way has just changed.
    Kept,
    /// Otherwise than the session's last frame, whose camera stands still: this frame is predicted to have less error.
    Upgrade,
}

impl Reason {
    /// All of them, in the order of their numbers on the wire, from 1.
    pub const ALL: [Self; 8] = [
        Self::Requested,
        Self::Soonest,
        Self::NoSamples,
        Self::SamplesFallShort,
        Self::FrameFellShort,
        Self::TimeFirst,
        Self::Kept,
        Self::Upgrade,
    ];

    /// A phrase for people.
    pub fn phrase(self) -> &'static str {
        match self {
            Self::Requested => "as requested",
            Self::Soonest => "soonest within the error bound",
            Self::NoSamples => "no samples held",
            Self::SamplesFallShort => "samples too coarse, or miss a part",
            Self::FrameFellShort => "the frame from samples fell short",
            Self::TimeFirst => "time before error",
            Self::Kept => "as the frame before it",
            Self::Upgrade => "upgraded to less error",
        }
    }
}

/// How the planner decided about a view whose request left the way open, with what it predicted.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Decision {
    /// Why this way.
    pub reason: Reason,
    /// Predicted milliseconds until rendering begins.
    pub wait_ms: f64,
    /// Predicted milliseconds of rendering; 0 where no cost was known yet.
    pub render_ms: f64,
    /// Predicted mean FLIP above that of a direct view.
    pub excess: f64,
}

/// The reply to a view. Images are tightly packed, row 0 at the top.
#[derive(Debug, Clone, PartialEq)]
pub struct Frame {
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// sRGB, 3 bytes a pixel.
    pub color: Option<Bytes>,
    /// f32 little-endian, metres from the eye, +inf where there is nothing.
    pub range: Option<Bytes>,
    /// A byte a pixel: 255 where no sample saw it and it is a guess, 128 where no sample saw it and it was traced.
    pub mask: Option<Bytes>,
    /// A byte a pixel: 1 + position of the sample in the plan's list, 0 for none.
    pub source: Option<Bytes>,
    /// A byte a pixel, see [`crate::Output::Confidence`].
    pub confidence: Option<Bytes>,
    /// Fraction of pixels that no sample saw and nothing else served: guesses. 0 for a direct view.
    pub unresolved_fraction: f64,
    /// How many pixels were served in which way; all zero for a direct view.
    pub served: Served,
    /// What the service expects of this frame, where it has a model: from what it knew before it was rendered,
    /// or, where the request bounds the error, from what its pixels look like.
    pub predicted: Option<Prediction>,
    /// How its way was chosen; `None` where the request, or its pin, named it.
    pub decision: Option<Decision>,
    /// What it was made of.
    pub provenance: Provenance,
    /// What it cost. A batch's cost is shared out evenly among its views.
    pub stages: Vec<Stage>,
}

impl Frame {
    /// Milliseconds of all its rendering, that of frames which were thrown away for it included.
    pub fn rendering_ms(&self) -> f64 {
        self.stages.iter().filter(|stage| !Stage::is_on_the_way(&stage.name)).map(|stage| stage.ms).sum()
    }

    /// One of its images, if it holds it.
    pub fn image(&self, output: Output) -> Option<&Bytes> {
        match output {
            Output::Color => self.color.as_ref(),
            Output::Range => self.range.as_ref(),
            Output::Mask => self.mask.as_ref(),
            Output::Source => self.source.as_ref(),
            Output::Confidence => self.confidence.as_ref(),
        }
    }

    /// Where one of its images is kept.
    pub fn image_mut(&mut self, output: Output) -> &mut Option<Bytes> {
        match output {
            Output::Color => &mut self.color,
            Output::Range => &mut self.range,
            Output::Mask => &mut self.mask,
            Output::Source => &mut self.source,
            Output::Confidence => &mut self.confidence,
        }
    }
}
