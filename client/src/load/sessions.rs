//! One client of a load whose views are cameras of a session.

use std::collections::BTreeMap;
use std::time::Duration;

use argus_scene::{Frame, View};
use tokio::sync::mpsc::UnboundedSender;
use tokio::time::{Instant, sleep_until};

use super::report::Tally;
use super::{Ended, LoadOptions, Schedule};
use crate::{Client, ClientError, SessionEvent, SessionOptions};

/// Moves the camera when it is due and counts the frames that come. The newest camera, when no more follow, is
/// to be answered; that it is not is a failure, while those that newer ones overtook are superseded. Each view that is
/// answered or fails goes to `report`.
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
    let end_one = |tally: &mut Tally, asked: Asked, outcome: Result<Frame, ClientError>| {
        let Asked { index, due, view } = asked;
        let (due, at) = (begin + due, Instant::now());
        match &outcome {
            Ok(frame) => {
                tally.answer(due - begin, at - begin);
                tally.from_history += u64::from(frame.provenance.history);
            }
            Err(error) => tally.fail(error),
        }
        // A caller that is gone wants to know nothing.
        let _ = report.send(Ended { client: number, index, view, due, at, outcome });
    };
    // Cameras that may still be answered, by their number within the session.
    let mut unanswered: BTreeMap<u64, Asked> = BTreeMap::new();
    let mut schedule = (0..).zip(schedule.due()).peekable();
    let mut end = begin + options.deadline;
    loop {
        let next_due = schedule.peek().map(|(_, (due, _))| begin + *due);
        let idle = session.is_idle();
        if next_due.is_none() && idle {
            break;
        }
        tokio::select! {
            // A camera that is due goes first: the schedule does not wait for frames.
            biased;
            () = sleep_until(next_due.unwrap_or(end)) => {
                let Some((index, (due, view))) = schedule.next() else {
                    let last = "the session's newest camera was not answered".to_owned();
                    // Of what is open, the newest has failed.
                    let error = ClientError::Deadline { after: options.deadline, last };
                    match unanswered.pop_last() {
                        Some((_, asked)) => end_one(&mut tally, asked, Err(error)),
                        None => tally.fail(&error),
                    }
                    break;
                };
                unanswered.insert(session.send(&view), Asked { index, due, view });
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
                    // The newest camera is lost with the session; the next one begins another.
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
struct Asked {
    /// Its number among the client's views.
    index: u64,
    /// After the load's beginning.
    due: Duration,
    view: View,
}

/// Takes the camera that is answered out of those that are open; those before it are superseded.
fn settle(tally: &mut Tally, open: &mut BTreeMap<u64, Asked>, camera_seq: u64) -> Option<Asked> {
    let newer = open.split_off(&(camera_seq + 1));
    let mut settled = std::mem::replace(open, newer);
    let asked = settled.remove(&camera_seq);
    tally.superseded += settled.len() as u64;
    asked
}
