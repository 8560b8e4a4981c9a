//! Which passes views call for, and why.

use argus_scene::{Outputs, Plan, Search, Warp};

/// Whether one piece of work runs for a view.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PassPlan {
    /// What it does; a pass has the name of its timing row.
    pub name: &'static str,
    /// Whether it runs.
    pub on: bool,
    /// What of the view or of its samples calls for it, or makes it needless.
    pub why: String,
}

/// The passes for one view.
pub(crate) fn plan(plan: &Plan, outputs: Outputs, glossy: bool, splatting: usize) -> Vec<PassPlan> {
    let Plan::Warp(Warp { search, supersampling, samples, steps, .. }) = plan else {
        let why =
            "the plan is direct: it is rendered from triangles, which a compositor never has".to_owned();
        return vec![PassPlan { name: "warp views", on: false, why }];
    };
    let splat = *search == Search::Splat;
    let row = |name, on, why: &str| PassPlan { name, on, why: why.to_owned() };
    let searched = if splat { "the plan's search is the splat" } else { "the plan's search is linear" };
    let count = splatting.min(samples.len());
    vec![
        row("splat samples", splat, &format!("{searched}; the first {count} samples leave their depth")),
        row("fill cells", splat, searched),
        row("warp views", splat, searched),
        row("mend pixels", splat, "pixels that one sample did not settle are tried in all"),
        row("search views", !splat, &format!("{searched}; at most {steps} steps")),
        row(
            "specular",
            glossy,
            if glossy { "the samples carry normals and F0" } else { "nothing in the samples is glossy" },
        ),
        row("average sub-pixels", *supersampling > 1, &format!("{supersampling} sub-pixels a side")),
        row(
            "range target",
            outputs.range,
            if outputs.range { "the view asks for range" } else { "nobody asks" },
        ),
    ]
}
