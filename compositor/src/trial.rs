//! Which of a search's two programs is the faster on the device at hand: tried on real batches, then decided.
//!
//! Both write equal bytes, so that a trial never shows.

use crate::knobs::Twin;

/// One search's trial.
#[derive(Debug, Default)]
pub(crate) struct Trial {
    /// Nanoseconds a sub-pixel, of the fragment program and of the compute program.
    times: [Vec<f64>; 2],
    decided: Option<Twin>,
}

/// Turns of each program. The first is not counted: drivers make machine code in it.
const TURNS: usize = 4;

/// Sub-pixels of a batch that is worth timing.
const WORTHWHILE: u64 = 1 << 14;

impl Trial {
    /// The program that draws the next batch: never [`Twin::Auto`].
    pub(crate) fn next(&self, knob: Twin) -> Twin {
        match (knob, self.decided) {
            (Twin::Auto, Some(twin)) => twin,
            (Twin::Auto, None) if self.times[1].len() < self.times[0].len() => Twin::Compute,
            (Twin::Auto, None) => Twin::Fragment,
            (fixed, _) => fixed,
        }
    }

    /// Which was faster, once that is known.
    pub(crate) fn decided(&self) -> Option<Twin> {
        self.decided
    }

    /// Takes note of what a batch took. Returns the decision if this made it.
    pub(crate) fn note(&mut self, twin: Twin, ms: f64, sub_pixels: u64) -> Option<Twin> {
        if self.decided.is_some() || sub_pixels < WORTHWHILE || !(ms > 0.0) {
            return None;
        }
        self.times[usize::from(twin == Twin::Compute)].push(ms * 1e6 / sub_pixels as f64);
        if self.times.iter().any(|times| times.len() < TURNS) {
            return None;
        }
        let [fragment, compute] = self.times.each_ref().map(|times| median(&times[1..]));
        let twin = if compute < fragment { Twin::Compute } else { Twin::Fragment };
        self.decided = Some(twin);
        self.decided
    }
}

fn median(times: &[f64]) -> f64 {
    let mut sorted = times.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted.get(sorted.len() / 2).copied().unwrap_or(f64::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn decide(fragment: f64, compute: f64) -> Twin {
        let mut trial = Trial::default();
        for turn in 0.. {
            let twin = trial.next(Twin::Auto);
            let first = if turn < 2 { 100.0 } else { 0.0 };
            let ms = first + if twin == Twin::Compute { compute } else { fragment };
            assert!(turn < 2 * TURNS, "must be decided by now");
            // Too small to tell anything, and a clock that stood still.
            assert_eq!(trial.note(twin, 1e9, 10).or(trial.note(twin, 0.0, 1 << 20)), None);
            if let Some(decided) = trial.note(twin, ms, 1 << 20) {
                assert_eq!((trial.decided(), trial.next(Twin::Auto)), (Some(decided), decided));
                return decided;
            }
        }
        unreachable!()
    }

    #[test]
    fn the_faster_program_is_kept_and_the_first_turns_do_not_count() {
        assert_eq!(decide(2.0, 1.0), Twin::Compute);
        assert_eq!(decide(1.0, 2.0), Twin::Fragment);
        assert_eq!(decide(1.0, 1.0), Twin::Fragment);
    }

    #[test]
    fn a_knob_goes_before_any_trial() {
        let trial = Trial { decided: Some(Twin::Compute), ..Trial::default() };
        assert_eq!(trial.next(Twin::Fragment), Twin::Fragment);
        assert_eq!(trial.next(Twin::Compute), Twin::Compute);
    }
}
