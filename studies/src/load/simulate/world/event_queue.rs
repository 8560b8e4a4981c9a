//! The queue of future events.

use argus_cluster::core::{Event, ViewId};
use argus_scene::SampleId;

use crate::load::simulate::Nanos;
use crate::load::simulate::work::{Attempt, Message};

/// The kinds of event.
pub(super) enum SimEvent {
    HostDone { host: usize, version: u64 },
    ToWorker { slot: usize, life: u32, message: Message },
    ToCoordinator(Box<Event>),
    FrameAtCoordinator { view: Attempt },
    FrameAtClient { view_id: ViewId },
    Report { slot: usize, life: u32 },
    Announced { slot: usize, life: u32, id: SampleId },
    AskAgain { slot: usize, life: u32, id: SampleId },
    Rejoin { slot: usize, life: u32 },
    CoreTick,
    Wake { tag: u64 },
}

/// An event and its time. The earliest comes first, and events of the same time keep their order.
pub(super) struct Due {
    pub(super) at: Nanos,
    pub(super) number: u64,
    pub(super) event: SimEvent,
}

impl PartialEq for Due {
    fn eq(&self, other: &Self) -> bool {
        (self.at, self.number) == (other.at, other.number)
    }
}
impl Eq for Due {}
impl PartialOrd for Due {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}
impl Ord for Due {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        (self.at, self.number).cmp(&(other.at, other.number))
    }
}
