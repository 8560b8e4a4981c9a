//! The passes that a view needs, and why.

use argus_scene::{Output, Outputs, Plan, Search, Warp};

use crate::passes::reproject::ReprojectPass;
use crate::search_pipelines::name;

/// Whether a pass, or a part of one, runs for a view.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PassPlan {
    /// Name. A pass has the name of its row in the timing table.
    pub name: &'static str,
    /// Whether it runs.
    pub on: bool,
    /// The property of the view or of its samples that switches it on or off.
    pub why: String,
}

/// The passes of one view. `no_reprojection` is the reason why it does not start from an earlier frame; `None` if it
/// does.
pub(crate) fn pass_plan(
    plan: &Plan,
    outputs: Outputs,
    [glossy, reflects]: [bool; 2],
    no_reprojection: Option<&'static str>,
    splat_samples: usize,
) -> Vec<PassPlan> {
    let Plan::Warp(Warp { search, supersampling, samples, steps, .. }) = plan else {
        let why =
            "the plan is direct: it is rendered from triangles, which a compositor never has".to_owned();
        return vec![PassPlan { name: "warp views", on: false, why }];
    };
    let row = |name, on, why: &str| PassPlan { name, on, why: why.to_owned() };
    let searched = format!("the plan's search is `{}`", search.name());
    let stepped = format!("{searched}; at most {steps} steps");
    let count = splat_samples.min(samples.len());
    let fills = matches!(search, Search::Splat | Search::Seeded);
    let reprojects = no_reprojection.is_none();
    let splat_why = match reprojects {
        true => "an earlier frame says where surfaces are".to_owned(),
        false => format!("{searched}; the first {count} samples leave their depth"),
    };
    let is = |one| *search == one;
    vec![
        row("splat samples", fills && !reprojects, &splat_why),
        row(
            "splat squares",
            fills && !reprojects,
            "texels that may lie farther apart than cells leave their depth in all that are between",
        ),
        row(
            ReprojectPass::NAME,
            reprojects,
            no_reprojection.unwrap_or("an earlier frame shows most of the view"),
        ),
        row("fill cells", fills, &searched),
        row("mask sky", is(Search::Splat), "cells that no texel came near are sky if the samples say so"),
        row(name(Search::Splat), is(Search::Splat), &searched),
        row("collect pixels", is(Search::Splat), "pixels that the warp left over are listed"),
        row("second pass", is(Search::Splat), "pixels that one sample did not settle are tried in all"),
        row(
            "add highlights",
            is(Search::Splat) && glossy,
            "glossy pixels are lit one by one, so that the others do not pay",
        ),
        row(name(Search::Linear), is(Search::Linear), &stepped),
        row(name(Search::Seeded), is(Search::Seeded), &stepped),
        row("make pyramid", is(Search::Pyramid), "of samples that have none yet, for searches that read it"),
        row(name(Search::Pyramid), is(Search::Pyramid), &searched),
        row(
            "specular",
            glossy,
            if glossy { "the samples carry normals and F0" } else { "nothing in the samples is glossy" },
        ),
        row(
            "reflection probes",
            reflects,
            if reflects {
                "the samples say which map each surface looks up"
            } else {
                "the set has no reflections"
            },
        ),
        row("average sub-pixels", *supersampling > 1, &format!("{supersampling} sub-pixels a side")),
        row(
            "range target",
            outputs.has(Output::Range),
            if outputs.has(Output::Range) {
                "the view asks for range"
            } else {
                "the view does not ask for range"
            },
        ),
    ]
}
