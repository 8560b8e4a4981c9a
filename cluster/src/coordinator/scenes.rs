//! `Scenes`: how a worker comes by a scene that it does not have.

use std::pin::Pin;
use std::sync::Arc;

use argus_proto::chunks::{bundle_chunks, procedural_chunk};
use argus_proto::convert::scene_hash;
use argus_proto::status::invalid;
use argus_proto::v1::scenes_server::Scenes;
use argus_proto::{Fault, v1};
use bytes::Bytes;
use futures::Stream;
use tonic::{Request, Response, Status};
use tracing::info;

use super::hub::Hub;
use crate::SceneSource;

/// The service.
pub(super) struct ScenesService {
    pub(super) hub: Arc<Hub>,
}

type Chunks = Box<dyn Iterator<Item = v1::SceneChunk> + Send>;

#[tonic::async_trait]
impl Scenes for ScenesService {
    type FetchStream = Pin<Box<dyn Stream<Item = Result<v1::SceneChunk, Status>> + Send>>;

    async fn fetch(&self, request: Request<v1::FetchRequest>) -> Result<Response<Self::FetchStream>, Status> {
        let wanted = scene_hash(&request.get_ref().scene_hash, "scene_hash").map_err(invalid)?;
        let ours = self.hub.standing.scene.hash;
        if wanted != ours {
            return Err(Fault::NotFound(format!("scene {wanted} is not served here, {ours} is")).into());
        }
        let source = self.hub.source.clone();
        let chunks = tokio::task::spawn_blocking(move || chunks(source.as_ref()))
            .await
            .map_err(|e| Status::internal(e.to_string()))??;
        info!(scene = self.hub.standing.scene.name, "scene sent");
        Ok(Response::new(Box::pin(futures::stream::iter(chunks.map(Ok)))))
    }
}

/// Reads the bundle. It is in memory once while it is sent; a worker fetches it once in its life.
fn chunks(source: &dyn SceneSource) -> Result<Chunks, Status> {
    let scene = source.scene();
    if let Some(spec) = source.procedural() {
        return Ok(Box::new(std::iter::once(procedural_chunk(&scene.name, scene.hash, &spec))));
    }
    let files = source.files().map_err(Status::internal)?;
    let Some(root) = files.first().map(|(name, _)| name.clone()) else {
        return Err(Status::internal("the scene has no files"));
    };
    let read = |(name, path): (String, std::path::PathBuf)| match std::fs::read(&path) {
        Ok(bytes) => Ok((name, Bytes::from(bytes))),
        Err(e) => Err(Status::internal(format!("{}: {e}", path.display()))),
    };
    let files = files.into_iter().map(read).collect::<Result<Vec<_>, Status>>()?;
    let chunks = bundle_chunks(&scene.name, scene.hash, &root, files).map_err(Fault::from)?;
    Ok(Box::new(chunks))
}
