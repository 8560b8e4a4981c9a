//! The coordinator's shell: sockets and clocks around [`crate::core`].
//!
//! A view arrives at `views`, in a `batch`, or in a `session` of a moving camera, whose messages wait in `inbox`.
//! `drive` drives `view_path`, the pure state machine of a view. `view_handle` connects a view to the core, `relayed`
//! tracks which part of a frame the client has, `redirect` sends clients to workers with `tickets`, and `memory`
//! holds a session's last view.
//!
//! `shared_core` holds the core behind a lock. Workers join at `cluster` and fetch the scene from `scenes`. `lead`
//! keeps the lease. `monitor` and `frame_metrics` serve metrics and probes.

mod batch;
mod checks;
mod cluster;
mod config;
mod drive;
mod failure;
mod frame_metrics;
mod inbox;
mod lead;
mod memory;
mod monitor;
mod planning_time;
mod redirect;
mod relayed;
mod scenes;
mod session;
mod shared_core;
mod surveys;
mod tickets;
mod view_handle;
mod view_path;
mod view_request;
mod views;

use std::sync::Arc;
use std::time::Duration;

use argus_proto::FILE_DESCRIPTOR_SET;
use argus_proto::v1::cluster_server::ClusterServer;
use argus_proto::v1::scenes_server::ScenesServer;
use argus_proto::v1::views_server::ViewsServer;
use argus_scene::rig::Sight;
use argus_scene::{
    EffectPlan, EffectRequest, Exposure, InvalidField, Lighting, Metering, ReflectionProbeSet,
    ReflectionRequest, Rig, SampleSetInfo, Sampling, Version, Visibility, check_sub_samples,
};
use tokio_util::sync::CancellationToken;
use tonic::server::NamedService;
use tonic::service::Routes;
use tracing::info;

pub use config::{Config, ServeError};
#[cfg(feature = "fuzzing")]
pub(crate) use inbox::check_inbox;

use self::shared_core::SharedCore;
use crate::core::{Core, Event};
use crate::incoming::incoming;
use crate::leadership::Registry;
use crate::net;
use crate::network::Accept;
use crate::observe::{keep_health, with_pages};
use crate::security::guard::Guarded;
use crate::wire::ServiceInfo;
use crate::{SceneRef, SceneSource};

/// The reflections that are possible with a sampling.
///
/// # Errors
/// Reflections were asked for by name, and the sampling has none.
fn reflections_with(request: ReflectionRequest, sampling: Sampling) -> Result<ReflectionRequest, ServeError> {
    match (sampling, request) {
        (Sampling::Triangles, request) => Ok(request),
        (Sampling::MegaViews(_), ReflectionRequest::Off | ReflectionRequest::Auto(_)) => {
            Ok(ReflectionRequest::Off)
        }
        (Sampling::MegaViews(_), ReflectionRequest::By(_)) => {
            let reason =
                "maps are looked up by samples from triangles, and megaviews has none: take one of the two";
            Err(ServeError::Sampling(InvalidField::new("reflections", reason)))
        }
    }
}

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
    let scene = source.scene();
    let rig = Rig::for_scene(scene, &config.rig)?;
    config.sampling.validate(&rig).map_err(ServeError::Sampling)?;
    check_sub_samples(config.sub_samples).map_err(ServeError::Sampling)?;
    config.indirect.map_or(Ok(()), |indirect| indirect.validate()).map_err(ServeError::Sampling)?;
    let mut request = EffectRequest {
        effects: config.effects,
        indirect: config.indirect,
        reflections: reflections_with(config.reflections, config.sampling)?,
        exposure: None,
    };
    let (sight, exposure) = look(&source, config.exposure, request.metering()).await;
    request.exposure = Some(exposure);
    // Once for the sample set: its light passes are built from this plan alone.
    let effect_plan = EffectPlan::of(scene, &request, None);
    let (effects, indirect) = (effect_plan.light_effects(), effect_plan.indirect(&request));
    indirect.check_effects(effects).map_err(ServeError::Sampling)?;
    // A scene that stands still has epochs, too, if its lights drift or if it is sampled anew for every so many
    // views.
    let moves = scene.is_animated() || indirect.drifts() || config.core.refresh_views > 0;
    let mut set = SampleSetInfo {
        scene: scene.hash,
        bounds: scene.bounds(),
        rig,
        version: Version::default(),
        epoch_secs: match moves {
            true => epoch_secs(&config).map_err(ServeError::Time)?,
            false => 0.0,
        },
        lighting: Lighting { exposure, ..scene.lighting.clone() },
        // The configuration's backend; the core replaces it if it is measured.
        visibility: Visibility::default(),
        sampling: config.sampling,
        sub_samples: config.sub_samples,
        effects,
        indirect,
        reflections: match effect_plan.reflections(scene, &request) {
            Some(knobs) => ReflectionProbeSet::of(scene, &rig, knobs).map_err(ServeError::Sampling)?,
            None => None,
        },
    };
    set.version.state.light = set.first_light();
    let set = Arc::new(set);
    let service = ServiceInfo {
        scene: SceneRef { name: scene.name.clone(), hash: scene.hash },
        limits: config.core.limits,
        report_interval: config.core.report_interval,
    };
    let address = listener.local_addr()?;
    info!(%address, scene = scene.name, %effects, %indirect, exposure, "coordinator serves");
    let (core, models) = (config.core.clone(), config.models.clone());
    // Tile cameras see everything from above. In an animated scene, occluders move.
    let chooses = matches!(rig, Rig::Cell { .. }) && !scene.is_animated();
    let chosen_by = sight.clone().filter(|_| chooses);
    let fresh = move || {
        Core::new(core.clone(), set.clone()).with_models(models.clone()).with_sight(chosen_by.clone())
    };
    let shared = Arc::new(SharedCore::new(&config, fresh, source, sight, service));
    let reached_at = config
        .advertise
        .clone()
        .unwrap_or_else(|| format!("{}://{address}", net::scheme(config.security.as_deref())));

    let (health, health_service) = tonic_health::server::health_reporter();
    // Workers can join and fetch the scene before any view can be answered.
    health.set_serving::<ClusterServer<cluster::ClusterService>>().await;
    health.set_serving::<ScenesServer<scenes::ScenesService>>().await;
    let monitor = Arc::new(monitor::Monitor(shared.clone()));
    let kept = keep_health(monitor.clone(), health, &[ViewsServer::<views::ViewsService>::NAME]).await;
    let reflection = tonic_reflection::server::Builder::configure()
        .register_encoded_file_descriptor_set(FILE_DESCRIPTOR_SET)
        .register_encoded_file_descriptor_set(tonic_health::pb::FILE_DESCRIPTOR_SET)
        .build_v1()?;

    let draining = {
        let (shared, shutdown, grace) = (shared.clone(), shutdown.clone(), config.grace);
        async move {
            shutdown.cancelled().await;
            info!("coordinator drains");
            shared.step(Event::Drain);
            let idle = async {
                while shared.read(|core| core.views_in_flight()) > 0 {
                    tokio::time::sleep(Duration::from_millis(10)).await;
                }
            };
            // What is not done within the grace period is cancelled. The client library then retries.
            let _ = tokio::time::timeout(grace, idle).await;
            shared.closing.cancel();
        }
    };
    let views = ViewsServer::new(views::ViewsService::new(shared.clone(), effect_plan));
    let services = Routes::new(views.max_decoding_message_size(config.max_request_bytes))
        .add_service(ClusterServer::new(cluster::ClusterService { shared: shared.clone() }))
        .add_service(ScenesServer::new(scenes::ScenesService::new(shared.clone())))
        .add_service(health_service.max_decoding_message_size(net::MOST_QUESTION_BYTES))
        .add_service(reflection.max_decoding_message_size(net::MOST_QUESTION_BYTES));
    let server = net::server(Guarded::Coordinator, config.security.as_ref())?
        .add_routes(with_pages(services, monitor, shared.frame_metrics.registry()))
        .serve_with_incoming_shutdown(incoming(listener, config.max_connections), draining);
    let cut_off = async {
        shared.closing.cancelled().await;
        tokio::time::sleep(Duration::from_secs(1)).await;
    };
    let served = tokio::select! {
        served = server => served,
        () = tick(&shared, &config) => Ok(()),
        () = kept => Ok(()),
        () = lead::lead(&shared, &registry, &reached_at) => Ok(()),
        () = cut_off => Ok(()),
    };
    lead::give_up(&shared, registry.as_ref()).await;
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

/// Ray queries into the scene, without which views are planned by distance, and the exposure of all views.
async fn look(
    source: &Arc<dyn SceneSource>,
    exposure: Exposure,
    metering: Metering,
) -> (Option<Arc<dyn Sight>>, f32) {
    let own = source.scene().lighting.exposure;
    let source = source.clone();
    let looked = tokio::task::spawn_blocking(move || {
        let metered = if exposure == Exposure::Auto { source.metered(metering) } else { None };
        (source.sight(), exposure.factor(own, metered))
    });
    looked.await.unwrap_or_else(|_| (None, exposure.factor(own, None)))
}

/// Sends the core its ticks, ten times a tick and at least ten times a second.
async fn tick(shared: &SharedCore, config: &Config) {
    // An epoch begins at most a fifth of its duration late.
    let finest =
        if shared.read(|core| core.set().epoch_secs > 0.0) { config.core.epoch / 5 } else { Duration::MAX };
    let period = (config.core.tick / 10).min(finest);
    let period = period.clamp(Duration::from_millis(5), Duration::from_millis(100));
    let mut interval = tokio::time::interval(period);
    interval.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
    loop {
        interval.tick().await;
        shared.step(Event::Tick);
        shared.frame_metrics.ticked();
        shared.channels.close_unused();
    }
}

/// Scene seconds from one epoch to the next.
fn epoch_secs(config: &Config) -> Result<f64, InvalidField> {
    let secs = config.core.epoch.as_secs_f64() * config.time_scale;
    // Written so that NaN is refused.
    match (0.0..=86400.0).contains(&secs) {
        true => Ok(secs),
        false => Err(InvalidField::new("time_scale", format!("must be 0 to a day an epoch, not {secs} s"))),
    }
}
