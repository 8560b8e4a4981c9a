//! Counts and latencies of a load.

use std::time::Duration;

use hdrhistogram::Histogram;
use serde::{Deserialize, Serialize};

use crate::ClientError;

/// Latencies in milliseconds of answered views, from when each was due; 0 if none was answered.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct LatencyMs {
    /// Median.
    pub p50: f64,
    /// 90th percentile.
    pub p90: f64,
    /// 99th percentile.
    pub p99: f64,
    /// Maximum.
    pub max: f64,
}

/// The outcome of a load. `sent` = `answered` + `failed` + `rejected` + `superseded`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LoadReport {
    /// Views that fell due.
    pub sent: u64,
    /// Views whose frame arrived whole within its deadline.
    pub answered: u64,
    /// Views that ended in an error or without an answer.
    pub failed: u64,
    /// Views rejected because of overload.
    pub rejected: u64,
    /// Session cameras superseded by a newer one.
    pub superseded: u64,
    /// Answered views whose search started from the previous frame (reprojection).
    pub from_history: u64,
    /// Answered views per second from the first view to the last answer, over at least the load's duration.
    pub views_per_sec: f64,
    /// Latency from when a view was due.
    pub latency_ms: LatencyMs,
    /// The first failure's message.
    pub first_error: Option<String>,
}

/// Latency histogram with three significant digits, from a microsecond to ten minutes; longer ones count as ten minutes.
#[derive(Debug)]
pub(super) struct Latencies(Histogram<u64>);

impl Latencies {
    pub(super) fn new() -> Self {
        let histogram = Histogram::new_with_bounds(1, 600_000_000, 3);
        Self(histogram.expect("constant bounds are valid"))
    }

    pub(super) fn record(&mut self, latency: Duration) {
        self.0.saturating_record(u64::try_from(latency.as_micros()).unwrap_or(u64::MAX));
    }

    pub(super) fn ms(&self) -> LatencyMs {
        if self.0.is_empty() {
            return LatencyMs::default();
        }
        let at = |quantile| self.0.value_at_quantile(quantile) as f64 / 1e3;
        LatencyMs { p50: at(0.5), p90: at(0.9), p99: at(0.99), max: self.0.max() as f64 / 1e3 }
    }
}

/// Counts of one or several clients.
#[derive(Debug)]
pub(super) struct Tally {
    pub(super) sent: u64,
    pub(super) superseded: u64,
    pub(super) from_history: u64,
    answered: u64,
    failed: u64,
    rejected: u64,
    latencies: Latencies,
    /// Time of the last answer since the load's start.
    last_answer: Duration,
    first_error: Option<String>,
}

impl Tally {
    pub(super) fn new() -> Self {
        Self {
            sent: 0,
            superseded: 0,
            from_history: 0,
            answered: 0,
            failed: 0,
            rejected: 0,
            latencies: Latencies::new(),
            last_answer: Duration::ZERO,
            first_error: None,
        }
    }

    /// Counts a frame that was due at `due` and arrived at `now`, both since the start.
    pub(super) fn answer(&mut self, due: Duration, now: Duration) {
        self.answered += 1;
        self.latencies.record(now.saturating_sub(due));
        self.last_answer = self.last_answer.max(now);
    }

    /// Counts a view that will not be answered.
    pub(super) fn fail(&mut self, error: &ClientError) {
        match error {
            ClientError::Overloaded { .. } => self.rejected += 1,
            _ => self.failed += 1,
        }
        self.first_error.get_or_insert_with(|| error.to_string());
    }

    pub(super) fn merge(&mut self, other: &Self) {
        self.sent += other.sent;
        self.superseded += other.superseded;
        self.from_history += other.from_history;
        self.answered += other.answered;
        self.failed += other.failed;
        self.rejected += other.rejected;
        self.last_answer = self.last_answer.max(other.last_answer);
        self.latencies.0 += &other.latencies.0;
        if self.first_error.is_none() {
            self.first_error.clone_from(&other.first_error);
        }
    }

    pub(super) fn report(self, duration: Duration) -> LoadReport {
        let elapsed = self.last_answer.max(duration).as_secs_f64();
        LoadReport {
            sent: self.sent,
            answered: self.answered,
            failed: self.failed,
            rejected: self.rejected,
            superseded: self.superseded,
            from_history: self.from_history,
            views_per_sec: if elapsed > 0.0 { self.answered as f64 / elapsed } else { 0.0 },
            latency_ms: self.latencies.ms(),
            first_error: self.first_error,
        }
    }
}
