//! How a worker comes by samples: held, fetched from another, or rendered here.
//!
//! Views that need the same sample at the same time share one fetch. A fetch asks the addresses in the order
//! given, verifies what comes by its hash, and where none of them has the sample renders it here: a worker
//! can play both roles, so a sampler's death costs the time of one sample and no view.
//!
//! Where the planes go follows from who asks: what another process asks for is read back to host memory
//! ([`on_host`]); what only this process needs stays on the device ([`at_hand`]). If both happen, in that
//! order, the host copy serves both; the other way round the sample is rendered once more, byte for byte the
//! same, which costs less than reading back every sample of a cluster of one.

use std::sync::Arc;
use std::time::Duration;

use argus_proto::chunks::{Received, SampleAssembler};
use argus_proto::convert::{scene_hash_bytes, specification_hash_bytes};
use argus_proto::trace::{TARGET, within};
use argus_proto::v1::samples_client::SamplesClient;
use argus_proto::{Fault, v1};
use argus_scene::{FaceMask, Sample, SampleId, SampleSetInfo};
use tokio::time::Instant;
use tracing::{Instrument, Span, debug_span, warn};

use super::fetches::Purpose;
use super::node::Node;
use super::packed::Chunks;
use super::policy::{self, ANNOUNCED, Need, Seek, Serve};
use super::store::is_on_host;
use crate::core::{Role, Source};
use crate::rate_limited_log::RateLimitedLog;

/// How long another worker's request waits for a sample that has begun to come here.
const COMING: Duration = Duration::from_secs(20);

/// The sample for this process's own views.
///
/// # Errors
/// [`Fault::NotFound`] for one that is dispensable, if no named worker holds it; else what rendering it ends with.
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
            // Begun for another view, which can do without.
            Err(Fault::NotFound(_)) if !needed.dispensable => {}
            // Begun for another view, which looks at other faces.
            Ok(sample) if !sample.faces.contains(faces) => {}
            fetched => return fetched,
        }
    }
}

async fn fetched_or_rendered(
    node: Arc<Node>,
    info: Arc<SampleSetInfo>,
    needed: Source,
) -> Result<Arc<Sample>, Fault> {
    let Source { id, faces, addresses, dispensable } = needed;
    // Another fetch may have ended since the last look.
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
                            warn!(%id, address, %fault, left_out, "sample not to be had there");
                        }
                    }
                }
                asked += 1;
            }
            Seek::Render { .. } => {
                // A compositor that renders has lost the sampler that rendered for all: others will ask here.
                let to_host = node.acting().is_some_and(|role| !role.samples());
                return node.render_sample((id, faces), info, to_host).await;
            }
            Seek::GiveUp | Seek::AskAgain => {
                return Err(Fault::NotFound(format!("sample {id} is with none of those who had it")));
            }
        }
    }
}

/// The sample for another process: rendered here, or passed on once it has come here, as [`policy::serve`] says.
pub(super) async fn on_host(
    node: Arc<Node>,
    info: Arc<SampleSetInfo>,
    (id, faces): (SampleId, FaceMask),
    prefetch: bool,
) -> Result<Arc<Sample>, Fault> {
    if let Some(sample) = node.store.get_on_host(id, faces) {
        return Ok(sample);
    }
    let samples = node.acting().is_none_or(Role::samples);
    if policy::serve(samples, prefetch, false) == Serve::Await {
        let coming = tokio::time::timeout(COMING, passed_on(&node, id, faces)).await;
        if let Ok(Some(sample)) = coming {
            return Ok(sample);
        }
        if coming.is_err() || policy::serve(samples, prefetch, true) == Serve::Refuse {
            return Err(Fault::NotFound(format!("sample {id} is neither here nor on its way here")));
        }
    }
    loop {
        let fetch = node.fetches.join((id, Purpose::OtherWorker), || {
            let (node, info) = (node.clone(), info.clone());
            Box::pin(async move {
                match node.store.get_on_host(id, faces) {
                    Some(sample) => Ok(sample),
                    None => node.render_sample((id, faces), info, true).await,
                }
            })
        });
        match fetch.await {
            // Begun for a process that needs other faces.
            Ok(sample) if !sample.faces.contains(faces) => {}
            rendered => return rendered,
        }
    }
}

/// The sample, once it has come here; `None` if it does not begin to come, or comes to nothing.
async fn passed_on(node: &Node, id: SampleId, faces: FaceMask) -> Option<Arc<Sample>> {
    let announced = Instant::now() + ANNOUNCED;
    loop {
        let begun = node.fetches.begun();
        tokio::pin!(begun);
        // From here on no bell is missed.
        begun.as_mut().enable();
        if let Some(sample) = node.store.get_with(id, faces) {
            // Of one that is on the device alone no other will come.
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

/// The sample as another worker has it, or renders it, and as it came: with these faces and those that are held here, which
/// it replaces.
pub(super) async fn from_other(
    node: &Node,
    info: &SampleSetInfo,
    (id, faces): (SampleId, FaceMask),
    address: &str,
    prefetch: bool,
) -> Result<(Sample, Chunks), Fault> {
    let span = debug_span!(target: TARGET, "fetch sample", %id, address);
    let faces = faces.union(node.store.faces(id));
    let from_there = received(node, info, (id, faces), address, prefetch, &span).instrument(span.clone());
    node.unless_suspected(address, from_there).await
}

async fn received(
    node: &Node,
    info: &SampleSetInfo,
    (id, faces): (SampleId, FaceMask),
    address: &str,
    prefetch: bool,
    span: &Span,
) -> Result<(Sample, Chunks), Fault> {
    let mut client = SamplesClient::new(node.channels.to(address)?);
    let request = v1::SubscribeRequest {
        scene_hash: scene_hash_bytes(info.scene),
        version: Some(info.version.into()),
        cameras: vec![id.camera],
        have: Vec::new(),
        prefetch,
        specification_hash: specification_hash_bytes(info.specification().hash()),
        faces: vec![faces.bits()],
    };
    let unavailable = |status: tonic::Status| Fault::Unavailable(status.message().to_owned());
    let silent = |_| Fault::Unavailable(format!("{address} fell silent"));
    let limit = node.config.fetch_timeout;
    let opened =
        tokio::time::timeout(limit, client.subscribe(within(span, request))).await.map_err(silent)?;
    let mut chunks = opened.map_err(unavailable)?.into_inner();
    let mut came = Vec::new();
    let mut unpacking = Duration::ZERO;
    let mut assembler = SampleAssembler::new(info.clone(), [id.camera]);
    assembler = assembler.with_faces([(id.camera, faces)].into_iter().collect());
    loop {
        let chunk =
            tokio::time::timeout(limit, chunks.message()).await.map_err(silent)?.map_err(unavailable)?;
        let Some(chunk) = chunk else {
            return Err(Fault::Unavailable(format!("{address} ended the stream before the sample's end")));
        };
        came.push(chunk.clone());
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
                return Ok((sample, came.into()));
            }
            Some(Received::Unchanged(_)) => {
                return Err(Fault::NotFound(format!("{address} claims that sample {id} is here")));
            }
            None => {}
        }
    }
}
