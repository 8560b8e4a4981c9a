//! The `Samples` service: sends samples, traced pixels and light cells to other workers.

use std::collections::HashMap;
use std::pin::Pin;
use std::sync::Arc;

use argus_proto::chunks::{pixel_chunks, sample_hash, unchanged_chunk};
use argus_proto::convert::{face_masks, scene_hash, specification_hash};
use argus_proto::trace::{TARGET, continued};
use argus_proto::v1::samples_server::Samples;
use argus_proto::{Fault, v1};
use argus_scene::{FaceMask, InvalidField, SampleId, SampleSetInfo};
use bytes::Bytes;
use futures::{Stream, StreamExt, TryStreamExt};
use tonic::{Request, Response, Status};
use tracing::{Instrument, debug_span};

use super::node::{ActiveRequest, Node, check_specification};
use super::packed::Chunks as Packed;
use super::{cells, fetch, trace};

/// Greatest number of samples in one request.
const MAX_CAMERAS: usize = 1024;

/// Samples of one request that are packed at the same time. Each is in memory twice meanwhile.
const IN_WORK: usize = 4;

/// The service.
pub(super) struct SamplesService {
    pub(super) node: Arc<Node>,
}

type Streamed<T> = Pin<Box<dyn Stream<Item = Result<T, Status>> + Send>>;
type Chunks = Streamed<v1::SampleChunk>;

#[tonic::async_trait]
impl Samples for SamplesService {
    type SubscribeStream = Chunks;

    async fn subscribe(&self, request: Request<v1::SubscribeRequest>) -> Result<Response<Chunks>, Status> {
        let active = self.node.begin()?;
        let worker = self.node.hello.name.as_str();
        let span =
            debug_span!(target: TARGET, "serve samples", worker, count = request.get_ref().cameras.len());
        continued(&span, request.metadata());
        let request = request.into_inner();
        let state = request.version.and_then(|version| version.state);
        self.node.transforms.known(state.map_or(0, |state| state.revision)).await?;
        if request.version.is_some_and(|version| version.number == SampleId::FRAMES) {
            return self.sources(request, active);
        }
        let info = check(&self.node, &request)?;
        let have: HashMap<u64, Bytes> =
            request.have.into_iter().map(|held| (held.camera, held.hash)).collect();
        let faces = face_masks(&request.cameras, &request.faces, "faces").map_err(Fault::from)?;
        let (node, prefetch) = (self.node.clone(), request.prefetch);
        let one = move |camera: u64| {
            let (node, info, have) = (node.clone(), info.clone(), have.get(&camera).cloned());
            let faces = faces.of(camera);
            async move {
                let chunks = packed(node, info, (camera, faces), have, prefetch).await?;
                Ok::<_, Status>(futures::stream::iter((0..chunks.len()).map(move |i| Ok(chunks[i].clone()))))
            }
            .instrument(debug_span!(target: TARGET, parent: &span, "sample", camera))
        };
        // The chunks of one sample are sent without interruption, since the receiver assembles one sample at a time.
        let chunks = futures::stream::iter(request.cameras).map(one).buffer_unordered(IN_WORK).try_flatten();
        let chunks = chunks.inspect(move |_| {
            let _active_until_sent = &active;
        });
        Ok(Response::new(Box::pin(chunks)))
    }

    type CellsStream = Streamed<v1::CellsPage>;

    async fn cells(&self, request: Request<v1::CellsRequest>) -> Result<Response<Self::CellsStream>, Status> {
        let active = self.node.begin()?;
        Ok(Response::new(Box::pin(cells::sent(&self.node, active, request.into_inner())?)))
    }

    type TraceStream = Streamed<v1::TraceChunk>;

    async fn trace(&self, request: Request<v1::TraceRequest>) -> Result<Response<Self::TraceStream>, Status> {
        let active = self.node.begin()?;
        let span = debug_span!(target: TARGET, "trace pixels", worker = self.node.hello.name);
        continued(&span, request.metadata());
        self.node.transforms.known(request.get_ref().revision).await?;
        let job = trace::check(&self.node, request.into_inner())?;
        let pixels = self.node.render_thread.render_pixels(&job).instrument(span).await?;
        let chunks = pixel_chunks(&pixels).map_err(Fault::from)?.into_iter().map(move |chunk| {
            let _active_until_sent = &active;
            Ok(chunk)
        });
        Ok(Response::new(Box::pin(futures::stream::iter(chunks))))
    }
}

impl SamplesService {
    /// Sends sources that are held here.
    fn sources(
        &self,
        request: v1::SubscribeRequest,
        active: ActiveRequest,
    ) -> Result<Response<Chunks>, Status> {
        check_scene(&self.node, &request)?;
        InvalidField::within("cameras", request.cameras.len(), 1..=MAX_CAMERAS).map_err(Fault::from)?;
        let node = self.node.clone();
        let one = move |camera: u64| {
            let node = node.clone();
            async move {
                let id = SampleId { version: SampleId::FRAMES, camera };
                let held = node.sources.sample(id);
                let held = held.ok_or_else(|| Fault::NotFound(format!("{id} is not held here")))?;
                let chunks = node.store.packed(held, &node.packing).await?;
                Ok::<_, Status>(futures::stream::iter((0..chunks.len()).map(move |i| Ok(chunks[i].clone()))))
            }
        };
        let chunks = futures::stream::iter(request.cameras).then(one).try_flatten();
        let chunks = chunks.inspect(move |_| {
            let _active_until_sent = &active;
        });
        Ok(Response::new(Box::pin(chunks)))
    }
}

/// Checks that a request is of the served scene and specification. Returns the served set.
fn check_scene(node: &Node, request: &v1::SubscribeRequest) -> Result<Arc<SampleSetInfo>, Fault> {
    let (served, _) = node.served.set()?;
    let scene = scene_hash(&request.scene_hash, "scene_hash")?;
    if scene != served.scene {
        return Err(Fault::NotFound(format!("this worker serves no samples of scene {scene}")));
    }
    let specification = specification_hash(&request.specification_hash, "specification_hash")?;
    check_specification(&served, specification)?;
    Ok(served)
}

/// Checks a request. Returns the sample set in its version.
fn check(node: &Node, request: &v1::SubscribeRequest) -> Result<Arc<SampleSetInfo>, Fault> {
    let version = request.version.ok_or_else(|| InvalidField::new("version", "must be given"))?;
    // Before the version is looked up, whose number means something else in another scene.
    check_scene(node, request)?;
    let (info, _) = node.served.set_in(version.try_into()?)?;
    InvalidField::within("cameras", request.cameras.len(), 1..=MAX_CAMERAS)?;
    for camera in &request.cameras {
        info.camera(*camera)?;
    }
    Ok(info)
}

/// A sample in chunks. It is fetched or rendered if the store does not hold it.
async fn packed(
    node: Arc<Node>,
    info: Arc<SampleSetInfo>,
    (camera, faces): (u64, FaceMask),
    have: Option<Bytes>,
    prefetch: bool,
) -> Result<Packed, Fault> {
    let id = SampleId { version: info.version.number, camera };
    let sample = fetch::on_host(node.clone(), info, (id, faces), prefetch).await?;
    if let Some(have) = have {
        let held = sample.clone();
        let hash = tokio::task::spawn_blocking(move || sample_hash(&held)).await;
        let hash = hash.map_err(|e| Fault::Unavailable(e.to_string()))??;
        if have == hash.as_slice() {
            return Ok(Arc::new([unchanged_chunk(id, hash)]));
        }
    }
    node.store.packed(sample, &node.packing).await
}
