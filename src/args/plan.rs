//! Flags of how a view is answered.

use argus_client::load::WalkKind;
use argus_scene::{Detail, Holes, Output, PlanRequest, Preset, Search};
use clap::builder::{PossibleValuesParser, TypedValueParser};

/// How a view is answered. Without these flags the service chooses the fastest plan that is as good as a direct view.
/// --search, --steps, --samples and --holes ask for samples, and wait until they are rendered.
#[derive(clap::Args, Debug, Clone)]
#[command(next_help_heading = "Plan")]
pub(crate) struct Plan {
    /// Reconstruct from samples, and find the depth of a pixel by: splat (samples are splatted forward; fastest), linear (the
    /// cluster paper's steps along the ray), seeded (fixed-point iteration from a coarse splat) or pyramid (exact)
    #[arg(long, value_name = "SEARCH", value_parser = search())]
    pub(crate) search: Option<Search>,
    /// Steps of the linear and seeded searches, 1 to 4096; more steps find more surfaces and cost time
    #[arg(long, value_name = "N")]
    pub(crate) steps: Option<u32>,
    /// Render from the triangles, never from samples. This also fixes the plan: a plan that is left open depends on what the
    /// workers hold, and so on other viewers
    #[arg(long)]
    pub(crate) direct: bool,
    /// Render less of a view from triangles: few-rays (a quarter of the rays of light), half (the size), half-few-rays or
    /// quarter (the size, with few rays). Needs --direct. By default all is rendered, but under load what there is time for
    #[arg(long, value_name = "DETAIL", value_parser = detail(), requires = "direct")]
    pub(crate) detail: Option<Detail>,
    /// Sub-pixels on a side of each pixel, 1 to 8; N costs about N² times as much
    #[arg(long, value_name = "N")]
    pub(crate) supersampling: Option<u32>,
    /// Reconstruct from at most this many samples, 1 to 8
    #[arg(long, value_name = "N")]
    pub(crate) samples: Option<u32>,
    /// Pixels that no sample saw: mark (guess their colour and set them in the mask) or trace (trace their
    /// rays, which costs time)
    #[arg(long, value_name = "HOW", value_parser = holes())]
    pub(crate) holes: Option<Holes>,
    /// Goal of the plan: interactive (least time), balanced (the fastest image that is as good as a direct view; the
    /// default) or exact (no guessed pixel, four samples a pixel)
    #[arg(long, value_name = "GOAL", value_parser = preset())]
    pub(crate) preset: Option<Preset>,
    /// Greatest accepted mean FLIP error against the reference, above 0 and up to 1. `argus-lab study views bounds` calibrates the
    /// scene, so that the cheapest plan that keeps the bound is taken
    #[arg(long, value_name = "FLIP", allow_negative_numbers = true)]
    pub(crate) max_error: Option<f64>,
    /// Milliseconds that the answer may take; the service chooses the plan with the least error that is
    /// expected to keep it
    #[arg(long, value_name = "MS", allow_negative_numbers = true)]
    pub(crate) deadline_ms: Option<f64>,
}

impl Plan {
    /// Converts the flags to a plan request.
    pub(crate) fn request(&self) -> PlanRequest {
        PlanRequest {
            direct: self.direct,
            detail: self.detail,
            search: self.search,
            steps: self.steps,
            supersampling: self.supersampling,
            samples: self.samples,
            holes: self.holes,
            preset: self.preset,
            max_error: self.max_error,
            deadline_ms: self.deadline_ms,
        }
    }
}

/// Parses the name of a depth search.
pub fn search() -> impl TypedValueParser<Value = Search> {
    PossibleValuesParser::new(Search::ALL.map(Search::name))
        .map(|name| Search::ALL.into_iter().find(|s| s.name() == name).unwrap_or_default())
}

/// Parses the name of a walk.
pub(crate) fn walk() -> impl TypedValueParser<Value = WalkKind> {
    PossibleValuesParser::new(WalkKind::ALL.map(WalkKind::name))
        .map(|name| WalkKind::ALL.into_iter().find(|kind| kind.name() == name).unwrap_or_default())
}

fn detail() -> impl TypedValueParser<Value = Detail> {
    PossibleValuesParser::new(Detail::ALL.map(Detail::name))
        .map(|name| Detail::ALL.into_iter().find(|detail| detail.name() == name).unwrap_or_default())
}

fn holes() -> impl TypedValueParser<Value = Holes> {
    PossibleValuesParser::new(["mark", "trace"]).map(|name| match name.as_str() {
        "trace" => Holes::Trace,
        _ => Holes::Mark,
    })
}

const PRESETS: [(&str, Preset); 3] =
    [("interactive", Preset::Interactive), ("balanced", Preset::Balanced), ("exact", Preset::Exact)];

fn preset() -> impl TypedValueParser<Value = Preset> {
    PossibleValuesParser::new(PRESETS.map(|(name, _)| name)).map(|name| {
        PRESETS.into_iter().find(|(known, _)| *known == name).map_or(Preset::Balanced, |(_, preset)| preset)
    })
}

/// Parses the name of one image of a frame.
pub(crate) fn output() -> impl TypedValueParser<Value = Output> {
    PossibleValuesParser::new(Output::ALL.map(Output::name))
        .map(|name| Output::ALL.into_iter().find(|o| o.name() == name).unwrap_or(Output::Color))
}
