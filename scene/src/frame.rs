//! Frames: the reply to a view, with its cost, confidence and provenance.

use serde::{Deserialize, Serialize};

use crate::{Images, Plan, SceneHash, SceneState, Specification, Stage};

/// All that a frame's bytes are a function of, together with its camera, size and outputs.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Provenance {
    /// Scene.
    pub scene: SceneHash,
    /// Epoch and light that it shows.
    pub state: SceneState,
    /// How it was answered, sample ids included.
    pub plan: Plan,
    /// How its samples were rendered, or the frame itself where it comes from triangles. Every frame has one; `None` in a
    /// pin means any.
    pub specification: Option<Specification>,
    /// Adapter, driver and version. Empty in a pin means any.
    pub device: String,
    /// Whether its search began from an earlier frame ([`crate::History`]): its bytes are then a function of that one, too,
    /// and it cannot be repeated.
    pub history: bool,
}

impl Provenance {
    /// By any device and any specification: a pin that asks for no more than this plan.
    pub fn of_plan(scene: SceneHash, state: SceneState, plan: Plan) -> Self {
        Self { scene, state, plan, specification: None, device: String::new(), history: false }
    }
}

/// Numbers of a frame's pixels by how they were served.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Served {
    /// Served by the sample whose texel gave the pixel its depth, or seen as sky.
    pub warped: u64,
    /// Served by another sample of the plan, since that one did not see the pixel.
    pub other_sample: u64,
    /// Traced by a sampler.
    pub traced: u64,
    /// Guessed.
    pub unresolved: u64,
}

/// The prediction for a frame.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Prediction {
    /// An upper bound of the mean FLIP against the reference at 67 pixels a degree, which all but a few per cent of
    /// such frames keep. It is compared with the request's bound, and exceeds it if that cannot be kept.
    pub error: f64,
    /// Milliseconds of rendering.
    pub ms: f64,
}

/// Why the service chose a view's plan.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Reason {
    /// The request or its pin names the plan.
    Requested,
    /// From sources, whose predicted error and price of time are least together.
    Soonest,
    /// From triangles, since no worker held a source near the view.
    NoSamples,
    /// From triangles, since from the sources that are held the error would cost more than the time.
    SamplesFallShort,
    /// From triangles, since the sources missed more of the view than predicted, or were gone.
    FrameFellShort,
    /// Beyond the error bound, since a frame within it would have been too late.
    TimeFirst,
    /// Like the session's last frame, since its camera stands still or its plan has just changed.
    Kept,
    /// Unlike the last frame of a camera that stands still, since this plan is predicted to have less error.
    Upgrade,
    /// From triangles in less detail, yet within the error bound, since more is asked of the service than it carries in full.
    LessDetail,
}

impl Reason {
    /// All reasons, in the order of their numbers on the wire, from 1.
    pub const ALL: [Self; 9] = [
        Self::Requested,
        Self::Soonest,
        Self::NoSamples,
        Self::SamplesFallShort,
        Self::FrameFellShort,
        Self::TimeFirst,
        Self::Kept,
        Self::Upgrade,
        Self::LessDetail,
    ];

    /// A phrase for users.
    pub fn phrase(self) -> &'static str {
        match self {
            Self::Requested => "as requested",
            Self::Soonest => "least error for its time",
            Self::NoSamples => "no source near",
            Self::SamplesFallShort => "sources would err too much",
            Self::FrameFellShort => "the frame from sources fell short",
            Self::TimeFirst => "time before error",
            Self::Kept => "as the frame before it",
            Self::Upgrade => "upgraded to less error",
            Self::LessDetail => "less detail, since much is asked for",
        }
    }
}

/// The planner's choice for a view with an open plan, and its predictions.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Decision {
    /// Why the plan was chosen.
    pub reason: Reason,
    /// Predicted milliseconds until rendering begins.
    pub wait_ms: f64,
    /// Predicted milliseconds of rendering; 0 if no cost is known yet.
    pub render_ms: f64,
    /// Predicted mean FLIP minus that of a direct view.
    pub excess: f64,
}

/// The reply to a view.
#[derive(Debug, Clone, PartialEq)]
pub struct Frame {
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Its images.
    pub images: Images,
    /// Fraction of pixels that no sample saw and no ray filled: guesses. 0 for a direct view.
    pub unresolved_fraction: f64,
    /// Numbers of pixels by how they were served; all zero for a direct view.
    pub served: Served,
    /// The prediction for this frame, if the service has a model: made before rendering, or from the pixels if the
    /// request bounds the error.
    pub predicted: Option<Prediction>,
    /// How its plan was chosen; `None` if the request or its pin named it.
    pub decision: Option<Decision>,
    /// All inputs of its bytes.
    pub provenance: Provenance,
    /// Costs by stage. A batch's cost is divided evenly among its views.
    pub stages: Vec<Stage>,
}

impl Frame {
    /// A frame whose images are still to come. It says nothing of its cost, and that no pixel is a guess.
    pub fn without_images(width: u32, height: u32, provenance: Provenance) -> Self {
        Self {
            width,
            height,
            images: Images::default(),
            unresolved_fraction: 0.0,
            served: Served::default(),
            predicted: None,
            decision: None,
            provenance,
            stages: Vec::new(),
        }
    }

    /// Milliseconds of all its rendering, including discarded frames.
    pub fn rendering_ms(&self) -> f64 {
        self.stages.iter().filter(|stage| !Stage::is_on_the_way(&stage.name)).map(|stage| stage.ms).sum()
    }
}
