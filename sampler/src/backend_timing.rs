//! Measures the cost of each visibility backend on real work.

use std::time::{Duration, Instant};

use argus_scene::Visibility;

/// A backend slower than the best by this factor is measured only once.
const TOO_SLOW: u32 = 2;
/// Only work longer than this is measured only once: compiling in the first run is negligible then.
const LONG: Duration = Duration::from_millis(40);

/// Runs `work` with each backend. Returns the milliseconds of each. `work` must return when the work is done.
///
/// # Errors
/// The errors of `work`.
pub(crate) fn measure<E>(
    backends: &[Visibility],
    mut work: impl FnMut(Visibility) -> Result<(), E>,
) -> Result<Vec<(Visibility, f64)>, E> {
    let mut times: Vec<(Visibility, Duration)> = Vec::new();
    for &backend in backends {
        let mut once = || {
            let begin = Instant::now();
            work(backend).map(|()| begin.elapsed())
        };
        let best = times.iter().map(|(_, time)| *time).min();
        let first = once()?;
        let hopeless = best.is_some_and(|best| first > best * TOO_SLOW);
        let time = if first > LONG && hopeless { first } else { first.min(once()?) };
        times.push((backend, time));
    }
    Ok(times.into_iter().map(|(backend, time)| (backend, time.as_secs_f64() * 1e3)).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slower_backend_is_measured_as_slower_and_errors_propagate() {
        for (slow, fast) in [(Visibility::Raster, Visibility::Cpu), (Visibility::Cpu, Visibility::Raster)] {
            let times = measure::<()>(&[Visibility::Raster, Visibility::Cpu], |backend| {
                std::thread::sleep(Duration::from_millis(if backend == slow { 30 } else { 1 }));
                Ok(())
            });
            let ms = |backend| times.as_ref().unwrap().iter().find(|(w, _)| *w == backend).unwrap().1;
            assert!(ms(slow) > ms(fast));
        }
        assert_eq!(measure(&[Visibility::Trace], |_| Err("broken")).unwrap_err(), "broken");
    }
}
