//! Limits of clients, for each and for all: views in flight, open sessions, pixels per second.
//!
//! Pixels are limited by token buckets of one second's capacity. A view is admitted while the bucket is not empty,
//! and may overdraw it. So views larger than the bucket pass, and the long-term rate is exact. The available library
//! counts in 32 bits and reads a clock; this is (state, now) → state.

use std::collections::BTreeMap;
use std::time::Duration;

use argus_proto::Fault;

use crate::core::config::Config;
use crate::core::event::Client;
use crate::core::time::Uptime;

/// Shortest and longest hint when to retry: sooner only causes more requests, later is a guess.
const RETRY: [Duration; 2] = [Duration::from_millis(50), Duration::from_secs(5)];

/// A token bucket of pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Bucket {
    per_sec: f64,
    /// Pixels in the bucket; negative if overdrawn.
    level: f64,
    at: Uptime,
}

impl Bucket {
    /// A full bucket.
    fn new(per_sec: f64, now: Uptime) -> Self {
        Self { per_sec, level: per_sec, at: now }
    }

    /// Its level at `now`.
    fn level(&self, now: Uptime) -> f64 {
        (self.level + self.per_sec * now.since(self.at).as_secs_f64()).min(self.per_sec)
    }

    /// Time until it is no longer empty; `None` if it is not empty.
    fn empty_for(&self, now: Uptime) -> Option<Duration> {
        let level = self.level(now);
        // A NaN, from a rate of zero, waits.
        if level > 0.0 { None } else { Some(secs((1.0 - level) / self.per_sec)) }
    }

    fn take(&mut self, pixels: f64, now: Uptime) {
        (self.level, self.at) = (self.level(now) - pixels, now);
    }
}

fn secs(secs: f64) -> Duration {
    Duration::try_from_secs_f64(secs).unwrap_or(RETRY[1])
}

/// Usage of one client.
#[derive(Debug, Clone, Default)]
struct Usage {
    views: usize,
    sessions: usize,
    bucket: Option<Bucket>,
}

/// Usage of all clients. Clients without usage are forgotten.
#[derive(Debug, Clone, Default)]
pub(super) struct Admission {
    clients: BTreeMap<Client, Usage>,
    sessions: usize,
    bucket: Option<Bucket>,
}

impl Admission {
    /// Checks whether a client may have one more view. `retry_after` is when views in flight leave room.
    ///
    /// # Errors
    /// [`Fault::Overloaded`] beyond a limit.
    pub(super) fn check(
        &self,
        client: &str,
        config: &Config,
        retry_after: Duration,
        now: Uptime,
    ) -> Result<(), Fault> {
        let usage = self.clients.get(client);
        let views = usage.map_or(0, |usage| usage.views);
        if views >= config.max_views_per_client {
            return overloaded(format!("{views} views of {client} are waiting or in work"), retry_after);
        }
        let own = format!("{client} asks");
        let buckets =
            [("all clients ask", self.bucket), (own.as_str(), usage.and_then(|usage| usage.bucket))];
        let empty = buckets.into_iter().filter_map(|(who, bucket)| {
            let bucket = bucket?;
            Some((bucket.empty_for(now)?, who, bucket.per_sec))
        });
        // The hint is the longer of the two waits, since both buckets must be filled.
        match empty.max_by_key(|(wait, ..)| *wait) {
            Some((wait, who, per_sec)) => {
                overloaded(format!("{who} for more than {per_sec} pixels a second"), wait)
            }
            None => Ok(()),
        }
    }

    /// Counts an admitted view.
    pub(super) fn enter(&mut self, client: &Client, pixels: u64, config: &Config, now: Uptime) {
        let pixels = pixels as f64;
        let pay = |bucket: &mut Option<Bucket>, per_sec: Option<f64>| {
            if let Some(per_sec) = per_sec {
                bucket.get_or_insert_with(|| Bucket::new(per_sec, now)).take(pixels, now);
            }
        };
        pay(&mut self.bucket, config.pixels_per_sec);
        let usage = self.clients.entry(client.clone()).or_default();
        usage.views += 1;
        pay(&mut usage.bucket, config.pixels_per_sec_per_client);
    }

    /// Uncounts a view that ended.
    pub(super) fn leave(&mut self, client: &str) {
        if let Some(usage) = self.clients.get_mut(client) {
            usage.views = usage.views.saturating_sub(1);
        }
    }

    /// Checks whether a client may open a session.
    ///
    /// # Errors
    /// [`Fault::Overloaded`].
    pub(super) fn check_session(&self, client: &str, config: &Config) -> Result<(), Fault> {
        let own = self.clients.get(client).map_or(0, |usage| usage.sessions);
        // When a session will end is unknown.
        let retry_after = RETRY[1];
        if self.sessions >= config.max_sessions {
            return overloaded(format!("{} sessions are open", self.sessions), retry_after);
        }
        if own >= config.max_sessions_per_client {
            return overloaded(format!("{own} sessions of {client} are open"), retry_after);
        }
        Ok(())
    }

    pub(super) fn open_session(&mut self, client: &Client) {
        self.sessions += 1;
        self.clients.entry(client.clone()).or_default().sessions += 1;
    }

    pub(super) fn close_session(&mut self, client: &str) {
        self.sessions = self.sessions.saturating_sub(1);
        if let Some(usage) = self.clients.get_mut(client) {
            usage.sessions = usage.sessions.saturating_sub(1);
        }
    }

    pub(super) fn sessions(&self) -> usize {
        self.sessions
    }

    /// Forgets clients without usage and debt, so that memory is bounded by the active clients.
    pub(super) fn prune(&mut self, now: Uptime) {
        let is_full = |bucket: &Bucket| bucket.level(now) >= bucket.per_sec;
        self.clients.retain(|_, usage| {
            usage.views > 0 || usage.sessions > 0 || !usage.bucket.as_ref().is_none_or(is_full)
        });
    }

    #[cfg(test)]
    pub(super) fn clients(&self) -> usize {
        self.clients.len()
    }
}

fn overloaded(what: String, retry_after: Duration) -> Result<(), Fault> {
    Err(Fault::Overloaded { what, retry_after: retry_after.clamp(RETRY[0], RETRY[1]) })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn at(secs: f64) -> Uptime {
        Uptime(Duration::from_secs_f64(secs))
    }

    fn config() -> Config {
        Config {
            max_views_per_client: 2,
            max_sessions: 3,
            max_sessions_per_client: 2,
            pixels_per_sec: Some(1000.0),
            pixels_per_sec_per_client: Some(600.0),
            ..Config::default()
        }
    }

    fn asks(admission: &mut Admission, who: &str, pixels: u64, now: Uptime) -> Result<(), Duration> {
        let config = config();
        match admission.check(who, &config, Duration::ZERO, now) {
            Ok(()) => {
                admission.enter(&who.into(), pixels, &config, now);
                admission.leave(who);
                Ok(())
            }
            Err(Fault::Overloaded { retry_after, .. }) => Err(retry_after),
            Err(other) => panic!("{other}"),
        }
    }

    #[test]
    fn clients_have_limits_of_their_own_and_a_common_one() {
        let mut all = Admission::default();
        assert_eq!(asks(&mut all, "a", 600, at(0.0)), Ok(()));
        assert!(asks(&mut all, "a", 1, at(0.0)).is_err());
        assert_eq!(asks(&mut all, "b", 400, at(0.0)), Ok(()));
        assert!(asks(&mut all, "c", 1, at(0.0)).is_err(), "1000 pixels were asked for in all");
        assert_eq!(asks(&mut all, "c", 1, at(0.1)), Ok(()));
    }

    #[test]
    fn a_view_larger_than_the_bucket_is_paid_back() {
        let mut all = Admission::default();
        assert_eq!(asks(&mut all, "a", 3000, at(0.0)), Ok(()));
        // The client is overdrawn by 2400 pixels. The hint is the longest one, and sufficient.
        let hint = asks(&mut all, "a", 1, at(0.0)).unwrap_err();
        assert!(hint > Duration::from_secs(4) && hint <= RETRY[1], "{hint:?}");
        assert!(asks(&mut all, "a", 1, at(hint.as_secs_f64() - 0.1)).is_err());
        assert_eq!(asks(&mut all, "a", 1, at(hint.as_secs_f64())), Ok(()));
    }

    #[test]
    fn views_in_flight_and_sessions_are_limited_separately() {
        let (mut all, config) = (Admission::default(), Config { pixels_per_sec: None, ..config() });
        let a: Client = "a".into();
        let check = |all: &Admission, who| all.check(who, &config, Duration::ZERO, at(0.0));
        for _ in 0..2 {
            check(&all, "a").unwrap();
            all.enter(&a, 0, &config, at(0.0));
        }
        assert!(check(&all, "a").is_err() && check(&all, "b").is_ok());
        all.leave("a");
        assert!(check(&all, "a").is_ok());
        for who in ["a", "a", "b"] {
            all.check_session(who, &config).unwrap();
            all.open_session(&who.into());
        }
        let full = all.check_session("c", &config).unwrap_err();
        assert!(full.to_string().contains("3 sessions"), "{full}");
        all.close_session("b");
        let own = all.check_session("a", &config).unwrap_err();
        assert!(own.to_string().contains("2 sessions of a"), "{own}");
        assert!(all.check_session("c", &config).is_ok());
    }

    #[test]
    fn an_idle_client_is_forgotten_once_its_bucket_is_full() {
        let mut all = Admission::default();
        assert_eq!(asks(&mut all, "a", 600, at(0.0)), Ok(()));
        all.prune(at(0.5));
        assert_eq!(all.clients(), 1);
        all.prune(at(1.0));
        assert_eq!(all.clients(), 0);
    }

    proptest! {
        /// In any time a client gets at most its rate, one second's capacity, and one view more.
        #[test]
        fn no_pattern_of_requests_exceeds_the_rate(
            asked in proptest::collection::vec((0_u64..900, 0.0_f64..0.7), 1..200)
        ) {
            let (mut all, mut now, mut got, mut largest) = (Admission::default(), 0.0, 0, 0);
            for (pixels, pause) in asked {
                now += pause;
                if asks(&mut all, "a", pixels, at(now)).is_ok() {
                    got += pixels;
                    largest = largest.max(pixels);
                }
            }
            prop_assert!(got as f64 <= 600.0 * (now + 1.0) + largest as f64 + 1.0);
        }
    }
}
