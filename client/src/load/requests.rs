//! A load's client that sends single requests.

use tokio::sync::mpsc::UnboundedSender;
use tokio::task::JoinSet;
use tokio::time::{Instant, sleep_until};

use super::report::Tally;
use super::schedule::{Ended, LoadOptions, Schedule};
use crate::{Client, RenderOptions};

/// Sends each view when it is due, regardless of earlier ones. A view that is sent late has less time until its
/// deadline. Each view is passed to `report` as it ends.
pub(super) async fn run(
    client: Client,
    options: LoadOptions,
    schedule: Schedule,
    begin: Instant,
    report: UnboundedSender<Ended>,
) -> Tally {
    let mut tally = Tally::new();
    let mut flying = JoinSet::new();
    let number = schedule.client;
    for (index, (due, view)) in (0..).zip(schedule.due()) {
        sleep_until(begin + due).await;
        tally.sent += 1;
        let deadline = (begin + due + options.deadline).saturating_duration_since(Instant::now());
        let render =
            RenderOptions { deadline, encoding: options.encoding, wait_for_room: false, view_id: None };
        let (client, report) = (client.clone(), report.clone());
        flying.spawn(async move {
            let outcome = client.render(&view, &render).await.map(|answer| answer.frame);
            let at = Instant::now();
            let counted = outcome.as_ref().map(drop).map_err(Clone::clone);
            // The receiver may be gone, if the caller dropped the load.
            let _ = report.send(Ended { client: number, index, view, due: begin + due, at, outcome });
            (due, at - begin, counted)
        });
        // Free the results that have already arrived.
        while let Some(outcome) = flying.try_join_next() {
            count(&mut tally, outcome);
        }
    }
    while let Some(outcome) = flying.join_next().await {
        count(&mut tally, outcome);
    }
    tally
}

type Outcome = (std::time::Duration, std::time::Duration, Result<(), crate::ClientError>);

fn count(tally: &mut Tally, outcome: Result<Outcome, tokio::task::JoinError>) {
    match outcome {
        Ok((due, now, Ok(()))) => tally.answer(due, now),
        Ok((_, _, Err(error))) => tally.fail(&error),
        // These tasks are never cancelled, so an error is a panic.
        Err(error) => std::panic::resume_unwind(error.into_panic()),
    }
}
