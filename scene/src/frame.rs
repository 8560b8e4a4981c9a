//! Frames: the reply to a view, with its cost, confidence and provenance.

use bytes::Bytes;
use serde::{Deserialize, Serialize};

use crate::{Plan, SceneHash, SceneState, Specification, Stage};

/// One image a frame may hold.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Output {
    /// sRGB, 8 bits.
    Color,
    /// Distance from the eye, metres, +inf without a surface.
    Range,
    /// 255 where no sample saw the pixel's surface and it is guessed, 128 where no sample saw it and it was traced, else 0.
    Mask,
    /// Sample of the pixel: 1 + its position in the plan's list; 0 for none.
    Source,
    /// Confidence of the pixel: 0 where no sample saw it; else the low seven bits are 127 × (1 − residual). The
    /// residual is the difference between the searched depth and the sample's own, as a share of the tolerance. The
    /// highest bit is set where a second sample has the same surface.
    Confidence,
}

impl Output {
    /// All outputs.
    pub const ALL: [Self; 5] = [Self::Color, Self::Range, Self::Mask, Self::Source, Self::Confidence];

    /// Its name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Color => "color",
            Self::Range => "range",
            Self::Mask => "mask",
            Self::Source => "source",
            Self::Confidence => "confidence",
        }
    }

    /// Bytes of a pixel.
    pub fn pixel_bytes(self) -> usize {
        match self {
            Self::Color => 3,
            Self::Range => 4,
            Self::Mask | Self::Source | Self::Confidence => 1,
        }
    }
}

/// A set of [`Output`]s.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
pub struct Outputs {
    /// sRGB colour.
    pub color: bool,
    /// Range.
    pub range: bool,
    /// Mask of unresolved pixels.
    pub mask: bool,
    /// Index of each pixel's sample.
    pub source: bool,
    /// Confidence of each pixel.
    pub confidence: bool,
}

impl Outputs {
    /// Only colour.
    pub const COLOR: Self = Self { color: true, range: false, mask: false, source: false, confidence: false };

    /// Only the given output.
    pub fn only(output: Output) -> Self {
        Self::default().with(output)
    }

    /// The set with one more output.
    pub fn with(mut self, output: Output) -> Self {
        match output {
            Output::Color => self.color = true,
            Output::Range => self.range = true,
            Output::Mask => self.mask = true,
            Output::Source => self.source = true,
            Output::Confidence => self.confidence = true,
        }
        self
    }

    /// Whether an output is in the set.
    pub fn has(self, output: Output) -> bool {
        match output {
            Output::Color => self.color,
            Output::Range => self.range,
            Output::Mask => self.mask,
            Output::Source => self.source,
            Output::Confidence => self.confidence,
        }
    }
}

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
    /// Of several plans within the error bound, the earliest predicted to be done.
    Soonest,
    /// From triangles, since no available worker held samples for the view.
    NoSamples,
    /// From triangles, since the held samples miss a part of the view or are too coarse.
    SamplesFallShort,
    /// From triangles, since the frame from samples exceeded the error bound.
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
            Self::Soonest => "soonest within the error bound",
            Self::NoSamples => "no samples held",
            Self::SamplesFallShort => "samples too coarse, or miss a part",
            Self::FrameFellShort => "the frame from samples fell short",
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

/// The reply to a view. Images are tightly packed, row 0 at the top.
#[derive(Debug, Clone, PartialEq)]
pub struct Frame {
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// sRGB, 3 bytes a pixel.
    pub color: Option<Bytes>,
    /// f32 little-endian, metres from the eye, +inf for sky.
    pub range: Option<Bytes>,
    /// One byte per pixel: 255 if no sample saw it and it is guessed, 128 if no sample saw it and it was traced.
    pub mask: Option<Bytes>,
    /// One byte per pixel: 1 + position of the sample in the plan's list, 0 for none.
    pub source: Option<Bytes>,
    /// One byte per pixel, see [`crate::Output::Confidence`].
    pub confidence: Option<Bytes>,
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
            color: None,
            range: None,
            mask: None,
            source: None,
            confidence: None,
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

    /// One of its images, if present.
    pub fn image(&self, output: Output) -> Option<&Bytes> {
        match output {
            Output::Color => self.color.as_ref(),
            Output::Range => self.range.as_ref(),
            Output::Mask => self.mask.as_ref(),
            Output::Source => self.source.as_ref(),
            Output::Confidence => self.confidence.as_ref(),
        }
    }

    /// The slot of one of its images.
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
