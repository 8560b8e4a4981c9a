//! A load's client that moves the camera of a session.

use std::collections::BTreeMap;
use std::time::Duration;

use argus_scene::{Frame, View};
use tokio::sync::mpsc::UnboundedSender;
use tokio::time::{Instant, sleep_until};

use super::report::Tally;
use super::schedule::{Ended, LoadOptions, Schedule};
use crate::{Client, ClientError, SessionEvent, SessionOptions};

/// Sends each camera when it is due and counts frames. The last camera must be answered, or it has failed. Cameras
/// overtaken by a newer answer are superseded. Each answered or failed view is passed to `report`.
pub(super) async fn run(
    client: Client,
    options: LoadOptions,
    schedule: Schedule,
    begin: Instant,
    report: UnboundedSender<Ended>,
) -> Tally {
    let (encoding, patience, history) = (options.encoding, options.deadline, options.history);
    let open = || client.session(SessionOptions { encoding, patience, history, ..SessionOptions::default() });
    let mut session = open();
    let mut tally = Tally::new();
    let number = schedule.client;
    let end_one = |tally: &mut Tally, asked: SentCamera, outcome: Result<Frame, ClientError>| {
        let SentCamera { index, due, view } = asked;
        let (due, at) = (begin + due, Instant::now());
        match &outcome {
            Ok(frame) => {
                tally.answer(due - begin, at - begin);
                tally.from_history += u64::from(frame.provenance.history);
            }
            Err(error) => tally.fail(error),
        }
        // The receiver may be gone, if the caller dropped the load.
        let _ = report.send(Ended { client: number, index, view, due, at, outcome });
    };
    // Cameras that may still be answered, by their number in the session.
    let mut unanswered: BTreeMap<u64, SentCamera> = BTreeMap::new();
    let mut schedule = (0..).zip(schedule.due()).peekable();
    let mut end = begin + options.deadline;
    loop {
        let next_due = schedule.peek().map(|(_, (due, _))| begin + *due);
        let idle = session.is_idle();
        if next_due.is_none() && idle {
            break;
        }
        tokio::select! {
            // Due cameras first: the schedule does not wait for frames.
            biased;
            () = sleep_until(next_due.unwrap_or(end)) => {
                let Some((index, (due, view))) = schedule.next() else {
                    let last = "the session's newest camera was not answered".to_owned();
                    // The newest open camera has failed.
                    let error = ClientError::Deadline { after: options.deadline, last };
                    match unanswered.pop_last() {
                        Some((_, asked)) => end_one(&mut tally, asked, Err(error)),
                        None => tally.fail(&error),
                    }
                    break;
                };
                unanswered.insert(session.send(&view), SentCamera { index, due, view });
                tally.sent += 1;
                end = begin + due + options.deadline;
            }
            event = session.next(), if !idle => match event {
                Ok(SessionEvent::Frame { camera_seq, frame, .. }) => {
                    if let Some(asked) = settle(&mut tally, &mut unanswered, camera_seq) {
                        end_one(&mut tally, asked, Ok(*frame));
                    }
                }
                Ok(SessionEvent::Failed { camera_seq, error }) => {
                    if let Some(asked) = settle(&mut tally, &mut unanswered, camera_seq) {
                        end_one(&mut tally, asked, Err(error));
                    }
                }
                Err(error) => {
                    // The newest camera fails with the session. The next camera opens another one.
                    if let Some((_, asked)) = unanswered.pop_last() {
                        end_one(&mut tally, asked, Err(error));
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

/// A camera that was sent.
struct SentCamera {
    /// Its number within the client.
    index: u64,
    /// When it was due, after the load's start.
    due: Duration,
    view: View,
}

/// Removes and returns the answered camera. Older open cameras are counted as superseded.
fn settle(tally: &mut Tally, open: &mut BTreeMap<u64, SentCamera>, camera_seq: u64) -> Option<SentCamera> {
    let newer = open.split_off(&(camera_seq + 1));
    let mut settled = std::mem::replace(open, newer);
    let asked = settled.remove(&camera_seq);
    tally.superseded += settled.len() as u64;
    asked
}
