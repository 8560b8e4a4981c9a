//! Memory for frames: bytes are reserved before a view is rendered and given back when its frame is sent.
//!
//! Numbers of views bound no memory, since one may have a thousand times the pixels of another. An order that finds too little
//! memory waits for it, within its deadline, first come, first served: turned away it would only come again, from a
//! coordinator that may have no other worker. Clients that fetch frames themselves may reserve half of the memory. Beyond that
//! they are refused: they may take their time to read, and they can ask the coordinator.

use std::sync::Arc;

use argus_proto::Fault;
use argus_scene::{Output, ViewJob};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};

use super::config::RETRY;

/// What is counted: a semaphore counts no further than 2³² at once.
const UNIT: u64 = 1 << 10;

/// Memory for frames.
pub(super) struct FrameMemory {
    all: Arc<Semaphore>,
    of_clients: Arc<Semaphore>,
    units: u32,
}

/// A reservation. Dropping it gives the memory back.
pub(super) struct FramePermit {
    all: OwnedSemaphorePermit,
    /// Its part of what clients may reserve.
    of_clients: Option<OwnedSemaphorePermit>,
}

/// Bytes that making a frame takes: its images twice, as they are rendered and as they are packed, which may gain nothing.
pub(super) fn bytes_of(job: &ViewJob) -> u64 {
    let pixel: usize = Output::ALL.iter().filter(|o| job.outputs.has(**o)).map(|o| o.pixel_bytes()).sum();
    u64::from(job.width) * u64::from(job.height) * pixel as u64 * 2
}

fn units(bytes: u64) -> u32 {
    u32::try_from(bytes.div_ceil(UNIT)).unwrap_or(u32::MAX)
}

impl FrameMemory {
    pub(super) fn new(bytes: u64) -> Self {
        let units = units(bytes).max(2);
        let semaphore = |units: u32| Arc::new(Semaphore::new((units as usize).min(Semaphore::MAX_PERMITS)));
        Self { all: semaphore(units), of_clients: semaphore(units / 2), units }
    }

    /// Bytes that are reserved.
    pub(super) fn reserved(&self) -> u64 {
        (self.units as usize).saturating_sub(self.all.available_permits()) as u64 * UNIT
    }

    /// Reserves memory once there is enough; a frame that needs more than there is has all of it alone. `for_client`: a client
    /// will read the frame.
    ///
    /// # Errors
    /// [`Fault::Overloaded`] if clients have reserved all that they may.
    pub(super) async fn take(&self, bytes: u64, for_client: bool) -> Result<FramePermit, Fault> {
        let units = units(bytes);
        let of_clients = match for_client {
            false => None,
            true => {
                let taken = self.of_clients.clone().try_acquire_many_owned(units.min(self.units / 2));
                let what =
                    || "the frames that clients fetch here take all the memory that they may".to_owned();
                Some(taken.map_err(|_| Fault::Overloaded { what: what(), retry_after: RETRY })?)
            }
        };
        let all = self.all.clone().acquire_many_owned(units.min(self.units)).await;
        let all = all.map_err(|e| Fault::Unavailable(e.to_string()))?;
        Ok(FramePermit { all, of_clients })
    }
}

impl FramePermit {
    /// Gives back all but this many bytes.
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
    async fn a_frame_without_memory_waits_for_it_and_a_packed_frame_takes_less() {
        let memory = FrameMemory::new(10 * MIB);
        let mut first = memory.take(8 * MIB, false).await.unwrap();
        assert!(memory.take(4 * MIB, false).now_or_never().is_none());
        first.keep(6 * MIB);
        assert_eq!(memory.reserved(), 6 * MIB);
        let second = memory.take(4 * MIB, false).now_or_never().unwrap().unwrap();
        drop((first, second));
        assert_eq!(memory.reserved(), 0);
        let _alone = memory.take(1000 * MIB, false).now_or_never().unwrap().unwrap();
        assert_eq!(memory.reserved(), 10 * MIB, "what fits nowhere has all of it");
    }

    #[tokio::test]
    async fn clients_that_fetch_frames_leave_half_of_the_memory() {
        let memory = FrameMemory::new(10 * MIB);
        let client = memory.take(4 * MIB, true).await.unwrap();
        assert!(matches!(memory.take(4 * MIB, true).await, Err(Fault::Overloaded { .. })));
        let _ordered = memory.take(6 * MIB, false).now_or_never().unwrap().unwrap();
        drop(client);
        assert!(memory.take(4 * MIB, true).now_or_never().unwrap().is_ok());
    }
}
