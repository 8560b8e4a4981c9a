//! A view that a client wants, and the request that its worker gets.

use std::time::Duration;

use argus_proto::v1;
use argus_scene::View;
use tokio::time::Instant;
use tracing::Span;

use crate::core::{Client, Order};
use crate::wire;

/// A view that is asked for.
pub(super) struct ViewRequest {
    /// Who asks.
    pub(super) client: Client,
    /// Checked.
    pub(super) view: View,
    /// As it came, to be sent on.
    pub(super) wire: v1::View,
    pub(super) view_id: String,
    pub(super) deadline: Option<Duration>,
    pub(super) encoding: i32,
    /// Under which name its worker keeps what it leaves for its session's next frame; empty: it does not.
    pub(super) history: String,
    /// When its request arrived.
    pub(super) arrived: Instant,
    /// Its way through this process.
    pub(super) span: Span,
}

impl ViewRequest {
    /// Milliseconds since its request arrived.
    pub(super) fn age_ms(&self) -> f64 {
        self.arrived.elapsed().as_secs_f64() * 1e3
    }

    /// An order as its worker gets it, from the coordinator of that term.
    pub(super) fn for_worker(&self, term: u64, order: &Order) -> v1::RenderRequest {
        let age = self.arrived.elapsed();
        let left = self.deadline.map_or(0, |deadline| {
            // 0 would mean: no deadline.
            u32::try_from(deadline.saturating_sub(age).as_millis()).unwrap_or(u32::MAX).max(1)
        });
        v1::RenderRequest {
            view_id: self.view_id.clone(),
            view: Some(self.wire.clone()),
            deadline_ms: left,
            encoding: self.encoding,
            order: Some(v1::ViewOrder {
                term,
                state: Some(order.state.into()),
                plan: Some((&order.plan).into()),
                sources: wire::sources(order.sources.clone()),
                age_ms: age.as_secs_f64() * 1e3,
                tracers: order.tracers.clone(),
                observe: order.judged,
                predicted: order.expected.map(Into::into),
                history: self.history.clone(),
                decision: order.decision.map(Into::into),
                fallback_samples_per_pixel: order.fallback.unwrap_or(0),
            }),
        }
    }
}
