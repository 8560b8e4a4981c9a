//! One client of a load whose views are cameras of a session.

use std::collections::BTreeMap;
use std::time::Duration;

use tokio::time::{Instant, sleep_until};

use super::report::Tally;
use super::{LoadOptions, Schedule};
use crate::{Client, ClientError, SessionEvent, SessionOptions};

/// Moves the camera when it is due and counts the frames that come. The newest camera, when no more follow, is
/// to be answered; that it is not is a failure, while those that newer ones overtook are superseded.
pub(super) async fn run(client: Client, options: LoadOptions, schedule: Schedule, begin: Instant) -> Tally {
    let (encoding, patience, history) = (options.encoding, options.deadline, options.history);
    let open = || client.session(SessionOptions { encoding, patience, history, ..SessionOptions::default() });
    let mut session = open();
    let mut tally = Tally::new();
    // When each camera that may still be answered was due.
    let mut unanswered: BTreeMap<u64, Duration> = BTreeMap::new();
    let mut schedule = schedule.due().peekable();
    let mut end = begin + options.deadline;
    loop {
        let next_due = schedule.peek().map(|(due, _)| begin + *due);
        let idle = session.is_idle();
        if next_due.is_none() && idle {
            break;
        }
        tokio::select! {
            // A camera that is due goes first: the schedule does not wait for frames.
            biased;
            () = sleep_until(next_due.unwrap_or(end)) => {
                let Some((due, view)) = schedule.next() else {
                    let last = "the session's newest camera was not answered".to_owned();
                    tally.fail(&ClientError::Deadline { after: options.deadline, last });
                    // Of what is open, the newest has just been counted.
                    unanswered.pop_last();
                    break;
                };
                unanswered.insert(session.send(&view), due);
                tally.sent += 1;
                end = begin + due + options.deadline;
            }
            event = session.next(), if !idle => match event {
                Ok(SessionEvent::Frame { camera_seq, frame, .. }) => {
                    settle(&mut tally, &mut unanswered, camera_seq, |tally, due| {
                        tally.answer(due, begin.elapsed());
                        tally.from_history += u64::from(frame.provenance.history);
                    });
                }
                Ok(SessionEvent::Failed { camera_seq, error }) => {
                    settle(&mut tally, &mut unanswered, camera_seq, |tally, _| tally.fail(&error));
                }
                Err(error) => {
                    // The newest camera is lost with the session; the next one begins another.
                    if unanswered.pop_last().is_some() {
                        tally.fail(&error);
                    }
                    tally.superseded += unanswered.len() as u64;
                    unanswered.clear();
                    session = open();
                }
            },
        }
    }
    tally.superseded += unanswered.len() as u64;
    tally
}

/// Counts the answer to a camera; those before it are superseded.
fn settle(
    tally: &mut Tally,
    open: &mut BTreeMap<u64, Duration>,
    camera_seq: u64,
    count: impl FnOnce(&mut Tally, Duration),
) {
    let newer = open.split_off(&(camera_seq + 1));
    let mut settled = std::mem::replace(open, newer);
    if let Some(due) = settled.remove(&camera_seq) {
        count(tally, due);
    }
    tally.superseded += settled.len() as u64;
}
