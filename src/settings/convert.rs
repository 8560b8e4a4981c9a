//! Converts settings to the configuration of each part, and checks their ranges.

use std::io::Write as _;
use std::time::Duration;

use argus_cluster::leadership::nats_host;
use argus_cluster::{coordinator, core, worker};
use argus_scene::{MegaViews, ProbeSource, ReflectionRequest, Reflections, Sampling};
use tempfile::{Builder, NamedTempFile};

use super::{Coordinator, HAS_PAPERS, Limits, Settings, Worker};

/// The longest duration that can be set, in seconds: one year, which every clock can represent.
const MOST_SECS: f64 = 31_536_000.0;

impl Settings {
    /// Writes the settings to a private file, for another process of this machine. It is removed when dropped.
    ///
    /// # Errors
    /// The folder of temporary files cannot be written to.
    pub(crate) fn to_file(&self) -> anyhow::Result<NamedTempFile> {
        let mut file = Builder::new().prefix("argus-").suffix(".toml").tempfile()?;
        file.write_all(toml::to_string(self)?.as_bytes())?;
        Ok(file)
    }

    /// The first setting out of its range, and the reason.
    pub(super) fn out_of_range(&self) -> Option<(&'static str, String)> {
        let Self { coordinator, worker, limits, .. } = self;
        // Written so that NaN is rejected.
        let within = |key, value: f64, least: f64, most: f64| {
            let fits = value >= least && value <= most;
            (!fits).then(|| (key, format!("must be {least} to {most}, not {value}")))
        };
        let some = |key, value: u64| (value == 0).then(|| (key, "must be at least 1".to_owned()));
        let rate = |key, value: Option<f64>| value.and_then(|value| within(key, value, 1.0, 1e15));
        let patience = |key, secs: Option<f64>| secs.and_then(|secs| within(key, secs, 0.0, MOST_SECS));
        [
            coordinator.sampling().is_none().then(|| {
                let names = Sampling::NAMES.join(" or ");
                ("coordinator.sampling", format!("must be {names}, not {:?}", coordinator.sampling))
            }),
            lacks(coordinator.sampling != "triangles", "coordinator.sampling", &coordinator.sampling),
            within("coordinator.map_side", coordinator.map_side.into(), 8.0, 1024.0),
            within("coordinator.octree_levels", coordinator.octree_levels.into(), 1.0, 10.0),
            (![1, 2, 4].contains(&coordinator.map_block)).then(|| {
                ("coordinator.map_block", format!("must be 1, 2 or 4, not {}", coordinator.map_block))
            }),
            coordinator.reflections().is_err().then(|| {
                (
                    "coordinator.reflections",
                    format!("must be auto, off, maps, points or rays, not {:?}", coordinator.reflections),
                )
            }),
            lacks(
                ["maps", "points"].contains(&coordinator.reflections.as_str()),
                "coordinator.reflections",
                &coordinator.reflections,
            ),
            coordinator.reflections_error(),
            within("coordinator.refining_share", coordinator.refining_share, 0.0, 1.0),
            within("coordinator.epoch_ms", coordinator.epoch_ms, 1e-3, 1e3 * MOST_SECS),
            within("coordinator.time_scale", coordinator.time_scale, 0.0, 1e6),
            within("coordinator.lease_secs", coordinator.lease_secs, 1.0, MOST_SECS),
            // The reason does not repeat the URL, which may hold a password.
            coordinator.registry.as_ref().and_then(|url| {
                nats_host(url).err().map(|reason| ("coordinator.registry", reason.to_owned()))
            }),
            within("coordinator.registry_lease_secs", coordinator.registry_lease_secs, 0.5, 3600.0),
            within("coordinator.grace_secs", coordinator.grace_secs, 0.0, MOST_SECS),
            within("worker.grace_secs", worker.grace_secs, 0.0, MOST_SECS),
            patience("coordinator.registry_wait_secs", coordinator.registry_wait_secs),
            patience("worker.coordinator_wait_secs", worker.coordinator_wait_secs),
            within("worker.rest_secs", worker.rest_secs, 1.0, MOST_SECS),
            within("limits.view_secs", limits.view_secs, 1.0, MOST_SECS),
            within("limits.read_secs", limits.read_secs, 1.0, 3600.0),
            within("limits.wait_secs", limits.wait_secs, 0.0, MOST_SECS),
            rate("limits.pixels_per_sec", limits.pixels_per_sec),
            rate("limits.pixels_per_sec_per_client", limits.pixels_per_sec_per_client),
            some("worker.samples_mib", worker.samples_mib),
            some("worker.gpu_samples_mib", worker.gpu_samples_mib),
            some("worker.queued_views", worker.queued_views as u64),
            some("worker.queued_samples", worker.queued_samples as u64),
            some("worker.frames_mib", worker.frames_mib),
            some("worker.requests", worker.requests as u64),
            some("worker.connections", worker.connections as u64),
            some("limits.views_per_worker", limits.views_per_worker as u64),
            some("worker.bundle_mib", worker.bundle_mib),
            some("limits.views", limits.views as u64),
            some("limits.views_per_client", limits.views_per_client as u64),
            some("limits.sessions", limits.sessions as u64),
            some("limits.sessions_per_client", limits.sessions_per_client as u64),
            some("limits.connections", limits.connections as u64),
            some("limits.request_kib", limits.request_kib as u64),
            some("limits.view_side", limits.view_side.into()),
            some("limits.view_pixels", limits.view_pixels),
        ]
        .into_iter()
        .flatten()
        .next()
    }
}

/// Why a setting cannot be what it is, if it asks for a method of papers and this build has none.
fn lacks(asks: bool, key: &'static str, name: &str) -> Option<(&'static str, String)> {
    (asks && !HAS_PAPERS).then(|| (key, argus_sampler::plug::missing(key, name).reason))
}

/// The duration of a checked number of seconds.
pub(crate) fn secs(secs: f64) -> Duration {
    Duration::try_from_secs_f64(secs).unwrap_or(Duration::MAX)
}

/// MiB in bytes.
pub(crate) fn mib(mib: u64) -> u64 {
    mib.saturating_mul(1 << 20)
}

impl Coordinator {
    /// What samples are rendered from; `None` for an unknown name.
    pub(crate) fn sampling(&self) -> Option<Sampling> {
        let maps = MegaViews { map_side: self.map_side, levels: self.octree_levels, block: self.map_block };
        let all = [Sampling::Triangles, Sampling::MegaViews(maps)];
        all.into_iter().find(|sampling| sampling.name() == self.sampling)
    }

    /// How reflections are found.
    ///
    /// # Errors
    /// An unknown name.
    pub(crate) fn reflections(&self) -> Result<ReflectionRequest, ()> {
        let [maps, points, rays] = self.reflection_sources();
        match self.reflections.as_str() {
            "auto" if !HAS_PAPERS => Ok(ReflectionRequest::Auto([rays; 3])),
            "auto" => Ok(ReflectionRequest::Auto([maps, points, rays])),
            "off" => Ok(ReflectionRequest::Off),
            "maps" => Ok(ReflectionRequest::By(maps)),
            "points" => Ok(ReflectionRequest::By(points)),
            "rays" => Ok(ReflectionRequest::By(rays)),
            _ => Err(()),
        }
    }

    /// The settings of reflection probes, from each source: maps, points, rays.
    fn reflection_sources(&self) -> [Reflections; 3] {
        let octree = ProbeSource::Octree { levels: self.reflection_levels };
        let points = ProbeSource::Points { budget: self.reflection_points };
        let (side, most) = (self.reflection_side, self.reflectors);
        [octree, points, ProbeSource::Rays].map(|source| Reflections { side, most, source })
    }

    /// The first invalid setting of reflection probes, by its setting.
    fn reflections_error(&self) -> Option<(&'static str, String)> {
        let invalid = self.reflection_sources().iter().find_map(|settings| settings.validate().err())?;
        let key = match invalid.field {
            "reflections.side" => "coordinator.reflection_side",
            "reflections.levels" => "coordinator.reflection_levels",
            "reflections.points" => "coordinator.reflection_points",
            _ => "coordinator.reflectors",
        };
        Some((key, invalid.reason))
    }

    /// The coordinator's configuration.
    pub(crate) fn config(&self, limits: &Limits) -> coordinator::Config {
        let core = core::Config {
            samplers_composite: self.samplers_composite,
            refining_share: self.refining_share,
            epoch: secs(self.epoch_ms * 1e-3),
            lease: secs(self.lease_secs),
            // Twenty reports per lease, as by default, so that a late report is not taken for a lost worker.
            report_interval: (secs(self.lease_secs) / 20).min(core::Config::default().report_interval),
            max_views: limits.views,
            max_views_per_client: limits.views_per_client,
            max_sessions: limits.sessions,
            max_sessions_per_client: limits.sessions_per_client,
            pixels_per_sec: limits.pixels_per_sec,
            pixels_per_sec_per_client: limits.pixels_per_sec_per_client,
            max_views_per_worker: limits.views_per_worker,
            max_view_time: secs(limits.view_secs),
            refining_bytes: mib(self.refining_mib),
            max_wait: secs(limits.wait_secs),
            limits: argus_scene::Limits { max_side: limits.view_side, max_pixels: limits.view_pixels },
            ..core::Config::default()
        };
        let (time_scale, grace) = (self.time_scale, secs(self.grace_secs));
        coordinator::Config {
            core,
            sampling: self.sampling().unwrap_or_default(),
            reflections: self.reflections().unwrap_or(ReflectionRequest::Off),
            time_scale,
            grace,
            max_connections: limits.connections,
            read_within: secs(limits.read_secs),
            max_request_bytes: limits.request_kib.saturating_mul(1 << 10),
            ..coordinator::Config::default()
        }
    }
}

impl Worker {
    /// The worker's configuration, for the coordinator at that address.
    pub(crate) fn config(&self, coordinator: String, limits: &Limits) -> worker::Config {
        worker::Config {
            advertise: self.advertise.clone(),
            public: self.public_address.as_ref().map(|address| match address.as_str() {
                "advertised" => worker::Public::AsAdvertised,
                _ => worker::Public::At(address.clone()),
            }),
            held_bytes: mib(self.samples_mib),
            max_queued_views: self.queued_views,
            max_queued_samples: self.queued_samples,
            frame_bytes: mib(self.frames_mib),
            history_bytes: mib(self.history_mib),
            source_bytes: mib(self.sources_mib),
            read_within: secs(limits.read_secs),
            max_requests: self.requests,
            max_connections: self.connections,
            rest_after: secs(self.rest_secs),
            give_up_after: self.coordinator_wait_secs.map(secs),
            max_bundle_bytes: mib(self.bundle_mib),
            grace: secs(self.grace_secs),
            ..worker::Config::new(coordinator)
        }
    }
}
