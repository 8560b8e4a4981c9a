//! Memory for frames: bytes are reserved before a view is rendered, and released when its frame is sent.
//!
//! A number of views bounds no memory, since one view may have a thousand times the pixels of another. An order that
//! finds too little memory waits for it, within its deadline, in order of arrival. If it were refused it would
//! return, from a coordinator that may have no other worker. Redirected clients may reserve half of the memory and
//! are refused beyond that: they may read slowly, and they can ask the coordinator.

use std::sync::Arc;

use argus_proto::Fault;
use argus_scene::{Output, Outputs, ViewJob};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};

use super::config::RETRY;

/// Bytes per permit. A semaphore cannot count all bytes: it is limited to 2³² permits at once.
const UNIT: u64 = 1 << 10;

/// Memory for frames.
pub(super) struct FrameMemory {
    all: Arc<Semaphore>,
    of_clients: Arc<Semaphore>,
    units: u32,
}

/// A reservation. Dropping it releases the memory.
pub(super) struct FramePermit {
    all: OwnedSemaphorePermit,
    /// The client's share, if a client reads the frame.
    of_clients: Option<OwnedSemaphorePermit>,
}

/// Bytes that rendering a frame of a job with these outputs needs: twice its images, as rendered and as packed, since packing may save nothing.
pub(super) fn bytes_of(job: &ViewJob, outputs: Outputs) -> u64 {
    let pixel: usize = job.outputs.union(outputs).iter().map(Output::pixel_bytes).sum();
    u64::from(job.width) * u64::from(job.height) * pixel as u64 * 2
}

fn units(bytes: u64) -> u32 {
    u32::try_from(bytes.div_ceil(UNIT)).unwrap_or(u32::MAX)
}

impl FrameMemory {
    /// Memory of `bytes`, half of which redirected clients may reserve.
    pub(super) fn new(bytes: u64) -> Self {
        let units = units(bytes).max(2);
        let semaphore = |units: u32| Arc::new(Semaphore::new((units as usize).min(Semaphore::MAX_PERMITS)));
        Self { all: semaphore(units), of_clients: semaphore(units / 2), units }
    }

    /// Reserved bytes.
    pub(super) fn reserved(&self) -> u64 {
        (self.units as usize).saturating_sub(self.all.available_permits()) as u64 * UNIT
    }

    /// Reserves memory, and waits until there is enough. A frame that needs more than all memory gets all of it.
    /// `for_client` marks a frame that a redirected client reads.
    ///
    /// # Errors
    /// [`Fault::Overloaded`] if clients have reserved all of their share.
    pub(super) async fn take(&self, bytes: u64, for_client: bool) -> Result<FramePermit, Fault> {
        let units = units(bytes);
        let of_clients = match for_client {
            false => None,
            true => {
                let taken = self.of_clients.clone().try_acquire_many_owned(units.min(self.units / 2));
                let what = || {
                    "the frames of redirected clients fill their share of the memory (worker.frames_mib)"
                        .to_owned()
                };
                Some(taken.map_err(|_| Fault::Overloaded { what: what(), retry_after: RETRY })?)
            }
        };
        let all = self.all.clone().acquire_many_owned(units.min(self.units)).await;
        let all = all.map_err(|e| Fault::Unavailable(e.to_string()))?;
        Ok(FramePermit { all, of_clients })
    }
}

impl FramePermit {
    /// Releases all but this many bytes.
    pub(super) fn keep(&mut self, bytes: u64) {
        for permit in std::iter::once(&mut self.all).chain(&mut self.of_clients) {
            let surplus = permit.num_permits().saturating_sub(units(bytes) as usize);
            drop(permit.split(surplus));
        }
    }
}

#[cfg(test)]
mod tests {
    use futures::FutureExt;

    use super::*;

    const MIB: u64 = 1 << 20;

    #[tokio::test]
    async fn a_frame_waits_for_memory_and_a_packed_frame_needs_less() {
        let memory = FrameMemory::new(10 * MIB);
        let mut first = memory.take(8 * MIB, false).await.unwrap();
        assert!(memory.take(4 * MIB, false).now_or_never().is_none());
        first.keep(6 * MIB);
        assert_eq!(memory.reserved(), 6 * MIB);
        let second = memory.take(4 * MIB, false).now_or_never().unwrap().unwrap();
        drop((first, second));
        assert_eq!(memory.reserved(), 0);
        let _alone = memory.take(1000 * MIB, false).now_or_never().unwrap().unwrap();
        assert_eq!(memory.reserved(), 10 * MIB, "a frame larger than the memory reserves all of it");
    }

    #[tokio::test]
    async fn redirected_clients_reserve_at_most_half_of_the_memory() {
        let memory = FrameMemory::new(10 * MIB);
        let client = memory.take(4 * MIB, true).await.unwrap();
        assert!(matches!(memory.take(4 * MIB, true).await, Err(Fault::Overloaded { .. })));
        let _ordered = memory.take(6 * MIB, false).now_or_never().unwrap().unwrap();
        drop(client);
        assert!(memory.take(4 * MIB, true).now_or_never().unwrap().is_ok());
    }
}
