//! One client of a load whose views are requests.

use tokio::task::JoinSet;
use tokio::time::{Instant, sleep_until};

use super::report::Tally;
use super::{LoadOptions, Schedule};
use crate::{Client, RenderOptions};

/// Sends each view when it is due, whatever has become of those before; a view that could not be sent in time
/// has the less left of its deadline.
pub(super) async fn run(client: Client, options: LoadOptions, schedule: Schedule, begin: Instant) -> Tally {
    let mut tally = Tally::new();
    let mut flying = JoinSet::new();
    for (due, view) in schedule.due() {
        sleep_until(begin + due).await;
        tally.sent += 1;
        let deadline = (begin + due + options.deadline).saturating_duration_since(Instant::now());
        let render =
            RenderOptions { deadline, encoding: options.encoding, wait_for_room: false, view_id: None };
        let client = client.clone();
        flying.spawn(async move {
            let outcome = client.render(&view, &render).await;
            (due, begin.elapsed(), outcome.map(drop))
        });
        // What has come already need not be kept until the end.
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
        // Nothing cancels these tasks, so one that does not return has panicked.
        Err(error) => std::panic::resume_unwind(error.into_panic()),
    }
}
