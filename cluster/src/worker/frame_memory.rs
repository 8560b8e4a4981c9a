//! Memory for frames: a place is taken by bytes before a view is rendered and given back when its frame is sent.
//!
//! Numbers of views bound no memory, since one may have a thousand times the pixels of another. Whoever finds no room waits
//! for it, within its deadline, in the order in which they came: turned away it would only come again, from a coordinator
//! that may have nobody else. Clients that fetch frames themselves have half of the room and are turned away beyond it, as
//! beyond their places: they may take their time to read, and have the coordinator to turn to.

use std::sync::Arc;

use argus_proto::Fault;
use argus_scene::{Output, ViewJob};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};

use super::config::RETRY;

/// What is counted: a semaphore counts no further than 2³² at once.
const UNIT: u64 = 1 << 10;

/// Room for frames, in all.
pub(super) struct Rooms {
    all: Arc<Semaphore>,
    of_clients: Arc<Semaphore>,
    units: u32,
}

/// Room that is taken.
pub(super) struct Room {
    all: OwnedSemaphorePermit,
    /// Of what clients may have.
    of_clients: Option<OwnedSemaphorePermit>,
}

/// What making a frame takes: its images twice, as they are rendered and as they are packed, which may gain nothing.
pub(super) fn bytes_of(job: &ViewJob) -> u64 {
    let pixel: usize = Output::ALL.iter().filter(|o| job.outputs.has(**o)).map(|o| o.pixel_bytes()).sum();
    u64::from(job.width) * u64::from(job.height) * pixel as u64 * 2
}

fn units(bytes: u64) -> u32 {
    u32::try_from(bytes.div_ceil(UNIT)).unwrap_or(u32::MAX)
}

impl Rooms {
    pub(super) fn new(bytes: u64) -> Self {
        let units = units(bytes).max(2);
        let semaphore = |units: u32| Arc::new(Semaphore::new((units as usize).min(Semaphore::MAX_PERMITS)));
        Self { all: semaphore(units), of_clients: semaphore(units / 2), units }
    }

    /// Bytes that are taken.
    pub(super) fn taken(&self) -> u64 {
        (self.units as usize).saturating_sub(self.all.available_permits()) as u64 * UNIT
    }

    /// Waits for so much room; what is larger than all of it has it alone. `for_client`: a client will read the frame.
    ///
    /// # Errors
    /// [`Fault::Overloaded`] if clients have all of theirs.
    pub(super) async fn take(&self, bytes: u64, for_client: bool) -> Result<Room, Fault> {
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
        Ok(Room { all, of_clients })
    }
}

impl Room {
    /// Gives back all but so much.
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
    async fn who_finds_no_room_waits_for_it_and_what_is_packed_takes_less() {
        let rooms = Rooms::new(10 * MIB);
        let mut first = rooms.take(8 * MIB, false).await.unwrap();
        assert!(rooms.take(4 * MIB, false).now_or_never().is_none());
        first.keep(6 * MIB);
        assert_eq!(rooms.taken(), 6 * MIB);
        let second = rooms.take(4 * MIB, false).now_or_never().unwrap().unwrap();
        drop((first, second));
        assert_eq!(rooms.taken(), 0);
        let _alone = rooms.take(1000 * MIB, false).now_or_never().unwrap().unwrap();
        assert_eq!(rooms.taken(), 10 * MIB, "what fits nowhere has all of it");
    }

    #[tokio::test]
    async fn clients_that_fetch_frames_leave_half_of_the_room() {
        let rooms = Rooms::new(10 * MIB);
        let client = rooms.take(4 * MIB, true).await.unwrap();
        assert!(matches!(rooms.take(4 * MIB, true).await, Err(Fault::Overloaded { .. })));
        let _ordered = rooms.take(6 * MIB, false).now_or_never().unwrap().unwrap();
        drop(client);
        assert!(rooms.take(4 * MIB, true).now_or_never().unwrap().is_ok());
    }
}
