//! Choice of the setting to try first, and of what follows its frame.

use std::cmp::Ordering;

use argus_scene::{Holes, PlanRequest, Prediction, Preset};

use super::Setting;
use super::regression::Belief;

/// Most frames rendered for one request: the last is delivered whatever its error.
pub const MOST_TRIES: usize = 3;

/// A balanced plan may take this many times the cheapest plan's time.
const BALANCED: f64 = 2.0;

/// A setting that may be tried.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Candidate<'a> {
    /// The setting.
    pub setting: Setting,
    /// Expected milliseconds of rendering.
    pub ms: f64,
    /// The belief about its error.
    pub error: Belief<'a>,
    /// Typical factor of the upper bound that its own frame will get, above its true error.
    pub judged_factor: f64,
}

/// The target that a request states.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct QualityTarget {
    /// The greatest accepted error; `None`: no bound.
    pub max_error: Option<f64>,
    /// Milliseconds for waiting and rendering; `None`: no deadline.
    pub deadline_ms: Option<f64>,
    /// A named trade-off between time and error.
    pub preset: Option<Preset>,
}

impl QualityTarget {
    /// The target that a request states; `None` if it states none.
    pub fn of(request: &PlanRequest) -> Option<Self> {
        let PlanRequest { max_error, deadline_ms, preset, .. } = *request;
        let target = Self { max_error, deadline_ms, preset };
        (target != Self::default()).then_some(target)
    }

    /// Whether the preset forbids a setting: exact views guess no pixel, and supersample warped ones.
    fn forbids(&self, setting: Setting) -> bool {
        let guesses = match setting {
            Setting::Direct { .. } => false,
            Setting::Warp { holes, supersampling, .. } => holes != Holes::Trace || supersampling < 2,
        };
        self.preset == Some(Preset::Exact) && guesses
    }

    /// Whether a candidate meets the deadline after waiting for `wait_ms`.
    fn affords(&self, candidate: &Candidate<'_>, wait_ms: f64) -> bool {
        // A NaN does not meet it.
        self.deadline_ms.is_none_or(|deadline| wait_ms + candidate.ms <= deadline)
    }
}

/// The next step for a request.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Step {
    /// Render with a setting.
    Try {
        /// Which.
        setting: Setting,
        /// The prediction for the frame.
        expected: Prediction,
        /// Whether [`next`] must judge its frame. Else it is delivered.
        judged: bool,
    },
    /// Deliver the rendered frame.
    Deliver {
        /// The prediction after the judgement.
        expected: Prediction,
    },
}

/// The first setting to try; `None` without candidates. `wait_ms` is the waiting time of a setting.
pub fn first(
    candidates: &[Candidate<'_>],
    target: &QualityTarget,
    wait_ms: impl Fn(Setting) -> f64,
) -> Option<Step> {
    let allowed = |c: &&Candidate<'_>| !target.forbids(c.setting);
    let affordable =
        candidates.iter().filter(allowed).filter(|c| target.affords(c, wait_ms(c.setting))).copied();
    let mut open: Vec<Candidate<'_>> = affordable.collect();
    if open.is_empty() {
        // If all are late, the earliest.
        let soonest = |c: &&Candidate<'_>| wait_ms(c.setting) + c.ms;
        let all = || candidates.iter();
        open.extend(least(all().filter(allowed), soonest).or(least(all(), soonest)));
    }
    if let Some(bound) = target.max_error {
        let chosen = bounded(&open, &[], bound)?;
        return Some(attempt(&chosen, open.len() > 1));
    }
    let cheapest = least(open.iter(), |c| c.ms)?;
    let chosen = match target.preset {
        Some(Preset::Interactive) => Some(cheapest),
        Some(Preset::Balanced) => {
            least(open.iter().filter(|c| c.ms <= BALANCED * cheapest.ms), |c| c.error.median())
        }
        Some(Preset::Exact) | None => least(open.iter(), |c| c.error.median()),
    };
    Some(attempt(&chosen?, false))
}

/// The step after a frame of the last setting in `tried`. `candidates` include what that frame showed; `spent_ms`
/// have passed since the first try.
pub fn next(
    candidates: &[Candidate<'_>],
    target: &QualityTarget,
    tried: &[Setting],
    spent_ms: f64,
    wait_ms: impl Fn(Setting) -> f64,
) -> Step {
    let seen = candidates.iter().find(|c| Some(&c.setting) == tried.last());
    let delivered = |seen: &Candidate<'_>| Step::Deliver { expected: expected(seen) };
    let (Some(seen), Some(bound)) = (seen, target.max_error) else {
        let nothing_known = Prediction { error: 1.0, ms: spent_ms };
        return seen.map_or(Step::Deliver { expected: nothing_known }, delivered);
    };
    if seen.error.upper() <= bound {
        return delivered(seen);
    }
    let open: Vec<Candidate<'_>> = candidates
        .iter()
        .filter(|c| !target.forbids(c.setting) && c.setting != seen.setting)
        .filter(|c| target.affords(c, spent_ms + wait_ms(c.setting)))
        .copied()
        .collect();
    let last = tried.len() + 1 >= MOST_TRIES;
    // A rejected frame can be rendered again, but is not judged again.
    let unjudged: Vec<Setting> = if last { open.iter().map(|c| c.setting).collect() } else { tried.to_vec() };
    // If a setting surely keeps the bound, cheaper ones may be tried although they are as uncertain as what was seen.
    let reachable = open.iter().any(|c| c.error.upper() <= bound);
    match bounded(&open, &unjudged, bound) {
        Some(chosen) if reachable || by_error(&chosen, seen).is_lt() => {
            attempt(&chosen, !unjudged.contains(&chosen.setting))
        }
        // No candidate is better.
        _ => delivered(seen),
    }
}

/// The candidate to try for a bound: the cheapest that surely keeps it, or one that is cheaper to begin with, even
/// though its frame may be rejected. If none surely keeps it, the best one. Those in `unjudged` are tried only if
/// they surely keep it, or are the best.
fn bounded<'a>(open: &[Candidate<'a>], unjudged: &[Setting], bound: f64) -> Option<Candidate<'a>> {
    let certain = least(open.iter().filter(|c| c.error.upper() <= bound), |c| c.ms);
    let fallback = certain.or_else(|| open.iter().min_by(|a, b| by_error(a, b)).copied())?;
    let mut by_cost: Vec<(f64, &Candidate<'_>)> =
        open.iter().map(|c| (c.error.share_within(bound, c.judged_factor), c)).collect();
    by_cost.sort_by(|a, b| a.1.ms.total_cmp(&b.1.ms));
    let begun = by_cost.iter().filter(|(_, c)| !unjudged.contains(&c.setting));
    let begun = begun.map(|&(accepted, c)| (beginning_with(c, accepted, &by_cost, fallback.ms), c));
    Some(match begun.min_by(|a, b| a.0.total_cmp(&b.0)) {
        Some((ms, likely)) if ms < fallback.ms => *likely,
        _ => fallback,
    })
}

/// Expected milliseconds until a frame is accepted, if this candidate is tried first. Its frame is assumed to show
/// which candidate is right: the cheapest that keeps the bound, where dearer ones keep what a cheaper one keeps.
fn beginning_with(
    c: &Candidate<'_>,
    accepted: f64,
    by_cost: &[(f64, &Candidate<'_>)],
    fallback_ms: f64,
) -> f64 {
    let (mut settled, mut ms) = (accepted, c.ms);
    for (accepted, other) in by_cost {
        if *accepted > settled {
            ms += (accepted - settled) * other.ms;
            settled = *accepted;
        }
    }
    ms + (1.0 - settled) * fallback_ms
}

fn attempt(candidate: &Candidate<'_>, judged: bool) -> Step {
    Step::Try { setting: candidate.setting, expected: expected(candidate), judged }
}

fn expected(candidate: &Candidate<'_>) -> Prediction {
    Prediction { error: candidate.error.upper(), ms: candidate.ms }
}

/// Orders candidates by the upper bound of their error; of two with the greatest bound, by the median.
fn by_error(a: &Candidate<'_>, b: &Candidate<'_>) -> Ordering {
    let upper = a.error.upper().total_cmp(&b.error.upper());
    upper.then_with(|| a.error.median().total_cmp(&b.error.median()))
}

/// The candidate with the least value; a NaN is greater than any number.
fn least<'c, 'a: 'c>(
    candidates: impl Iterator<Item = &'c Candidate<'a>>,
    of: impl Fn(&&Candidate<'a>) -> f64,
) -> Option<Candidate<'a>> {
    candidates.min_by(|a, b| of(a).total_cmp(&of(b))).copied()
}
