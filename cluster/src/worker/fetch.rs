//! Gets samples: from the store, from another worker, or by rendering.
//!
//! Views that need the same sample at the same time share one fetch. A fetch asks the addresses in order, and
//! verifies each answer by its hash. If no address has the sample, this worker renders it: any worker can play both
//! roles, so the loss of a sampler costs the time of one sample and no view.
//!
//! The planes' location depends on the requester. A sample for another worker is read back to host memory
//! ([`on_host`]). A sample for this worker's views stays on the device ([`at_hand`]). A host copy serves later
//! requests of both kinds. A device copy does not serve another worker: the sample is then rendered again, with equal
//! bytes. This costs less than reading back every sample in a cluster of one worker.

use std::sync::Arc;
use std::time::Duration;

use argus_proto::chunks::{Received, SampleAssembler};
use argus_proto::convert::{scene_hash_bytes, specification_hash_bytes};
use argus_proto::trace::{TARGET, within};
use argus_proto::v1::samples_client::SamplesClient;
use argus_proto::{Fault, v1};
use argus_scene::{FaceMask, Sample, SampleId, SampleSetInfo, Version};
use tokio::time::Instant;
use tracing::{Instrument, Span, debug_span, warn};

use super::fetches::Purpose;
use super::node::Node;
use super::packed::Chunks;
use super::policy::{self, ANNOUNCED, Need, Seek, Serve};
use super::sources::SourceKey;
use super::store::is_on_host;
use crate::core::{Role, Source};
use crate::rate_limited_log::RateLimitedLog;

/// How long another worker's request waits for a sample whose fetch has begun here.
const COMING: Duration = Duration::from_secs(20);

/// Gets a sample for this worker's own views.
///
/// # Errors
/// [`Fault::NotFound`] for a dispensable sample that no named worker holds; else the error of rendering it.
pub(super) async fn at_hand(
    node: Arc<Node>,
    info: Arc<SampleSetInfo>,
    needed: Source,
) -> Result<Arc<Sample>, Fault> {
    let Source { id, faces, .. } = needed;
    if let Some(sample) = node.store.get_with(id, faces) {
        return Ok(sample);
    }
    loop {
        let fetch = node.fetches.join((id, Purpose::View), || {
            Box::pin(fetched_or_rendered(node.clone(), info.clone(), needed.clone()))
        });
        match fetch.await {
            // The joined fetch was for another view, for which the sample is dispensable.
            Err(Fault::NotFound(_)) if !needed.dispensable => {}
            // The joined fetch was for another view, which needs other faces.
            Ok(sample) if !sample.faces.contains(faces) => {}
            fetched => return fetched,
        }
    }
}

/// Fetches a sample from another worker, or renders it here.
async fn fetched_or_rendered(
    node: Arc<Node>,
    info: Arc<SampleSetInfo>,
    needed: Source,
) -> Result<Arc<Sample>, Fault> {
    let Source { id, faces, addresses, dispensable } = needed;
    // Another fetch may have ended meanwhile.
    if let Some(sample) = node.store.get_with(id, faces) {
        return Ok(sample);
    }
    let others: Vec<&String> = addresses.iter().filter(|address| **address != node.hello.address).collect();
    let mut asked = 0;
    loop {
        match policy::seek(Need::View { dispensable }, asked, others.len()) {
            Seek::Ask(next) => {
                let address = others[next];
                match from_other(&node, &info, (id, faces), address, false).await {
                    Ok(received) => return Ok(node.store.insert_received(received)),
                    Err(fault) => {
                        static MISSED: RateLimitedLog = RateLimitedLog::new();
                        if let Some(left_out) = MISSED.now() {
                            warn!(%id, address, %fault, left_out, "a worker did not send a sample");
                        }
                    }
                }
                asked += 1;
            }
            Seek::Render { .. } => {
                // A compositor renders samples if the samplers are lost. Other workers will then request the sample
                // here.
                let to_host = node.status.role().is_some_and(|role| !role.samples());
                return node.render_thread.render_sample((id, faces), info, to_host).await;
            }
            Seek::GiveUp | Seek::AskAgain => {
                return Err(Fault::NotFound(format!("none of the named workers has sample {id}")));
            }
        }
    }
}

/// Gets a sample for another worker: waits for it, or renders it, as [`policy::serve`] says. `prefetch`: no view
/// waits for it.
pub(super) async fn on_host(
    node: Arc<Node>,
    info: Arc<SampleSetInfo>,
    (id, faces): (SampleId, FaceMask),
    prefetch: bool,
) -> Result<Arc<Sample>, Fault> {
    if let Some(sample) = node.store.get_on_host(id, faces) {
        return Ok(sample);
    }
    let samples = node.status.role().is_none_or(Role::samples);
    if policy::serve(samples, prefetch, false) == Serve::Await {
        let coming = tokio::time::timeout(COMING, awaited(&node, id, faces)).await;
        if let Ok(Some(sample)) = coming {
            return Ok(sample);
        }
        if coming.is_err() || policy::serve(samples, prefetch, true) == Serve::Refuse {
            return Err(Fault::NotFound(format!("sample {id} is neither held here nor being fetched")));
        }
    }
    loop {
        let fetch = node.fetches.join((id, Purpose::OtherWorker), || {
            let (node, info) = (node.clone(), info.clone());
            Box::pin(async move {
                match node.store.get_on_host(id, faces) {
                    Some(sample) => Ok(sample),
                    None => node.render_thread.render_sample((id, faces), info, true).await,
                }
            })
        });
        match fetch.await {
            // The joined fetch was for a worker that needs other faces.
            Ok(sample) if !sample.faces.contains(faces) => {}
            rendered => return rendered,
        }
    }
}

/// Waits for a sample that should be fetched here. Returns `None` if its fetch does not begin in time, or fails.
async fn awaited(node: &Node, id: SampleId, faces: FaceMask) -> Option<Arc<Sample>> {
    let announced = Instant::now() + ANNOUNCED;
    loop {
        let begun = node.fetches.begun();
        tokio::pin!(begun);
        // From here on, no notification is missed.
        begun.as_mut().enable();
        if let Some(sample) = node.store.get_with(id, faces) {
            // A sample that is only on the device cannot be sent, and no other copy will arrive.
            return Some(sample).filter(|sample| is_on_host(sample));
        }
        match node.fetches.find(id, &[Purpose::View, Purpose::Prefetch]) {
            Some(fetch) => {
                let fetched = fetch.await;
                return fetched.ok().and_then(|_| node.store.get_on_host(id, faces));
            }
            None => tokio::time::timeout_at(announced, begun).await.ok()?,
        }
    }
}

/// Requests a sample from another worker, which sends or renders it. Returns the sample and its chunks. It has the
/// requested faces and the faces that are held here, because it replaces the held sample.
pub(super) async fn from_other(
    node: &Node,
    info: &SampleSetInfo,
    (id, faces): (SampleId, FaceMask),
    address: &str,
    prefetch: bool,
) -> Result<(Sample, Chunks), Fault> {
    let span = debug_span!(target: TARGET, "fetch sample", %id, address);
    let faces = faces.union(node.store.faces(id));
    let answer = received(node, info, (id, faces), address, prefetch, &span).instrument(span.clone());
    node.unless_suspected(address, answer).await
}

/// Requests a source from another worker, which sends it if it holds it. Returns its sample and the chunks.
///
/// # Errors
/// [`Fault::Unavailable`] if the worker does not send it in time, does not hold it, or is suspected.
pub(super) async fn source_from(
    node: &Node,
    info: &SampleSetInfo,
    key: &SourceKey,
    address: &str,
) -> Result<(Sample, Chunks), Fault> {
    let id = key.id();
    let span = debug_span!(target: TARGET, "fetch source", %id, address);
    let request = v1::SubscribeRequest {
        scene_hash: scene_hash_bytes(info.scene),
        version: Some(Version { number: SampleId::FRAMES, state: key.state }.into()),
        cameras: vec![id.camera],
        have: Vec::new(),
        prefetch: false,
        specification_hash: specification_hash_bytes(info.specification().hash()),
        faces: Vec::new(),
    };
    let assembler = SampleAssembler::of_frame(id, key.source.sample_camera());
    let answer = assembled(node, request, assembler, address, &span).instrument(span.clone());
    node.unless_suspected(address, answer).await
}

/// Receives a sample from another worker.
async fn received(
    node: &Node,
    info: &SampleSetInfo,
    (id, faces): (SampleId, FaceMask),
    address: &str,
    prefetch: bool,
    span: &Span,
) -> Result<(Sample, Chunks), Fault> {
    let request = v1::SubscribeRequest {
        scene_hash: scene_hash_bytes(info.scene),
        version: Some(info.version.into()),
        cameras: vec![id.camera],
        have: Vec::new(),
        prefetch,
        specification_hash: specification_hash_bytes(info.specification().hash()),
        faces: vec![faces.bits()],
    };
    let assembler = SampleAssembler::new(info.clone(), [id.camera]);
    let assembler = assembler.with_faces([(id.camera, faces)].into_iter().collect());
    assembled(node, request, assembler, address, span).await
}

/// Subscribes to one sample of another worker, and assembles it.
async fn assembled(
    node: &Node,
    request: v1::SubscribeRequest,
    mut assembler: SampleAssembler,
    address: &str,
    span: &Span,
) -> Result<(Sample, Chunks), Fault> {
    let mut client = SamplesClient::new(node.channels.to(address)?);
    let unavailable = |status: tonic::Status| Fault::Unavailable(status.message().to_owned());
    let timed_out = |_| Fault::Unavailable(format!("{address} sent nothing within the fetch timeout"));
    let limit = node.config.fetch_timeout;
    let opened =
        tokio::time::timeout(limit, client.subscribe(within(span, request))).await.map_err(timed_out)?;
    let mut chunks = opened.map_err(unavailable)?.into_inner();
    let mut received_chunks = Vec::new();
    let mut unpacking = Duration::ZERO;
    loop {
        let chunk =
            tokio::time::timeout(limit, chunks.message()).await.map_err(timed_out)?.map_err(unavailable)?;
        let Some(chunk) = chunk else {
            return Err(Fault::Unavailable(format!("{address} ended the stream before the sample's end")));
        };
        received_chunks.push(chunk.clone());
        // Unpacking takes milliseconds.
        let pushed = tokio::task::spawn_blocking(move || {
            let began = std::time::Instant::now();
            let received = assembler.push(chunk);
            (assembler, received, began.elapsed())
        });
        let (back, received, took) = pushed.await.map_err(|e| Fault::Unavailable(e.to_string()))?;
        (assembler, unpacking) = (back, unpacking + took);
        match received? {
            Some(Received::Sample(sample, _)) => {
                node.received(unpacking);
                return Ok((sample, received_chunks.into()));
            }
            Some(Received::Unchanged(id)) => {
                return Err(Fault::NotFound(format!(
                    "{address} sent no data, as if this worker held sample {id}"
                )));
            }
            None => {}
        }
    }
}
