//! Samples that are at hand before a view asks for them: rendered when nothing else waits, or fetched.

use std::sync::Arc;

use argus_proto::Fault;
use argus_scene::{Sample, SampleId, SampleSetInfo, Version};
use tokio::sync::watch;
use tracing::debug;

use super::bringing::{Bringing, Told};
use super::fetch;
use super::fetches::For;
use super::node::Node;
use super::policy::{self, Need, PAUSE, Seek};

/// Has these samples at hand, each fetched from the first of its addresses that has it, or rendered here where
/// it has none; forgets refinements that an earlier call wanted and this one does not. The rig's own samples stay: as long as
/// there is room for them, or as their version is kept.
pub(super) fn want(node: &Arc<Node>, samples: Vec<Told>, versions: &[Version], to_host: bool) {
    let mut wanted = node.ahead.wanted.lock();
    let mut before = std::mem::take(&mut *wanted);
    for told in samples {
        let Told { id, faces, .. } = told;
        let Some(version) = versions.iter().find(|version| version.number == id.version) else { continue };
        let Ok((info, _)) = node.set_in(*version) else { continue };
        let is_here = || node.store.faces(id).contains(faces) && !node.store.faces(id).is_empty();
        let kept = before.remove(&id).filter(|kept| !kept.task.is_finished() || is_here());
        let bringing = match kept {
            Some(kept) => {
                kept.told.send_replace(told);
                kept
            }
            None => {
                let (told, newest) = watch::channel(told);
                let task = tokio::spawn(bring(node.clone(), info, newest, to_host)).abort_handle();
                Bringing { told, task }
            }
        };
        wanted.insert(id, bringing);
    }
    drop(wanted);
    before.values().for_each(|gone| gone.task.abort());
    let is_own = |id: &SampleId| node.set().is_ok_and(|(set, _)| set.rig.level(id.camera) == Some(0));
    let gone: Vec<SampleId> = before.keys().copied().filter(|id| !is_own(id)).collect();
    node.store.forget(&gone);
}

async fn bring(node: Arc<Node>, info: Arc<SampleSetInfo>, newest: watch::Receiver<Told>, to_host: bool) {
    // The task ends when the sample is there or is no longer wanted.
    loop {
        let told = newest.borrow().clone();
        match at_hand(&node, &info, &told, to_host).await {
            // More faces may be wanted by now.
            Ok(()) if !told.faces.contains(newest.borrow().faces) => continue,
            // The coordinator lets views use it as soon as it knows.
            Ok(()) => return node.news.notify_one(),
            Err(fault) => debug!(id = %told.id, %fault, "not at hand ahead of demand"),
        }
        tokio::time::sleep(PAUSE).await;
    }
}

async fn at_hand(
    node: &Arc<Node>,
    info: &Arc<SampleSetInfo>,
    told: &Told,
    to_host: bool,
) -> Result<(), Fault> {
    let Told { id, faces, .. } = *told;
    let held = match to_host {
        true => node.store.get_on_host(id, faces),
        false => node.store.get_with(id, faces),
    };
    if let Some(held) = held {
        node.take_up(info.clone(), held).await;
        return Ok(());
    }
    // Others who are fed from here join it.
    let sample = loop {
        let fetch = node
            .fetches
            .join((id, For::Later), || Box::pin(brought(node.clone(), info.clone(), told.clone(), to_host)));
        let sample = fetch.await?;
        // One that was begun for fewer faces is of no use.
        if sample.faces.contains(faces) {
            break sample;
        }
    };
    node.take_up(info.clone(), sample).await;
    Ok(())
}

/// The sample from another worker or, as [`policy::seek`] says, rendered here.
async fn brought(
    node: Arc<Node>,
    info: Arc<SampleSetInfo>,
    told: Told,
    to_host: bool,
) -> Result<Arc<Sample>, Fault> {
    let Told { id, faces, ref addresses } = told;
    let fetched = fetched(&node, &info, &told).await;
    let need = Need::Later { feeds_others: to_host };
    match (fetched, policy::seek(need, addresses.len(), addresses.len())) {
        // Those who have it have it on a device alone, or no longer, or hang.
        (Err(_), Seek::Render { .. }) => node.render_sample_ahead((id, faces), info, to_host).await,
        (fetched, _) => fetched,
    }
}

/// The sample from the first of the others who has it, or is about to.
async fn fetched(
    node: &Node,
    info: &SampleSetInfo,
    &Told { id, faces, ref addresses }: &Told,
) -> Result<Arc<Sample>, Fault> {
    let mut last = Fault::NotFound("no worker is known to hold it".to_owned());
    if addresses.is_empty() {
        return Err(last);
    }
    let closed = |_| Fault::Unavailable("the worker is shutting down".to_owned());
    // Where the scene stands still, what is to be fetched is there. Samples of the next moment may have to be waited
    // for, by whoever feeds this worker as well: with turns, two could wait for each other.
    let _turn = match info.epoch_secs == 0.0 {
        true => Some(node.ahead.turns.acquire().await.map_err(closed)?),
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
