//! Views: requests of clients, and their plans.

use serde::{Deserialize, Serialize};

use crate::{Camera, Detail, FaceMasks, FrameSource, InvalidField, Provenance, SampleId, SurfaceLight};

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

/// One image a frame may hold.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Output {
    /// sRGB, 8 bits.
    Color,
    /// Distance from the eye, metres, +inf without a surface.
    Range,
    /// 255 where no sample saw the pixel's surface, else 0.
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

/// A named goal for quality; the explicit settings of a [`PlanRequest`] override it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Preset {
    /// The cheapest plan, for the shortest wait.
    Interactive,
    /// The smallest error within about twice the cheapest plan's time.
    Balanced,
    /// No pixel is guessed: holes are traced and edges supersampled.
    Exact,
}

/// A client's settings of the plan; the service chooses those that are unset.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct PlanRequest {
    /// Render from the triangles.
    pub direct: bool,
    /// How much of a view from triangles is rendered; only with `direct`.
    pub detail: Option<Detail>,
    /// Search for a pixel's depth.
    pub search: Option<Search>,
    /// Linear steps, 1 to 4096.
    pub steps: Option<u32>,
    /// Sub-pixels per pixel and side, 1 to 8; the cost grows with the square.
    pub supersampling: Option<u32>,
    /// Largest number of samples, 1 to 8.
    pub samples: Option<u32>,
    /// Treatment of pixels that no sample saw.
    pub holes: Option<Holes>,
    /// A named goal for quality.
    pub preset: Option<Preset>,
    /// Largest accepted mean FLIP against the reference, above 0 and up to 1.
    pub max_error: Option<f64>,
    /// Longest rendering time in milliseconds, above 0 and up to an hour.
    pub deadline_ms: Option<f64>,
}

impl PlanRequest {
    /// A view from samples; the request waits until they are rendered.
    pub fn from_samples() -> Self {
        Self { search: Some(Search::default()), ..Self::default() }
    }

    /// Whether the service may choose between triangles and samples: the request names neither and sets no knob that
    /// only one of them has.
    pub fn leaves_way_open(&self) -> bool {
        let Self { direct, detail, search, steps, samples, holes, max_error, .. } = *self;
        let names_one = direct
            || detail.is_some()
            || search.is_some()
            || steps.is_some()
            || samples.is_some()
            || holes.is_some();
        !names_one && max_error.is_none()
    }
}

/// A client's request for an image.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct View {
    /// Viewpoint.
    pub camera: Camera,
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Images of the answer.
    pub outputs: Outputs,
    /// Settings of the plan.
    pub plan: PlanRequest,
    /// Requires exactly this provenance (its plan, epoch and specification); an error if it is not available.
    pub pin: Option<Provenance>,
}

/// The largest accepted view.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Limits {
    /// Pixels on a side.
    pub max_side: u32,
    /// Pixels in all.
    pub max_pixels: u64,
}

impl Default for Limits {
    fn default() -> Self {
        Self { max_side: 8192, max_pixels: 16 << 20 }
    }
}

impl View {
    /// Rejects an invalid view by field. Code behind this check need not repeat it.
    pub fn validate(&self, limits: &Limits) -> Result<(), InvalidField> {
        self.camera.validate()?;
        InvalidField::within("width", self.width, 1..=limits.max_side)?;
        InvalidField::within("height", self.height, 1..=limits.max_side)?;
        let pixels = u64::from(self.width) * u64::from(self.height);
        if pixels > limits.max_pixels {
            let reason = format!("width × height must be at most {} pixels, not {pixels}", limits.max_pixels);
            return Err(InvalidField::new("width", reason));
        }
        if self.outputs == Outputs::default() {
            return Err(InvalidField::new("outputs", "at least one output must be asked for"));
        }
        let within = |field, value: Option<u32>, most| {
            value.map_or(Ok(0), |value| InvalidField::within(field, value, 1..=most))
        };
        within("plan.steps", self.plan.steps, 4096)?;
        within("plan.supersampling", self.plan.supersampling, 8)?;
        within("plan.samples", self.plan.samples, 8)?;
        if self.plan.detail.is_some() && !self.plan.direct {
            return Err(InvalidField::new(
                "plan.detail",
                "is of views from triangles: ask for `direct`, too",
            ));
        }
        // Written so that NaN is refused.
        if self.plan.max_error.is_some_and(|e| !(e > 0.0 && e <= 1.0)) {
            return Err(InvalidField::new("plan.max_error", "must be a mean FLIP above 0 and up to 1"));
        }
        if self.plan.deadline_ms.is_some_and(|ms| !(ms > 0.0 && ms <= 3.6e6)) {
            return Err(InvalidField::new("plan.deadline_ms", "must be above 0 and at most an hour"));
        }
        if self.pin.as_ref().is_some_and(|pin| pin.history) {
            let reason = "began from an earlier frame of its session: it cannot be repeated";
            return Err(InvalidField::new("pin.history", reason));
        }
        let (field, per_pixel) = match self.pin.as_ref().map(|pin| &pin.plan) {
            Some(plan) => ("pin.plan", plan.sub_pixels(1)),
            None => ("plan.supersampling", u64::from(self.plan.supersampling.unwrap_or(1)).pow(2)),
        };
        if pixels.saturating_mul(per_pixel) > limits.max_pixels.saturating_mul(16) {
            let reason = "width × height × supersampling² is more than this service renders";
            return Err(InvalidField::new(field, reason));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    fn view() -> View {
        View {
            camera: Camera::look_at(DVec3::ONE, DVec3::ZERO),
            width: 200,
            height: 150,
            outputs: Outputs::COLOR,
            plan: PlanRequest::default(),
            pin: None,
        }
    }

    #[test]
    fn a_request_with_a_method_or_one_of_its_knobs_leaves_no_choice() {
        let open = PlanRequest::default();
        let preset = PlanRequest { preset: Some(Preset::Balanced), deadline_ms: Some(20.0), ..open };
        let finer = PlanRequest { supersampling: Some(2), ..open };
        assert!([open, preset, finer].iter().all(PlanRequest::leaves_way_open));
        let named = [
            PlanRequest { direct: true, ..open },
            PlanRequest { detail: Some(Detail::Half), ..open },
            PlanRequest { search: Some(Search::Splat), ..open },
            PlanRequest { steps: Some(8), ..open },
            PlanRequest { samples: Some(4), ..open },
            PlanRequest { holes: Some(Holes::Trace), ..open },
            PlanRequest { max_error: Some(0.1), ..open },
        ];
        assert!(!named.iter().any(PlanRequest::leaves_way_open));
    }

    #[test]
    fn sizes_and_knobs_outside_their_limits_are_rejected_by_name() {
        let limits = Limits::default();
        let field = |change: fn(&mut View)| {
            let mut view = view();
            change(&mut view);
            view.validate(&limits).expect_err("must be rejected").field
        };
        assert_eq!(field(|v| v.width = 0), "width");
        assert_eq!(field(|v| v.height = 0), "height");
        assert_eq!(field(|v| v.width = 8193), "width");
        assert_eq!(field(|v| (v.width, v.height) = (8192, 4096)), "width");
        assert_eq!(field(|v| v.outputs.color = false), "outputs");
        assert_eq!(field(|v| v.plan.steps = Some(0)), "plan.steps");
        assert_eq!(field(|v| v.plan.supersampling = Some(9)), "plan.supersampling");
        assert_eq!(field(|v| v.plan.samples = Some(0)), "plan.samples");
        assert_eq!(field(|v| v.plan.detail = Some(Detail::Half)), "plan.detail");
        for wrong in [0.0, -1.0, 1.5, f64::NAN] {
            let wish = PlanRequest { max_error: Some(wrong), ..PlanRequest::default() };
            let rejected = View { plan: wish, ..view() }.validate(&limits).unwrap_err();
            assert_eq!(rejected.field, "plan.max_error", "{wrong}");
        }
        for wrong in [0.0, -1.0, f64::INFINITY, f64::NAN] {
            let wish = PlanRequest { deadline_ms: Some(wrong), ..PlanRequest::default() };
            let rejected = View { plan: wish, ..view() }.validate(&limits).unwrap_err();
            assert_eq!(rejected.field, "plan.deadline_ms", "{wrong}");
        }
        assert_eq!(field(|v| v.camera.eye.x = f64::NAN), "camera.eye");
        let large = |v: &mut View| (v.width, v.height, v.plan.supersampling) = (4096, 4096, Some(8));
        assert_eq!(field(large), "plan.supersampling");
        let pin = |plan| {
            let scene = crate::SceneHash([0; 32]);
            Some(Provenance::of_plan(scene, crate::SceneState::default(), plan))
        };
        let direct = pin(Plan::direct(64));
        let pinned = View { width: 4096, height: 4096, pin: direct, ..view() };
        assert_eq!(pinned.validate(&limits).unwrap_err().field, "pin.plan");
        let begun = pin(Plan::direct(1)).map(|pin| Provenance { history: true, ..pin });
        assert_eq!(View { pin: begun, ..view() }.validate(&limits).unwrap_err().field, "pin.history");
        view().validate(&limits).unwrap();
    }
}
