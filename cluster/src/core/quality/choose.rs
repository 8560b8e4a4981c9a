//! Which setting to try first, and what to do with the frame that came of it.

use std::cmp::Ordering;

use argus_scene::{Holes, PlanRequest, Prediction, Preset};

use super::Setting;
use super::regression::Belief;

/// Frames that are rendered for one request at most: the last is delivered whatever it looks like.
pub const MOST_TRIES: usize = 3;

/// How many times the cheapest plan's time a balanced one may take.
const BALANCED: f64 = 2.0;

/// A setting that may be tried.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Candidate<'a> {
    /// Which.
    pub setting: Setting,
    /// Milliseconds of rendering that are expected of it.
    pub ms: f64,
    /// What is believed of its error.
    pub error: Belief<'a>,
    /// By what factor the error that its own frame is held to lies above the true one, typically.
    pub judged_factor: f64,
}

/// What is wanted beside what the plan must be.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct QualityTarget {
    /// The greatest error that is accepted.
    pub max_error: Option<f64>,
    /// Milliseconds that rendering may take, after those it has to wait.
    pub deadline_ms: Option<f64>,
    /// A named trade of time for error.
    pub preset: Option<Preset>,
}

impl QualityTarget {
    /// The target that a request states; `None` if it states none.
    pub fn of(request: &PlanRequest) -> Option<Self> {
        let PlanRequest { max_error, deadline_ms, preset, .. } = *request;
        let target = Self { max_error, deadline_ms, preset };
        (target != Self::default()).then_some(target)
    }

    /// Whether a preset forbids a setting: exact ones guess no pixel, and supersample what they warp.
    fn forbids(&self, setting: Setting) -> bool {
        let guesses = match setting {
            Setting::Direct { .. } => false,
            Setting::Warp { holes, supersampling, .. } => holes != Holes::Trace || supersampling < 2,
        };
        self.preset == Some(Preset::Exact) && guesses
    }

    /// Whether a candidate is done in time after waiting for `wait_ms`.
    fn affords(&self, candidate: &Candidate<'_>, wait_ms: f64) -> bool {
        // Written so that NaN is not afforded.
        self.deadline_ms.is_none_or(|deadline| wait_ms + candidate.ms <= deadline)
    }
}

/// What to do next.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Step {
    /// Render with a setting.
    Try {
        /// Which.
        setting: Setting,
        /// What is expected of the frame.
        expected: Prediction,
        /// Whether its frame is to be judged: [`next`] decides about it. Else it is delivered.
        judged: bool,
    },
    /// Deliver the frame that was seen.
    Deliver {
        /// What is now expected of it.
        expected: Prediction,
    },
}

/// The first setting to try; `None` where there is nothing to choose among. `wait_ms` is how long a setting
/// has to wait before its turn.
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
        // Late all the same: what is done first.
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

/// What to do about a frame of `tried`'s last setting. `candidates` are believed in the light of that frame;
/// `spent_ms` have passed since the first try began.
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
    // What was thrown away can be made again, but not to be judged again.
    let unjudged: Vec<Setting> = if last { open.iter().map(|c| c.setting).collect() } else { tried.to_vec() };
    // Where something is certain to keep the bound, what costs less to begin with may be as uncertain as what was seen.
    let reachable = open.iter().any(|c| c.error.upper() <= bound);
    match bounded(&open, &unjudged, bound) {
        Some(chosen) if reachable || by_error(&chosen, seen).is_lt() => {
            attempt(&chosen, !unjudged.contains(&chosen.setting))
        }
        // Nothing is better.
        _ => delivered(seen),
    }
}

/// The candidate to try for a bound: the cheapest that is certain to keep it, or one that it costs less to
/// begin with, even though its frame may be thrown away; the best there is where none is certain. Those in
/// `unjudged` are tried only if they are certain, or the best.
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

/// Milliseconds until a frame is accepted that beginning with a candidate is expected to take. Its frame tells
/// so much about all others that after it the right one is known: the cheapest that keeps the bound, and what
/// a cheaper one keeps the dearer ones are taken to keep as well.
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

/// The one first whose error is sure to be less; of two that may both be wrong in any way, the one that is expected to be less so.
fn by_error(a: &Candidate<'_>, b: &Candidate<'_>) -> Ordering {
    let upper = a.error.upper().total_cmp(&b.error.upper());
    upper.then_with(|| a.error.median().total_cmp(&b.error.median()))
}

/// The candidate with the least of something; what is not a number is more than any number.
fn least<'c, 'a: 'c>(
    candidates: impl Iterator<Item = &'c Candidate<'a>>,
    of: impl Fn(&&Candidate<'a>) -> f64,
) -> Option<Candidate<'a>> {
    candidates.min_by(|a, b| of(a).total_cmp(&of(b))).copied()
}
