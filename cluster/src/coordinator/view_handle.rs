//! A view that the core was asked for, as the one who asked holds it.

use std::sync::Arc;
use std::time::Duration;

use argus_proto::{Fault, v1};
use argus_scene::View;
use futures::FutureExt;
use tokio::sync::mpsc::UnboundedReceiver;

use super::shared_core::{SharedCore, Instruction, CoreReply};
use crate::core::{Client, Event, Failure, LastView, Order, ViewId};
use crate::wire;

/// A view that was asked for. It is the core's until [`ViewHandle::answered`], [`ViewHandle::failed`] for good, or
/// [`ViewHandle::cancelled`].
pub(super) struct ViewHandle {
    shared: Arc<SharedCore>,
    view_id: ViewId,
    replies: UnboundedReceiver<CoreReply>,
}

impl ViewHandle {
    /// Asks the core for a view; of a session, with what it remembers of its last one.
    pub(super) fn new(
        shared: &Arc<SharedCore>,
        client: Client,
        view: View,
        deadline: Option<Duration>,
        last: Option<Box<LastView>>,
    ) -> Self {
        let (view_id, replies) = shared.begin_view(client, view, deadline, last);
        Self { shared: shared.clone(), view_id, replies }
    }

    /// The next reply.
    pub(super) async fn next_reply(&mut self) -> CoreReply {
        let gone = || Fault::Unavailable("the coordinator is shutting down".to_owned());
        self.replies.recv().await.unwrap_or_else(|| Err(gone()))
    }

    /// The newest order that is here already.
    pub(super) fn newest(&mut self) -> Option<Box<Order>> {
        let mut newest = None;
        while let Some(Ok(instruction)) = self.next_reply().now_or_never() {
            if let Instruction::Dispatch(order) = instruction {
                newest = Some(order);
            }
        }
        newest
    }

    /// The frame of that attempt begins to arrive, and is to be judged: a reply follows.
    pub(super) fn judge(&self, attempt: u32, observed: Option<v1::Observed>, ms: f64) {
        let observed = observed.map(wire::observed_from);
        self.shared.step(Event::Judged { view_id: self.view_id, attempt, observed, ms });
    }

    /// The client has the frame of that attempt; `uncovered` of its pixels no sample saw. Rendering took `ms`, if that was
    /// not said before.
    pub(super) fn answered(&self, attempt: u32, uncovered: Option<u64>, ms: Option<f64>) {
        self.shared.end_view(self.view_id, Event::Answered { view_id: self.view_id, attempt, uncovered, ms });
    }

    /// That attempt failed; unless that is final, a reply follows.
    pub(super) fn failed(&self, attempt: u32, failure: Failure) {
        let event = Event::Failed { view_id: self.view_id, attempt, failure };
        match failure {
            Failure::Final => self.shared.end_view(self.view_id, event),
            Failure::OfWorker | Failure::TryElsewhere => self.shared.step(event),
        }
    }

    /// Ends the view: its client has its frame, or gave up.
    pub(super) fn cancelled(&self) {
        self.shared.end_view(self.view_id, Event::Cancelled { view_id: self.view_id });
    }
}
