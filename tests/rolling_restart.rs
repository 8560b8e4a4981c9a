//! All workers of a real cluster are restarted in turn while views are asked for: none is lost.
#![allow(clippy::unwrap_used)] // a test ends at the first thing that goes wrong

mod support;

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use argus_client::load::path_views;
use argus_client::{Client, RenderOptions};
use argus_scene::PlanRequest;
use support::{Coordinator, SMALL};

#[test]
fn a_rolling_restart_of_all_workers_loses_no_frame_and_repeats_none() {
    let coordinator = Coordinator::start(SMALL, &[]);
    let mut workers = coordinator.workers(3);
    coordinator.wait_for_workers(3);
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build().unwrap();
    let done = AtomicBool::new(false);
    let answered = std::thread::scope(|scope| {
        let asking = scope.spawn(|| {
            runtime.block_on(async {
                let client = Client::connect(&coordinator.url).await.unwrap();
                let options = RenderOptions { deadline: Duration::from_secs(60), ..RenderOptions::default() };
                let views = path_views(client.description(), 50, [96, 72], PlanRequest::default());
                let mut answered = 0;
                for view in views.iter().cycle() {
                    if done.load(Ordering::SeqCst) {
                        break;
                    }
                    let answer = client.render(view, &options).await.unwrap();
                    assert_eq!(answer.attempts, 1, "the client had to ask again");
                    answered += 1;
                }
                answered
            })
        });
        for worker in &mut workers {
            // The new one first: then there is always one for each role.
            let newcomer = coordinator.worker(&[]);
            coordinator.wait_for_workers(4);
            let mut old = std::mem::replace(worker, newcomer);
            assert!(old.stop().success());
            coordinator.wait_for_workers(3);
        }
        done.store(true, Ordering::SeqCst);
        asking.join().unwrap()
    });
    let counters = coordinator.status()["counters"].clone();
    assert!(answered > 0);
    assert_eq!(
        (counters["workers_lost"].as_u64(), counters["views_failed"].as_u64()),
        (Some(0), Some(0)),
        "{counters:#}"
    );
}
