//! Messages to simulated workers, and tasks on their machines.

use argus_cluster::core::{Assignment, Order, ViewId};
use argus_scene::SampleId;

/// One attempt at a view.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Attempt {
    pub(super) view_id: ViewId,
    pub(super) attempt: u32,
}

/// A message to a worker.
#[derive(Debug, Clone)]
pub(super) enum Message {
    Order(ViewId, Box<Order>),
    Assignment(Assignment),
    Subscribe { id: SampleId, from: usize, prefetch: bool },
    Sample { id: SampleId },
    NoSample { id: SampleId, from: usize },
}

/// A task on a machine's cores.
#[derive(Debug, Clone, Copy)]
pub(super) enum Task {
    Render { slot: usize, life: u32 },
    Encode { slot: usize, life: u32, view: Attempt },
    Pack { slot: usize, life: u32, id: SampleId },
    Unpack { slot: usize, life: u32, id: SampleId },
    Relay { view: Attempt },
    Receive { view_id: ViewId },
}
