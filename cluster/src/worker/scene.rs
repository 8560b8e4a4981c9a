//! Opens the assigned scene: from this machine, or by hash from the coordinator.

use std::sync::Arc;
use std::time::Duration;

use argus_proto::chunks::{SceneFiles, SceneFilesAssembler, SceneFilesSource};
use argus_proto::convert::scene_hash_bytes;
use argus_proto::v1;
use argus_proto::v1::scenes_client::ScenesClient;
use argus_scene::Scene;
use tokio::time::Instant;
use tonic::transport::Channel;
use tracing::info;

use super::config::RunError;
use super::node::Node;
use crate::{SceneFile, SceneOpener, SceneRef};

/// Greatest number of attempts to fetch a scene.
const ATTEMPTS: u32 = 3;

/// Opens the scene, and checks its hash wherever it came from: frames of two workers are equal only if their scenes
/// are.
///
/// # Errors
/// [`RunError::Scene`] if no source has the scene, or its hash differs.
pub(super) async fn obtain(
    node: &Node,
    opener: Arc<dyn SceneOpener>,
    reference: SceneRef,
    coordinator: Channel,
) -> Result<Arc<Scene>, RunError> {
    if let Some(scene) = node.served.scene().filter(|scene| scene.hash == reference.hash) {
        return Ok(scene);
    }
    let began = Instant::now();
    let failed = |reason: String| RunError::Scene { name: reference.name.clone(), reason };
    let (local, wanted) = (opener.clone(), reference.clone());
    let (scene, source) = match blocking(move || local.open_local(&wanted)).await.map_err(failed)? {
        Some(scene) => (scene, "this machine"),
        None => {
            let bundle = fetch(node, &reference, coordinator).await.map_err(failed)?;
            let wanted = reference.clone();
            let scene = blocking(move || open(opener.as_ref(), &wanted, bundle)).await.map_err(failed)?;
            (scene, "the coordinator")
        }
    };
    if scene.hash != reference.hash {
        return Err(failed(format!(
            "its hash is {} here and {} at the coordinator",
            scene.hash, reference.hash
        )));
    }
    info!(scene = reference.name, source, ms = began.elapsed().as_secs_f64() * 1e3, "scene opened");
    Ok(scene)
}

/// Runs long work off the async threads.
async fn blocking<T: Send + 'static>(
    work: impl FnOnce() -> Result<T, String> + Send + 'static,
) -> Result<T, String> {
    tokio::task::spawn_blocking(work).await.map_err(|e| format!("the loader failed: {e}"))?
}

fn open(opener: &dyn SceneOpener, reference: &SceneRef, bundle: SceneFiles) -> Result<Arc<Scene>, String> {
    match bundle.source {
        SceneFilesSource::Procedural(spec) => opener.open_procedural(&spec),
        SceneFilesSource::Files { root, files } => {
            let mut files: Vec<SceneFile> =
                files.into_iter().map(|(name, bytes)| SceneFile { name, bytes }).collect();
            files.sort_by_key(|file| file.name != root);
            opener.open_bundle(reference, files)
        }
    }
}

async fn fetch(node: &Node, reference: &SceneRef, coordinator: Channel) -> Result<SceneFiles, String> {
    let mut last = String::new();
    for attempt in 0..ATTEMPTS {
        if attempt > 0 {
            tokio::time::sleep(Duration::from_millis(200) * attempt).await;
        }
        match fetch_once(node, reference, coordinator.clone()).await {
            Ok(bundle) => return Ok(bundle),
            Err(reason) => last = reason,
        }
    }
    Err(format!("the coordinator did not send the scene: {last}"))
}

async fn fetch_once(node: &Node, reference: &SceneRef, coordinator: Channel) -> Result<SceneFiles, String> {
    let request = v1::FetchRequest { scene_hash: scene_hash_bytes(reference.hash) };
    let text = |status: tonic::Status| status.message().to_owned();
    let mut chunks = ScenesClient::new(coordinator).fetch(request).await.map_err(text)?.into_inner();
    let mut assembler = SceneFilesAssembler::new(reference.hash, node.config.max_bundle_bytes);
    while let Some(chunk) = chunks.message().await.map_err(text)? {
        if let Some(bundle) = assembler.push(chunk).map_err(|e| e.to_string())? {
            return Ok(bundle);
        }
    }
    Err("the stream ended before the bundle's end".to_owned())
}
