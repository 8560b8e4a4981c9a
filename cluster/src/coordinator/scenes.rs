//! The `Scenes` service: workers fetch the scene from it.

use std::collections::BTreeMap;
use std::pin::Pin;
use std::sync::{Arc, Weak};

use argus_proto::chunks::{bundle_chunks, procedural_chunk};
use argus_proto::convert::scene_hash;
use argus_proto::status::invalid;
use argus_proto::v1::scenes_server::Scenes;
use argus_proto::{Fault, v1};
use argus_scene::SceneHash;
use bytes::Bytes;
use futures::Stream;
use tokio::sync::Mutex;
use tonic::{Request, Response, Status};
use tracing::info;

use super::scene_table::SceneTable;
use crate::SceneSource;

/// The gRPC service.
pub(super) struct ScenesService {
    scenes: Arc<SceneTable>,
    /// The bundle of each scene while it is being sent. Concurrent fetches share it, and it is dropped after the last one.
    bundles: BTreeMap<SceneHash, Mutex<Weak<SceneFiles>>>,
}

/// The scene's files, the root file first.
struct SceneFiles {
    files: Vec<(String, Bytes)>,
}

type Chunks = Box<dyn Iterator<Item = v1::SceneChunk> + Send>;

impl ScenesService {
    pub(super) fn new(scenes: Arc<SceneTable>) -> Self {
        let hashes = scenes.all().iter().map(|scene| scene.shared.service.scene.hash);
        let bundles = hashes.map(|hash| (hash, Mutex::default())).collect();
        Self { scenes, bundles }
    }

    async fn chunks(
        &self,
        source: Arc<dyn SceneSource>,
        bundle: &Mutex<Weak<SceneFiles>>,
    ) -> Result<Chunks, Status> {
        let scene = source.scene().clone();
        if let Some(spec) = source.procedural() {
            return Ok(Box::new(std::iter::once(procedural_chunk(&scene.name, scene.hash, &spec))));
        }
        let bundle = read_once(bundle, move || read(source.as_ref())).await?;
        let Some(root) = bundle.files.first().map(|(name, _)| name.clone()) else {
            return Err(Status::internal("the scene has no files"));
        };
        // Clones share the bytes.
        let chunks =
            bundle_chunks(&scene.name, scene.hash, &root, bundle.files.clone()).map_err(Fault::from)?;
        Ok(Box::new(chunks.inspect(move |_| {
            let _shared_until_sent = &bundle;
        })))
    }
}

#[tonic::async_trait]
impl Scenes for ScenesService {
    type FetchStream = Pin<Box<dyn Stream<Item = Result<v1::SceneChunk, Status>> + Send>>;

    async fn fetch(&self, request: Request<v1::FetchRequest>) -> Result<Response<Self::FetchStream>, Status> {
        let wanted = scene_hash(&request.get_ref().scene_hash, "scene_hash").map_err(invalid)?;
        let (Some(scene), Some(bundle)) = (self.scenes.by_hash(wanted), self.bundles.get(&wanted)) else {
            let ours: Vec<String> = self.bundles.keys().map(ToString::to_string).collect();
            let verb = if ours.len() == 1 { "is" } else { "are" };
            let reason = format!("scene {wanted} is not served here, {} {verb}", ours.join(", "));
            return Err(Fault::NotFound(reason).into());
        };
        let chunks = self.chunks(scene.shared.source.clone(), bundle).await?;
        info!(scene = scene.shared.service.scene.name, "scene sent");
        Ok(Response::new(Box::pin(futures::stream::iter(chunks.map(Ok)))))
    }
}

/// Returns the shared value if it is alive, else reads it. Concurrent callers wait for one read.
async fn read_once<T: Send + Sync + 'static>(
    known: &Mutex<Weak<T>>,
    read: impl FnOnce() -> Result<T, Status> + Send + 'static,
) -> Result<Arc<T>, Status> {
    let mut known = known.lock().await;
    if let Some(here) = known.upgrade() {
        return Ok(here);
    }
    let read = tokio::task::spawn_blocking(read).await.map_err(|e| Status::internal(e.to_string()))?;
    let read = Arc::new(read?);
    *known = Arc::downgrade(&read);
    Ok(read)
}

fn read(source: &dyn SceneSource) -> Result<SceneFiles, Status> {
    let read = |(name, path): (String, std::path::PathBuf)| match std::fs::read(&path) {
        Ok(bytes) => Ok((name, Bytes::from(bytes))),
        Err(e) => Err(Status::internal(format!("{}: {e}", path.display()))),
    };
    let files = source.files().map_err(Status::internal)?;
    Ok(SceneFiles { files: files.into_iter().map(read).collect::<Result<_, Status>>()? })
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering};

    use futures::future::join_all;

    use super::*;

    #[tokio::test]
    async fn concurrent_fetches_read_the_bundle_once() {
        let (known, reads) = (Mutex::default(), Arc::new(AtomicUsize::new(0)));
        let fetch = || {
            let reads = reads.clone();
            read_once(&known, move || {
                std::thread::sleep(std::time::Duration::from_millis(20));
                Ok(reads.fetch_add(1, Ordering::SeqCst))
            })
        };
        let together = join_all((0..8).map(|_| fetch())).await;
        assert!(together.iter().all(|read| read.as_ref().is_ok_and(|read| **read == 0)));
        drop(together);
        assert!(known.lock().await.upgrade().is_none(), "nothing stays");
        assert_eq!(*fetch().await.unwrap(), 1);
    }
}
