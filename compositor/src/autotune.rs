//! Chooses the faster of a search's two programs on this device, by timing real batches.
//!
//! Both programs write equal bytes, so timing them changes no frame.

use crate::settings::SearchBackend;

/// The autotuning of one search.
#[derive(Debug, Default)]
pub(crate) struct Autotune {
    /// Nanoseconds a sub-pixel, by round: fragment program, compute program.
    times: [Vec<f64>; 2],
    decided: Option<SearchBackend>,
}

/// Rounds of each program. The first is not counted: quirk `compiled-at-first-use`.
const ROUNDS: usize = 4;

/// Fewest sub-pixels of a batch that is timed.
const MIN_SUB_PIXELS: u64 = 1 << 14;

impl Autotune {
    /// The program that draws the next batch. Never returns [`SearchBackend::Auto`].
    pub(crate) fn next(&self, setting: SearchBackend) -> SearchBackend {
        match (setting, self.decided) {
            (SearchBackend::Auto, Some(search_backend)) => search_backend,
            (SearchBackend::Auto, None) if self.times[1].len() < self.times[0].len() => {
                SearchBackend::Compute
            }
            (SearchBackend::Auto, None) => SearchBackend::Fragment,
            (fixed, _) => fixed,
        }
    }

    /// The faster program, once it is known.
    pub(crate) fn decided(&self) -> Option<SearchBackend> {
        self.decided
    }

    /// Records the time of a batch. Returns the faster program if this batch decided it.
    pub(crate) fn note(
        &mut self,
        search_backend: SearchBackend,
        ms: f64,
        sub_pixels: u64,
    ) -> Option<SearchBackend> {
        if self.decided.is_some() || sub_pixels < MIN_SUB_PIXELS || !(ms > 0.0) {
            return None;
        }
        self.times[usize::from(search_backend == SearchBackend::Compute)].push(ms * 1e6 / sub_pixels as f64);
        if self.times.iter().any(|times| times.len() < ROUNDS) {
            return None;
        }
        let [fragment, compute] = self.times.each_ref().map(|times| median(&times[1..]));
        let search_backend =
            if compute < fragment { SearchBackend::Compute } else { SearchBackend::Fragment };
        self.decided = Some(search_backend);
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

    fn decide(fragment: f64, compute: f64) -> SearchBackend {
        let mut tuning = Autotune::default();
        for turn in 0.. {
            let search_backend = tuning.next(SearchBackend::Auto);
            let first = if turn < 2 { 100.0 } else { 0.0 };
            let ms = first + if search_backend == SearchBackend::Compute { compute } else { fragment };
            assert!(turn < 2 * ROUNDS, "must be decided by now");
            // Too few sub-pixels, and a time of zero: both are ignored.
            assert_eq!(
                tuning.note(search_backend, 1e9, 10).or(tuning.note(search_backend, 0.0, 1 << 20)),
                None
            );
            if let Some(decided) = tuning.note(search_backend, ms, 1 << 20) {
                assert_eq!((tuning.decided(), tuning.next(SearchBackend::Auto)), (Some(decided), decided));
                return decided;
            }
        }
        unreachable!()
    }

    #[test]
    fn the_faster_program_is_chosen_and_first_rounds_do_not_count() {
        assert_eq!(decide(2.0, 1.0), SearchBackend::Compute);
        assert_eq!(decide(1.0, 2.0), SearchBackend::Fragment);
        assert_eq!(decide(1.0, 1.0), SearchBackend::Fragment);
    }

    #[test]
    fn a_fixed_backend_overrides_autotuning() {
        let tuning = Autotune { decided: Some(SearchBackend::Compute), ..Autotune::default() };
        assert_eq!(tuning.next(SearchBackend::Fragment), SearchBackend::Fragment);
        assert_eq!(tuning.next(SearchBackend::Compute), SearchBackend::Compute);
    }
}
