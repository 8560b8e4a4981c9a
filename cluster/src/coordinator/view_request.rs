//! A client's request for a view, and the request to its worker.

use std::time::Duration;

use argus_proto::convert::scene_hash_bytes;
use argus_proto::v1;
use argus_scene::{SceneHash, View};
use tokio::time::Instant;
use tracing::Span;

use crate::core::{Client, Order};
use crate::wire;

/// A client's request for a view.
pub(super) struct ViewRequest {
    /// The client's name or address.
    pub(super) client: Client,
    /// The validated view.
    pub(super) view: View,
    /// The view as it arrived, to be forwarded.
    pub(super) wire: v1::View,
    pub(super) view_id: String,
    pub(super) deadline: Option<Duration>,
    pub(super) encoding: i32,
    /// The key of the session's frame histories at workers; empty: no reprojection.
    pub(super) history: String,
    /// Time of arrival.
    pub(super) arrived: Instant,
    /// The tracing span in this process.
    pub(super) span: Span,
}

impl ViewRequest {
    /// Milliseconds since arrival.
    pub(super) fn age_ms(&self) -> f64 {
        self.arrived.elapsed().as_secs_f64() * 1e3
    }

    /// The request that forwards an order to its worker. `term` is the coordinator's, `scene` the one that the view shows.
    pub(super) fn for_worker(&self, term: u64, scene: SceneHash, order: &Order) -> v1::RenderRequest {
        let age = self.arrived.elapsed();
        let left = self.deadline.map_or(0, |deadline| {
            // 0 means no deadline.
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
                fallback: order.fallback.as_ref().map(|fallback| v1::Fallback {
                    plan: Some((&fallback.plan).into()),
                    max_uncovered: fallback.max_uncovered,
                }),
                keeps_frame: order.keeps_frame,
                probe: order.probe.as_ref().map(|plans| v1::Probe {
                    view_id: order.view_id.0,
                    attempt: order.attempt,
                    plans: plans.iter().map(Into::into).collect(),
                }),
                scene_hash: scene_hash_bytes(scene),
            }),
        }
    }
}
