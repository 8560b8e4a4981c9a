//! One scene of a service: its core, and what clients are told of it.

use std::sync::Arc;

use argus_proto::{Description, check_scene_name};
use argus_scene::scene::NamedCamera;
use argus_scene::{EffectPlan, InvalidField, PlanRequest, Rig, Search};
use tokio_util::sync::CancellationToken;

use super::client_metrics::ClientMetrics;
use super::config::{Config, ServeError};
use super::frame_metrics::FrameMetrics;
use super::node_names::NodeNames;
use super::prepare::Prepared;
use super::shared_core::{ProcessParts, SharedCore};
use crate::core::Core;
use crate::wire::ServiceInfo;
use crate::{SceneRef, SceneSource};

/// A scene that was prepared by the coordinator's configuration.
pub struct SceneToServe {
    /// The name by which requests choose it, unlike those of all others, and valid by [`argus_proto::check_scene_name`].
    pub name: String,
    /// The scene.
    pub source: Arc<dyn SceneSource>,
    /// What the configuration makes of it.
    pub prepared: Prepared,
}

/// One scene of a service.
pub(super) struct ServedScene {
    /// The name by which requests choose it.
    pub(super) name: String,
    pub(super) shared: Arc<SharedCore>,
    /// The description before anything was measured.
    pub(super) description: Description,
    pub(super) nodes: NodeNames,
}

impl ServedScene {
    /// A scene of a service whose scenes have the names `all`.
    pub(super) fn new(
        name: String,
        shared: Arc<SharedCore>,
        effect_plan: EffectPlan,
        all: Vec<String>,
    ) -> Self {
        let scene = shared.source.scene();
        let (config, set) = shared.read(|core| (core.config().clone(), core.set().clone()));
        let mut cameras: Vec<NamedCamera> =
            scene.cameras.iter().filter(|named| named.camera.validate().is_ok()).cloned().collect();
        if cameras.is_empty() {
            cameras.push(NamedCamera { name: "default".to_owned(), camera: scene.default_camera() });
        }
        let search = Search::default();
        let description = Description {
            scene_name: scene.name.clone(),
            scene_hash: scene.hash,
            bounds: set.extent,
            triangles: scene.triangles() as u64,
            effects: scene.effects(),
            effect_plan,
            cameras,
            limits: config.limits,
            rig: set.rig,
            epoch_secs: set.epoch_secs,
            first_light: set.first_light(),
            light: shared.source.light().unwrap_or_default(),
            defaults: PlanRequest {
                direct: false,
                search: Some(search),
                steps: Some(config.steps_of(search)),
                supersampling: Some(1),
                samples: Some(config.samples_per_view),
                ..PlanRequest::default()
            },
            scenes: all,
        };
        let nodes = NodeNames::new(scene);
        Self { name, shared, description, nodes }
    }
}

/// The scenes with their cores, which do not lead yet.
///
/// # Errors
/// [`ServeError::Scene`].
pub(super) async fn served_scenes(
    config: &Config,
    scenes: Vec<SceneToServe>,
) -> Result<Vec<ServedScene>, ServeError> {
    let names: Vec<String> = scenes.iter().map(|scene| scene.name.clone()).collect();
    check_names(&names).map_err(ServeError::Scene)?;
    check_files(&scenes).map_err(ServeError::Scene)?;
    let parts = ProcessParts {
        client_metrics: Arc::new(ClientMetrics::new(config.security.clone())),
        frame_metrics: FrameMetrics::default(),
        closing: CancellationToken::new(),
    };
    let mut served = Vec::new();
    for SceneToServe { name, source, prepared } in scenes {
        let Prepared { set, effect_plan } = prepared;
        let scene = source.scene().clone();
        let sight = {
            let source = source.clone();
            tokio::task::spawn_blocking(move || source.sight()).await.ok().flatten()
        };
        let service = ServiceInfo {
            scene: SceneRef { name: scene.name.clone(), hash: scene.hash },
            limits: config.core.limits,
            report_interval: config.core.report_interval,
        };
        let (core, models) = (config.core.clone(), config.models.clone());
        // Tile cameras see everything from above. In an animated scene, occluders move.
        let chooses = matches!(set.rig, Rig::Cell { .. }) && !scene.is_animated();
        let chosen_by = sight.filter(|_| chooses);
        let set = Arc::new(set);
        let fresh = move || {
            Core::new(core.clone(), set.clone()).with_models(models.clone()).with_sight(chosen_by.clone())
        };
        let mut parts = parts.clone();
        if names.len() > 1 {
            parts.frame_metrics = parts.frame_metrics.of_scene(&name);
        }
        let shared = Arc::new(SharedCore::new(config, fresh, source, service, parts));
        served.push(ServedScene::new(name, shared, effect_plan, names.clone()));
    }
    Ok(served)
}

/// Checks the names of a service's scenes.
///
/// # Errors
/// The field `scene`.
fn check_names(names: &[String]) -> Result<(), InvalidField> {
    if names.is_empty() {
        return Err(InvalidField::new("scene", "a service needs at least one"));
    }
    for (at, name) in names.iter().enumerate() {
        check_scene_name(name)?;
        if names[..at].contains(name) {
            let reason = format!("two scenes are named {name}: give them different names by NAME=FILE");
            return Err(InvalidField::new("scene", reason));
        }
    }
    Ok(())
}

/// Checks that no scene is there twice: workers know scenes by their hashes.
///
/// # Errors
/// The field `scene`.
fn check_files(scenes: &[SceneToServe]) -> Result<(), InvalidField> {
    for (at, scene) in scenes.iter().enumerate() {
        let hash = scene.source.scene().hash;
        if let Some(same) = scenes[..at].iter().find(|other| other.source.scene().hash == hash) {
            let reason = format!("{} and {} are the same scene: give it once", same.name, scene.name);
            return Err(InvalidField::new("scene", reason));
        }
    }
    Ok(())
}
