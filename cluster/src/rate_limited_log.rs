//! Rate-limited log lines for events that may happen with every request: the first at once, then at most one in ten
//! seconds, with the number of omitted ones.

use std::time::Duration;

use parking_lot::Mutex;
use tokio::time::Instant;

/// Least time between two lines.
const PAUSE: Duration = Duration::from_secs(10);

/// The rate limit of one kind of line.
#[derive(Debug)]
pub(crate) struct RateLimitedLog(Mutex<State>);

#[derive(Debug)]
struct State {
    said: Option<Instant>,
    left_out: u64,
}

impl RateLimitedLog {
    pub(crate) const fn new() -> Self {
        Self(Mutex::new(State { said: None, left_out: 0 }))
    }

    /// Whether to log now: `Some` with the number of lines omitted before; `None` to omit this one.
    pub(crate) fn now(&self) -> Option<u64> {
        let now = Instant::now();
        let mut state = self.0.lock();
        if state.said.is_some_and(|said| now < said + PAUSE) {
            state.left_out += 1;
            return None;
        }
        state.said = Some(now);
        Some(std::mem::take(&mut state.left_out))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test(start_paused = true)]
    async fn the_first_line_is_logged_at_once_and_the_next_counts_omitted_ones() {
        let line = RateLimitedLog::new();
        assert_eq!(line.now(), Some(0));
        assert!((0..1000).all(|_| line.now().is_none()));
        tokio::time::advance(PAUSE).await;
        assert_eq!(line.now(), Some(1000));
        assert_eq!(line.now(), None);
        tokio::time::advance(PAUSE).await;
        assert_eq!(line.now(), Some(1));
    }
}
