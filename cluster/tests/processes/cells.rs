//! Light cells that workers take from one another.

use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

use crate::common::roles::{FakeCells, Settings};
use crate::common::{Cluster, LIMIT, Worker, direct, start_worker};

/// A cluster of a worker that holds those pages and one that wants those, and the latter's cells.
async fn two_workers(held: &[u64], wanted: &[u64]) -> (Cluster, Worker, [Arc<FakeCells>; 2]) {
    let cluster = Cluster::start(0).await;
    let cells = [FakeCells::of(held, &[]), FakeCells::of(&[], wanted)];
    let [holder, other] = cells.each_ref().map(|cells| {
        let settings = Arc::new(Settings::default());
        *settings.cells.lock() = Some(cells.clone());
        start_worker(&cluster.coordinator.url(), &settings)
    });
    cluster.wait_for(|status| status.processes == 2).await;
    (Cluster { workers: vec![holder], ..cluster }, other, cells)
}

async fn until(what: &str, is_so: impl Fn() -> bool) {
    let reached = async {
        while !is_so() {
            tokio::time::sleep(Duration::from_millis(5)).await;
        }
    };
    tokio::time::timeout(LIMIT, reached).await.unwrap_or_else(|_| panic!("never: {what}"));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn pages_are_taken_from_the_worker_that_holds_them_and_others_are_filled_here() {
    let (cluster, _other, [holder, taker]) = two_workers(&[1, 2, 3], &[1, 2, 7]).await;
    until("the pages are there", || taker.pages.lock().len() == 2).await;
    until("the other page is given up", || *taker.given_up.lock() == [7]).await;
    assert_eq!(taker.pages.lock().keys().copied().collect::<Vec<_>>(), [1, 2]);
    assert!(taker.pages.lock().iter().all(|(page, packed)| holder.pages.lock()[page] == packed));
    cluster.render(&direct(0)).await.expect("views are answered");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_worker_that_is_killed_while_it_sends_leaves_its_pages_to_the_other() {
    let (mut cluster, _other, [holder, taker]) = two_workers(&(0..100).collect::<Vec<_>>(), &[]).await;
    holder.stuck.store(true, Ordering::SeqCst);
    taker.wanted.lock().extend(0..100);
    until("the holder was asked", || holder.was_asked()).await;
    cluster.workers[0].kill();
    holder.stuck.store(false, Ordering::SeqCst);
    let settled = || taker.pages.lock().len() + taker.given_up.lock().len() == 100;
    until("each page is there or given up", settled).await;
    assert!(!taker.given_up.lock().is_empty(), "the holder was killed before it sent anything");
    cluster.render(&direct(0)).await.expect("the other worker answers");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn pages_that_the_sampler_refuses_are_filled_here() {
    let (_cluster, _other, [_, taker]) =
        two_workers(&[FakeCells::MALFORMED, 5], &[FakeCells::MALFORMED]).await;
    until("the page is given up", || *taker.given_up.lock() == [FakeCells::MALFORMED]).await;
    assert!(taker.pages.lock().is_empty());
}
