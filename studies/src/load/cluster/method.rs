//! The methods of answering views, and what they should cost.

use argus_cluster::core::balance::{self, Split};

use crate::load::simulate::Parameters;
use crate::load::simulate::efficiency::{Case, load_of};

/// How views are answered.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Method {
    /// All workers render all views directly.
    Naive,
    /// K workers render samples anew each tick; the rest compose.
    Proposed,
    /// Like [`Self::Proposed`], but samplers also compose in their spare time.
    Helping,
    /// Samples are rendered once; the scene does not move.
    Still,
}

impl Method {
    pub(super) const ALL: [Self; 4] = [Self::Naive, Self::Proposed, Self::Helping, Self::Still];

    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Naive => "naive",
            Self::Proposed => "proposed",
            Self::Helping => "proposed, samplers compose",
            Self::Still => "proposed, still scene",
        }
    }
}

/// The paper's experiments have no effects of light.
pub(super) const PLAIN: &str = "--effects=none";

/// Table 1 of the paper, at 1000 views: processes, efficiency proposed, efficiency naive.
const PAPER: [(u32, f64, f64); 7] = [
    (5, 0.715, 0.103),
    (6, 0.757, 0.105),
    (7, 0.792, 0.106),
    (8, 0.812, 0.108),
    (9, 0.818, 0.108),
    (10, 0.826, 0.110),
    (11, 0.829, 0.110),
];

/// The paper's efficiency for this many processes, if it has one.
pub(super) fn paper(processes: u32, method: Method) -> Option<f64> {
    let (_, proposed, naive) = PAPER.into_iter().find(|row| row.0 == processes)?;
    Some(if method == Method::Naive { naive } else { proposed })
}

/// The predicted seconds of a tick with the given number of samplers.
pub(super) fn predicted_secs(load: balance::Load, processes: u32, samplers: u32, method: Method) -> f64 {
    let split = match method {
        _ if processes < 2 => Split::Alone,
        Method::Naive => Split::AllDirect,
        _ => Split::Divided(samplers.clamp(1, processes - 1)),
    };
    match method {
        Method::Helping => balance::helping_tick_secs(load, processes, split),
        _ => balance::tick_secs(load, processes, split),
    }
}

/// The work of a tick, from costs in milliseconds.
pub(super) fn load(
    views: u64,
    method: Method,
    (sample_ms, direct_ms, view_ms): (f64, f64, f64),
) -> balance::Load {
    let costs = Parameters { sample_ms, direct_ms, view_ms, ..Parameters::default() };
    let (refreshed, direct) = (matches!(method, Method::Proposed | Method::Helping), method == Method::Naive);
    load_of(
        &Case { processes: 1, views, refreshed, direct, helping: false, ticks: 1, settled_secs: 0.0 },
        &costs,
    )
}
