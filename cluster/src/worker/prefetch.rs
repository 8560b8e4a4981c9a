//! Prefetches samples before a view needs them: fetches them, or renders them while the render thread is idle.

use std::sync::Arc;

use argus_proto::Fault;
use argus_scene::{Sample, SampleId, SampleSetInfo, Version};
use tokio::sync::watch;
use tracing::debug;

use super::fetch;
use super::fetches::Purpose;
use super::node::Node;
use super::policy::{self, Need, PAUSE, Seek};
use super::prefetches::{Prefetch, WantedSample};

/// Prefetches these samples: each from the first of its addresses that has it, or by rendering if it has no address.
///
/// Forgets refinements that an earlier call wanted and this one does not. Samples of the rig's own cameras stay until the
/// store needs their memory or their version is dropped.
pub(super) fn want(node: &Arc<Node>, samples: Vec<WantedSample>, versions: &[Version], to_host: bool) {
    let mut tasks = node.prefetches.tasks();
    let mut before = std::mem::take(&mut *tasks);
    for wanted in samples {
        let WantedSample { id, faces, .. } = wanted;
        let Some(version) = versions.iter().find(|version| version.number == id.version) else { continue };
        let Ok((info, _)) = node.served.set_in(*version) else { continue };
        let is_here = || node.store.faces(id).contains(faces) && !node.store.faces(id).is_empty();
        let kept = before.remove(&id).filter(|kept| !kept.task.is_finished() || is_here());
        let prefetch = match kept {
            Some(kept) => {
                kept.wanted.send_replace(wanted);
                kept
            }
            None => {
                let (wanted, newest) = watch::channel(wanted);
                let task = tokio::spawn(prefetch(node.clone(), info, newest, to_host)).abort_handle();
                Prefetch { wanted, task }
            }
        };
        tasks.insert(id, prefetch);
    }
    drop(tasks);
    before.values().for_each(|gone| gone.task.abort());
    let is_own = |id: &SampleId| node.served.set().is_ok_and(|(set, _)| set.rig.level(id.camera) == Some(0));
    let gone: Vec<SampleId> = before.keys().copied().filter(|id| !is_own(id)).collect();
    node.store.forget(&gone);
}

/// Prefetches a sample. Tries again until the worker holds all wanted faces.
async fn prefetch(
    node: Arc<Node>,
    info: Arc<SampleSetInfo>,
    newest: watch::Receiver<WantedSample>,
    to_host: bool,
) {
    loop {
        let wanted = newest.borrow().clone();
        match hold(&node, &info, &wanted, to_host).await {
            // The assignment changed meanwhile and wants more faces.
            Ok(()) if !wanted.faces.contains(newest.borrow().faces) => continue,
            // An early report lets the coordinator use the sample in plans at once.
            Ok(()) => return node.news.notify_one(),
            Err(fault) => debug!(id = %wanted.id, %fault, "prefetch failed"),
        }
        tokio::time::sleep(PAUSE).await;
    }
}

/// Gets a sample into the store, and then into the compositor.
async fn hold(
    node: &Arc<Node>,
    info: &Arc<SampleSetInfo>,
    wanted: &WantedSample,
    to_host: bool,
) -> Result<(), Fault> {
    let WantedSample { id, faces, .. } = *wanted;
    let held = match to_host {
        true => node.store.get_on_host(id, faces),
        false => node.store.get_with(id, faces),
    };
    if let Some(held) = held {
        node.render_thread.hold(info.clone(), held).await;
        return Ok(());
    }
    // Workers that fetch the sample from this one join the same fetch.
    let sample = loop {
        let fetch = node.fetches.join((id, Purpose::Prefetch), || {
            Box::pin(fetched_or_rendered(node.clone(), info.clone(), wanted.clone(), to_host))
        });
        let sample = fetch.await?;
        // A joined fetch may have begun for fewer faces.
        if sample.faces.contains(faces) {
            break sample;
        }
    };
    node.render_thread.hold(info.clone(), sample).await;
    Ok(())
}

/// Fetches the sample, or renders it here if [`policy::seek`] says so.
async fn fetched_or_rendered(
    node: Arc<Node>,
    info: Arc<SampleSetInfo>,
    wanted: WantedSample,
    to_host: bool,
) -> Result<Arc<Sample>, Fault> {
    let WantedSample { id, faces, ref addresses } = wanted;
    let fetched = fetched(&node, &info, &wanted).await;
    let need = Need::Prefetch { feeds_others: to_host };
    match (fetched, policy::seek(need, addresses.len(), addresses.len())) {
        // The workers at these addresses dropped the sample, have it only on a device, or hang.
        (Err(_), Seek::Render { .. }) => node.render_thread.prefetch_sample((id, faces), info, to_host).await,
        (fetched, _) => fetched,
    }
}

/// Fetches the sample from the first address whose worker has it or will have it soon.
async fn fetched(
    node: &Node,
    info: &SampleSetInfo,
    &WantedSample { id, faces, ref addresses }: &WantedSample,
) -> Result<Arc<Sample>, Fault> {
    let mut last = Fault::NotFound("no worker is known to hold it".to_owned());
    if addresses.is_empty() {
        return Err(last);
    }
    let closed = |_| Fault::Unavailable("the worker is shutting down".to_owned());
    // In a still scene the sample exists already, so a turn ends soon. A sample of the next version may still be in the
    // making, and the worker that sends it may itself wait for a fetch: with turns, two workers could deadlock.
    let _turn = match info.epoch_secs == 0.0 {
        true => Some(node.prefetches.turn().await.map_err(closed)?),
        false => None,
    };
    for address in addresses {
        if let Some(sample) = node.store.get_with(id, faces) {
            return Ok(sample);
        }
        match fetch::from_other(node, info, (id, faces), address, true).await {
            Ok(received) => return Ok(node.store.insert_received_quietly(received)),
            Err(fault) => last = fault,
        }
    }
    Err(last)
}
