//! A handle of one view that the core has.

use std::sync::Arc;
use std::time::Duration;

use argus_proto::{Fault, v1};
use argus_scene::View;
use futures::FutureExt;
use tokio::sync::mpsc::UnboundedReceiver;

use super::shared_core::{CoreReply, Instruction, SharedCore};
use crate::core::{Client, Event, Failure, LastView, Order, ViewId};
use crate::wire;

/// A view that the core has. It ends with [`ViewHandle::answered`], a final [`ViewHandle::failed`], or
/// [`ViewHandle::cancelled`].
pub(super) struct ViewHandle {
    shared: Arc<SharedCore>,
    view_id: ViewId,
    replies: UnboundedReceiver<CoreReply>,
}

impl ViewHandle {
    /// Submits a view to the core. `last` is what the session remembers of its last view.
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

    /// Waits for the core's next reply about this view.
    pub(super) async fn next_reply(&mut self) -> CoreReply {
        let gone = || Fault::Unavailable("the coordinator is shutting down".to_owned());
        self.replies.recv().await.unwrap_or_else(|| Err(gone()))
    }

    /// The newest order that has already arrived.
    pub(super) fn newest(&mut self) -> Option<Box<Order>> {
        let mut newest = None;
        while let Some(Ok(instruction)) = self.next_reply().now_or_never() {
            if let Instruction::Dispatch(order) = instruction {
                newest = Some(order);
            }
        }
        newest
    }

    /// Lets the core judge the frame of an attempt, whose header has arrived. A reply follows.
    pub(super) fn judge(&self, attempt: u32, observed: Option<v1::Observed>, ms: f64) {
        let observed = observed.map(wire::observed_from);
        self.shared.step(Event::Judged { view_id: self.view_id, attempt, observed, ms });
    }

    /// Tells the core that the client has the frame of an attempt. `uncovered` counts the pixels that no sample saw.
    /// `ms` is the rendering time, unless it was already reported. `fell_short`: the frame by the plan was not good enough.
    pub(super) fn answered(&self, attempt: u32, uncovered: Option<u64>, ms: Option<f64>, fell_short: bool) {
        let view_id = self.view_id;
        self.shared.end_view(view_id, Event::Answered { view_id, attempt, uncovered, ms, fell_short });
    }

    /// Tells the core that an attempt failed. A reply follows, unless the failure is final.
    pub(super) fn failed(&self, attempt: u32, failure: Failure) {
        let event = Event::Failed { view_id: self.view_id, attempt, failure };
        match failure {
            Failure::Final => self.shared.end_view(self.view_id, event),
            Failure::OfWorker | Failure::TryElsewhere => self.shared.step(event),
        }
    }

    /// Cancels the view at the core.
    pub(super) fn cancelled(&self) {
        self.shared.end_view(self.view_id, Event::Cancelled { view_id: self.view_id });
    }
}
