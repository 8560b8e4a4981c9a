//! Metrics by client, with a bounded number of labels.
//!
//! A label is the name of a token, which an operator chose, and never what a client sends. The first [`MOST_NAMED`] clients
//! are shown by name, and all others together. A name whose token is gone makes place for another one.

use std::collections::BTreeMap;
use std::fmt;
use std::sync::Arc;

use parking_lot::Mutex;
use tonic::Code;

use crate::observe::Exposition;
use crate::security::ReloadableSecurity;

/// Most clients that are shown by name. Each takes four series.
const MOST_NAMED: usize = 64;

/// The label of all clients that are not shown by name.
const OTHER: &str = "other";

/// What became of one client's views.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
struct Counts {
    answered: u64,
    failed: u64,
    rejected: u64,
    /// Pixels of answered views.
    pixels: u64,
}

impl Counts {
    fn add(&mut self, more: Self) {
        self.answered += more.answered;
        self.failed += more.failed;
        self.rejected += more.rejected;
        self.pixels += more.pixels;
    }
}

/// Metrics by client.
pub(super) struct ClientMetrics {
    /// The tokens, which have the names; `None`: no client has a name.
    security: Option<Arc<ReloadableSecurity>>,
    state: Mutex<State>,
}

#[derive(Default)]
struct State {
    named: BTreeMap<Arc<str>, Counts>,
    other: Counts,
    /// The tokens among which the names were when there was no place for another one.
    full_since: Option<u64>,
}

impl ClientMetrics {
    pub(super) fn new(security: Option<Arc<ReloadableSecurity>>) -> Self {
        Self { security, state: Mutex::default() }
    }

    /// Counts an answered view of a client.
    pub(super) fn answered(&self, client: &Arc<str>, pixels: u64) {
        self.count(client, Counts { answered: 1, pixels, ..Counts::default() });
    }

    /// Counts a view that ended with an error. One that its client cancelled is not counted.
    pub(super) fn ended(&self, client: &Arc<str>, code: Code) {
        match code {
            Code::Cancelled => {}
            Code::ResourceExhausted => self.count(client, Counts { rejected: 1, ..Counts::default() }),
            _ => self.count(client, Counts { failed: 1, ..Counts::default() }),
        }
    }

    fn count(&self, client: &Arc<str>, counts: Counts) {
        let mut state = self.state.lock();
        self.counts(&mut state, client).add(counts);
    }

    /// The counts of a client, under its name if that has a place.
    fn counts<'s>(&self, state: &'s mut State, client: &Arc<str>) -> &'s mut Counts {
        let State { named, other, full_since } = state;
        if named.contains_key(client) {
            return named.entry(client.clone()).or_default();
        }
        let Some(security) = self.security.as_ref().map(|security| security.current()) else { return other };
        if named.len() >= MOST_NAMED && *full_since != Some(security.generation()) {
            *full_since = Some(security.generation());
            named.retain(|name, counts| {
                let stays = security.tokens.has_name(name);
                if !stays {
                    other.add(*counts);
                }
                stays
            });
        }
        match named.len() < MOST_NAMED && **client != *OTHER && security.tokens.has_name(client) {
            true => named.entry(client.clone()).or_default(),
            false => other,
        }
    }

    /// Writes the metrics.
    pub(super) fn expose(&self, to: &mut Exposition<'_>) -> fmt::Result {
        let (named, other) = {
            let state = self.state.lock();
            (state.named.clone(), state.other)
        };
        let rows = || named.iter().map(|(name, counts)| (&**name, counts)).chain([(OTHER, &other)]);
        to.counters(
            "client_views",
            "Views by client and by how they ended. Clients have the names of their tokens; those without a token, and those \
             beyond the first 64 names, are `other`",
            rows().flat_map(|(client, counts)| {
                let Counts { answered, failed, rejected, .. } = *counts;
                [("answered", answered), ("failed", failed), ("rejected", rejected)].map(|(outcome, count)| {
                    ([("client", client), ("outcome", outcome)], count as f64)
                })
            }),
        )?;
        to.counters(
            "client_pixels",
            "Pixels of answered views, by client",
            rows().map(|(client, counts)| ([("client", client)], counts.pixels as f64)),
        )
    }
}

#[cfg(test)]
mod tests {
    use prometheus_client::collector::Collector;
    use prometheus_client::encoding::{DescriptorEncoder, text};
    use prometheus_client::registry::Registry;

    use super::*;
    use crate::security::testing::Authority;
    use crate::security::{Security, Tokens};

    struct Shown(ClientMetrics);

    impl fmt::Debug for Shown {
        fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            f.write_str("Shown")
        }
    }

    impl Collector for Shown {
        fn encode(&self, encoder: DescriptorEncoder<'_>) -> fmt::Result {
            self.0.expose(&mut Exposition::new(encoder))
        }
    }

    fn tokens(names: impl Iterator<Item = usize>) -> Tokens {
        let line = |name| format!("view client-{name} a-token-of-the-tests-{name:06}\n");
        Tokens::parse(&names.map(line).collect::<String>()).unwrap()
    }

    fn name(number: usize) -> Arc<str> {
        format!("client-{number}").into()
    }

    /// The rows of a page with the metrics: the labels, and the value.
    fn page(metrics: ClientMetrics) -> Vec<(String, u64)> {
        let mut registry = Registry::default();
        registry.register_collector(Box::new(Shown(metrics)));
        let mut text = String::new();
        text::encode(&mut text, &registry).unwrap();
        let rows = text.lines().filter(|line| !line.starts_with('#'));
        let row = |line: &str| {
            let (labels, value) = line.rsplit_once(' ').unwrap();
            (labels.to_owned(), value.parse::<f64>().unwrap() as u64)
        };
        rows.map(row).collect()
    }

    #[test]
    fn ten_thousand_clients_have_no_more_than_64_names_and_no_view_is_missing() {
        let security = Security { tokens: tokens(0..10_000), ..Authority::new().member() };
        let metrics = ClientMetrics::new(Some(Arc::new(ReloadableSecurity::new(security).unwrap())));
        for number in 0..10_000 {
            metrics.answered(&name(number), 3);
            metrics.ended(&name(number), Code::ResourceExhausted);
            metrics.ended(&name(number), Code::Internal);
            metrics.ended(&name(number), Code::Cancelled);
            // What a client could choose freely is no name.
            metrics.answered(&format!("10.0.{}.{}", number / 256, number % 256).into(), 1);
        }
        let rows = page(metrics);
        assert_eq!(rows.len(), 4 * (MOST_NAMED + 1), "{rows:?}");
        let sum = |part: &str| {
            rows.iter().filter(|(labels, _)| labels.contains(part)).map(|(_, count)| count).sum::<u64>()
        };
        assert_eq!(sum("answered"), 20_000);
        assert_eq!((sum("rejected"), sum("failed")), (10_000, 10_000));
        assert_eq!(sum("client_pixels"), 40_000);
        assert!(!rows.iter().any(|(labels, _)| labels.contains("10.0.")));
        let of_first = rows.iter().find(|(labels, _)| {
            labels.contains("client=\"client-0\"") && labels.contains("outcome=\"rejected\"")
        });
        assert_eq!(of_first.map(|(_, count)| *count), Some(1), "{rows:?}");
    }

    #[test]
    fn names_of_tokens_that_are_gone_make_place() {
        let member = Authority::new().member();
        let with = |tokens| Security { tokens, ..member.clone() };
        let security = Arc::new(ReloadableSecurity::new(with(tokens(0..100))).unwrap());
        let metrics = ClientMetrics::new(Some(security.clone()));
        for number in 0..100 {
            metrics.answered(&name(number), 1);
        }
        security.replace(with(tokens(60..100))).unwrap();
        for number in 60..100 {
            metrics.answered(&name(number), 1);
        }
        let state = metrics.state.lock();
        assert_eq!(state.named.len(), 40);
        assert_eq!(
            state.named.values().map(|counts| counts.answered).sum::<u64>() + state.other.answered,
            140
        );
    }

    #[test]
    fn without_tokens_all_clients_are_counted_together() {
        let metrics = ClientMetrics::new(None);
        for number in 0..100 {
            metrics.answered(&name(number), 1);
        }
        let rows = page(metrics);
        assert!(
            rows.len() == 4 && rows.iter().all(|(labels, _)| labels.contains("client=\"other\"")),
            "{rows:?}"
        );
    }
}
