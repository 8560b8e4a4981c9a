//! The coordinator's shell: sockets and clocks around [`crate::core`].
//!
//! A view arrives at `views`, in a `batch`, or in a `session` of a moving camera, whose messages wait in `inbox`.
//! `drive` drives `view_path`, the pure state machine of a view. `view_handle` connects a view to the core, `relayed`
//! tracks which part of a frame the client has, `redirect` sends clients to workers with `tickets`, and `memory`
//! holds a session's last view.
//!
//! `set_transforms` moves nodes: `movers` are their transforms, and `node_names` finds them.
//!
//! `shared_core` holds the core of a scene behind a lock. `scene_table` holds all scenes, chooses the one that a request names, and
//! gives workers to them; `served_scene` is one scene with its description. Workers join at `cluster` and fetch the scene from
//! `scenes`. `lead` keeps the lease. `monitor`, `frame_metrics` and `client_metrics` serve metrics and probes.

mod batch;
mod checks;
mod client_metrics;
mod cluster;
mod config;
mod drive;
mod failure;
mod frame_metrics;
mod inbox;
mod lead;
mod memory;
mod monitor;
mod movers;
mod names;
mod node_names;
mod planning_time;
mod prepare;
mod redirect;
mod relayed;
mod scene_table;
mod scenes;
mod served_scene;
mod session;
mod set_transforms;
mod shared_core;
mod tickets;
mod view_handle;
mod view_path;
mod view_request;
mod views;

use std::sync::Arc;
use std::time::Duration;

use argus_proto::v1::cluster_server::ClusterServer;
use argus_proto::v1::scenes_server::ScenesServer;
use argus_proto::v1::views_server::ViewsServer;
use argus_proto::{FILE_DESCRIPTOR_SET, scene_name_like};
use tokio_util::sync::CancellationToken;
use tonic::server::NamedService;
use tonic::service::Routes;
use tracing::info;

pub use config::{Config, ServeError};
#[cfg(feature = "fuzzing")]
pub(crate) use inbox::check_inbox;
pub use prepare::{Prepared, prepare};
pub use served_scene::SceneToServe;

use self::scene_table::SceneTable;
use self::served_scene::{ServedScene, served_scenes};
use crate::SceneSource;
use crate::core::{Core, Event};
use crate::incoming::incoming;
use crate::leadership::Registry;
use crate::net;
use crate::network::Accept;
use crate::observe::{keep_health, with_pages};
use crate::security::guard::Guarded;
use crate::security::handshake::secured;

/// Serves `Views`, `Cluster`, `Scenes`, health and reflection on `listener` until `shutdown` is cancelled. Then it
/// refuses new requests, lets those in flight finish for [`Config::grace`], and returns.
///
/// While another coordinator holds the lease of `registry`, this one is on standby and refuses workers and views.
///
/// # Errors
/// [`ServeError`]. An invalid scene or option is found before anything is served.
pub async fn serve(
    config: Config,
    listener: impl Accept,
    source: Arc<dyn SceneSource>,
    registry: Arc<dyn Registry>,
    shutdown: CancellationToken,
) -> Result<(), ServeError> {
    let prepared = {
        let (config, source) = (config.clone(), source.clone());
        tokio::task::spawn_blocking(move || prepare(&config, source.as_ref()))
    };
    let prepared = prepared.await.map_err(|error| ServeError::Listener(std::io::Error::other(error)))??;
    let scene = SceneToServe { name: scene_name_like(&source.scene().name), source, prepared };
    serve_prepared(config, vec![scene], listener, registry, shutdown, CancellationToken::new()).await
}

/// Serves scenes that are prepared by this configuration, like [`serve`]; the first one is that of requests that name none. Cancels
/// `answers` once the first view can come: a worker of a scene can answer views, and knows what they cost.
///
/// # Errors
/// [`ServeError`]: [`ServeError::Scene`] without a scene, for a name that is not valid, and for one that two scenes have.
pub async fn serve_prepared(
    config: Config,
    scenes: Vec<SceneToServe>,
    listener: impl Accept,
    registry: Arc<dyn Registry>,
    shutdown: CancellationToken,
    answers: CancellationToken,
) -> Result<(), ServeError> {
    let address = listener.local_addr()?;
    let scenes = Arc::new(SceneTable::new(served_scenes(&config, scenes).await?));
    for scene in scenes.all() {
        let set = scene.shared.read(|core| core.set().clone());
        let (effects, indirect, exposure) = (set.effects, set.indirect, set.lighting.exposure);
        let file = &scene.shared.service.scene.name;
        info!(%address, scene = file, name = scene.name, %effects, %indirect, exposure, "coordinator serves");
    }
    let reached_at = config
        .advertise
        .clone()
        .unwrap_or_else(|| format!("{}://{address}", net::scheme(config.security.as_deref())));

    let (health, health_service) = tonic_health::server::health_reporter();
    // Workers can join and fetch the scene before any view can be answered.
    health.set_serving::<ClusterServer<cluster::ClusterService>>().await;
    health.set_serving::<ScenesServer<scenes::ScenesService>>().await;
    let monitor = Arc::new(monitor::Monitor(scenes.clone()));
    let kept = keep_health(monitor.clone(), health, &[ViewsServer::<views::ViewsService>::NAME]).await;
    let reflection = tonic_reflection::server::Builder::configure()
        .register_encoded_file_descriptor_set(FILE_DESCRIPTOR_SET)
        .register_encoded_file_descriptor_set(tonic_health::pb::FILE_DESCRIPTOR_SET)
        .build_v1()?;

    let first = scenes.first().shared.clone();
    let draining = {
        let (scenes, closing, shutdown, grace) =
            (scenes.clone(), first.closing.clone(), shutdown.clone(), config.grace);
        async move {
            shutdown.cancelled().await;
            info!("coordinator drains");
            scenes.step_all(&Event::Drain);
            let idle = async {
                while scenes.views_in_flight() > 0 {
                    tokio::time::sleep(Duration::from_millis(10)).await;
                }
            };
            // What is not done within the grace period is cancelled. The client library then retries.
            let _ = tokio::time::timeout(grace, idle).await;
            closing.cancel();
        }
    };
    let views = ViewsServer::new(views::ViewsService { scenes: scenes.clone() });
    let services = Routes::new(views.max_decoding_message_size(config.max_request_bytes))
        .add_service(ClusterServer::new(cluster::ClusterService { scenes: scenes.clone() }))
        .add_service(ScenesServer::new(scenes::ScenesService::new(scenes.clone())))
        .add_service(health_service.max_decoding_message_size(net::MOST_QUESTION_BYTES))
        .add_service(reflection.max_decoding_message_size(net::MOST_QUESTION_BYTES));
    let connections = secured(incoming(listener, config.max_connections), config.security.clone());
    let server = net::server(Guarded::Coordinator, config.security.as_ref())
        .add_routes(with_pages(services, monitor, first.frame_metrics.registry()))
        .serve_with_incoming_shutdown(connections, draining);
    let cut_off = async {
        first.closing.cancelled().await;
        tokio::time::sleep(Duration::from_secs(1)).await;
    };
    let served = tokio::select! {
        served = server => served,
        () = tick(&scenes, &config, &answers) => Ok(()),
        () = kept => Ok(()),
        () = lead::lead(&scenes, &registry, &reached_at) => Ok(()),
        () = cut_off => Ok(()),
    };
    lead::give_up(&scenes, registry.as_ref()).await;
    served?;
    info!("coordinator stopped");
    Ok(())
}

/// Processes the header of a redirected frame, for fuzzing. Returns the pixels that no sample saw, and the
/// milliseconds of rendering.
#[cfg(feature = "fuzzing")]
pub(crate) fn learn(header: &argus_proto::v1::FrameHeader) -> (u64, f64) {
    let frames = frame_metrics::FrameMetrics::default();
    frames.arrived(header);
    frames.registry();
    (relayed::uncovered(header), relayed::rendering_ms(header))
}

/// Sends the cores their ticks, ten times a tick and at least ten times a second. Cancels `answers` once one of them is ready for load.
async fn tick(scenes: &SceneTable, config: &Config, answers: &CancellationToken) {
    let moves = |scene: &ServedScene| scene.shared.read(|core| core.set().epoch_secs > 0.0);
    // An epoch begins at most a fifth of its duration late.
    let finest = if scenes.all().iter().any(moves) { config.core.epoch / 5 } else { Duration::MAX };
    let period = (config.core.tick / 10).min(finest);
    let period = period.clamp(Duration::from_millis(5), Duration::from_millis(100));
    let mut interval = tokio::time::interval(period);
    interval.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
    loop {
        interval.tick().await;
        for scene in scenes.all() {
            let shared = &scene.shared;
            shared.step(Event::Tick);
            if !answers.is_cancelled() && shared.read(Core::is_ready_for_load) {
                answers.cancel();
            }
            shared.frame_metrics.ticked();
            shared.channels.close_unused();
        }
        scenes.balance();
    }
}
