//! The configuration: all settings and their defaults.
//!
//! A setting is a section and a key, such as `limits.views`. In rising precedence it comes from the default below, from
//! the file (`--config`, else `ARGUS_CONFIG`, else `argus.toml` in the current folder), from the environment
//! (`ARGUS_LIMITS__VIEWS`) and from flags (its own, or `--set limits.views=…`). `layers.rs` merges them; `argus config`
//! prints the result. `docs/argus.toml` explains each setting to users.

mod convert;
mod layers;

use std::path::PathBuf;

use argus_scene::{MegaViews, ProbeSource, Reflections, Sampling};
use serde::{Deserialize, Serialize};

pub(crate) use convert::{mib, secs};
pub(crate) use layers::{Flags, Sources, path, variables};

/// Whether this build has the methods of papers.
pub(crate) const HAS_PAPERS: bool = cfg!(feature = "papers");

/// All settings. Units are in the names.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct Settings {
    pub(crate) client: Client,
    pub(crate) coordinator: Coordinator,
    pub(crate) worker: Worker,
    pub(crate) limits: Limits,
    pub(crate) security: Security,
}

/// How client subcommands reach a service.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct Client {
    /// The service's address: `https://` if it has a certificate.
    pub(crate) server: String,
    /// PEM file of the authority that signed the service's certificate.
    pub(crate) ca: Option<PathBuf>,
    /// File with this client's token only.
    pub(crate) token_file: Option<PathBuf>,
    /// PEM file of a client certificate, for services that require one.
    pub(crate) certificate: Option<PathBuf>,
    /// PEM file of the client certificate's private key.
    pub(crate) key: Option<PathBuf>,
    /// Name of the scene, of a service with several; unset: its first one.
    pub(crate) scene: Option<String>,
}

impl Default for Client {
    fn default() -> Self {
        let server = "http://127.0.0.1:7400".to_owned();
        Self { server, ca: None, token_file: None, certificate: None, key: None, scene: None }
    }
}

/// What a coordinator serves, and how it decides.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct Coordinator {
    /// A file, `terrain[:TRIANGLES]`, `mirrors[:BALLS]` or `rooms[:WALL_MM]`, and `+balls:N` after it for mirroring
    /// balls. Set here or by a flag, never by a request.
    pub(crate) scene: Option<String>,
    /// Further scenes of the service, written the same way. Any of them may be `NAME=SCENE`.
    pub(crate) more_scenes: Vec<String>,
    /// File of an environment map in place of the scene's sky.
    pub(crate) environment: Option<String>,
    /// Address to listen on. The default is local: other machines require TLS.
    pub(crate) listen: String,
    /// Whether idle samplers also compose views, which saves a fifth of the time on two workers.
    pub(crate) samplers_composite: bool,
    /// What samples are rendered from: `triangles`, or `megaviews`, maps of a scene octree.
    pub(crate) sampling: String,
    /// Side of a map's hemisphere in texels. Its texels are about as wide as those of a cube face with half the side.
    pub(crate) map_side: u32,
    /// Levels of the octree; the default gives cells of about a thousandth of the scene.
    pub(crate) octree_levels: u32,
    /// Cameras along an edge of a block that shares parts of its maps. 1 by default: at this resolution, neighbours
    /// of a lattice have little in common.
    pub(crate) map_block: u32,
    /// Reflections of glossy and transparent objects: `off` (the sky only), from an octree (`maps`), by points (`points`), by
    /// rays (`rays`), or the cheapest of these where the scene calls for them (`auto`).
    pub(crate) reflections: String,
    /// Side of a reflection probe in texels; the default gives texels of about three degrees.
    pub(crate) reflection_side: u32,
    /// Levels of the octree that probes are rendered from; the default gives cells of about a 250th of the scene.
    pub(crate) reflection_levels: u32,
    /// Most points that fill probes at once; the default takes 32 MiB.
    pub(crate) reflection_points: u32,
    /// Largest number of objects with a probe, the largest objects first; a probe takes 50 KiB.
    pub(crate) reflectors: u32,
    /// Share of the samplers' time for samples where views have holes. These wait for all other work, so a half costs
    /// other views little.
    pub(crate) refining_share: f64,
    /// File of a calibrated model, in place of the one that `argus-lab study views bounds` kept on this machine.
    pub(crate) model: Option<PathBuf>,
    /// Shortest interval in milliseconds between two moments of an animated scene: the time of a small scene's samples.
    pub(crate) epoch_ms: f64,
    /// Seconds of scene time per second.
    pub(crate) time_scale: f64,
    /// Seconds without a report after which a worker is lost: twenty reports, since a starved machine may be
    /// late by seconds.
    pub(crate) lease_secs: f64,
    /// Seconds for views in work to end after a shutdown began.
    pub(crate) grace_secs: f64,
    /// Registry through which coordinators elect a leader, such as `nats://127.0.0.1:4222`; unset: this is the only one.
    pub(crate) registry: Option<String>,
    /// File with this process's credentials for the registry: a token, or a user and a password.
    pub(crate) registry_credentials: Option<PathBuf>,
    /// Seconds that leadership lasts unless renewed. A standby takes over within this time after the leader died, and
    /// a leader that cannot reach the registry stops within it. A lease that the registry already knows takes
    /// precedence.
    pub(crate) registry_lease_secs: f64,
    /// Seconds for the registry to appear at the start before this process gives up; unset: it waits as a standby.
    pub(crate) registry_wait_secs: Option<f64>,
    /// MiB of additional samples in a worker at the same time; second copies of these may take half as much again.
    pub(crate) refining_mib: u64,
    /// Address at which this coordinator is reached, if not where it listens; a standby redirects clients to
    /// the leader's.
    pub(crate) advertise: Option<String>,
}

impl Default for Coordinator {
    fn default() -> Self {
        let (maps, probes) = (MegaViews::default(), Reflections::default());
        Self {
            scene: None,
            more_scenes: Vec::new(),
            environment: None,
            listen: "127.0.0.1:7400".to_owned(),
            samplers_composite: true,
            sampling: Sampling::default().name().to_owned(),
            map_side: maps.map_side,
            octree_levels: maps.levels,
            map_block: maps.block,
            reflections: "auto".to_owned(),
            reflection_side: probes.side,
            reflection_levels: ProbeSource::USUAL_LEVELS,
            reflection_points: ProbeSource::USUAL_BUDGET,
            reflectors: probes.most,
            refining_share: 0.5,
            model: None,
            epoch_ms: 100.0,
            time_scale: 1.0,
            lease_secs: 5.0,
            grace_secs: 5.0,
            registry: None,
            registry_credentials: None,
            registry_lease_secs: 2.5,
            registry_wait_secs: None,
            refining_mib: 1024,
            advertise: None,
        }
    }
}

/// How a worker joins, and its limits.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct Worker {
    /// The coordinator's address; several are separated by commas, of which one leads.
    pub(crate) coordinator: Option<String>,
    /// Seconds for a coordinator to answer at the start before this process gives up; unset: it keeps trying, since
    /// processes start in any order.
    pub(crate) coordinator_wait_secs: Option<f64>,
    /// Address to listen on. Port 0 takes a free port, since only the coordinator has to know it.
    pub(crate) listen: String,
    /// Address at which the coordinator and other workers reach this worker, if not where it listens.
    pub(crate) advertise: Option<String>,
    /// Address at which clients fetch redirected frames; `advertised`: the address for other workers.
    pub(crate) public_address: Option<String>,
    /// Folder of scenes; unset: the user's cache.
    pub(crate) scenes: Option<PathBuf>,
    /// MiB of samples kept in memory and on the GPU together. Beyond it the least recently used is dropped, but never
    /// one in use. 2 GiB hold forty samples of 2048² texels.
    pub(crate) samples_mib: u64,
    /// MiB of the compositor's copies of samples on the GPU, including their coarser levels, with the same rule.
    pub(crate) gpu_samples_mib: u64,
    /// Views in the render thread's queue: four batches. Beyond that another worker is faster.
    pub(crate) queued_views: usize,
    /// Samples in the render thread's queue.
    pub(crate) queued_samples: usize,
    /// MiB of frames that are rendered, packed or sent; further views wait. 2 GiB hold 150 frames of 1920×1080
    /// pixels, or six of the largest with all images.
    pub(crate) frames_mib: u64,
    /// MiB of depth kept for sessions with reprojection; 0: none. 256 MiB hold two thousand sessions of 200×150
    /// pixels, or thirty of 1920×1080.
    pub(crate) history_mib: u64,
    /// MiB of direct frames, kept or ordered by the coordinator, from which views nearby are warped; 0: none. 256 MiB hold 290 frames
    /// of 320×240 pixels, or ten of 1920×1080.
    pub(crate) sources_mib: u64,
    /// Requests in work, from the coordinator and other workers.
    pub(crate) requests: usize,
    /// Open connections. A quarter is reserved for the cluster's own processes.
    pub(crate) connections: usize,
    /// Seconds without use after which the resources of the other role are released.
    pub(crate) rest_secs: f64,
    /// MiB of the largest scene that is fetched from a coordinator.
    pub(crate) bundle_mib: u64,
    /// Seconds for views in work to end after a shutdown began.
    pub(crate) grace_secs: f64,
}

impl Default for Worker {
    fn default() -> Self {
        Self {
            coordinator: None,
            coordinator_wait_secs: None,
            listen: "127.0.0.1:0".to_owned(),
            advertise: None,
            public_address: None,
            scenes: None,
            samples_mib: 2048,
            gpu_samples_mib: 4096,
            queued_views: 256,
            queued_samples: 4096,
            frames_mib: 2048,
            history_mib: 256,
            sources_mib: 256,
            requests: 2048,
            connections: 4096,
            rest_secs: 30.0,
            bundle_mib: 8192,
            grace_secs: 5.0,
        }
    }
}

/// Limits of a coordinator's clients, in all and each. Clients are identified by their tokens, or else by their
/// addresses. Requests beyond a limit are rejected at once with a hint when to retry.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct Limits {
    /// Views queued or in work: sixteen full batches of two workers.
    pub(crate) views: usize,
    /// Views of one client queued or in work: three quarters of all, so that one client cannot fill the cluster.
    pub(crate) views_per_client: usize,
    /// Views at one worker: two full batches, so that one is ready when the other is done.
    pub(crate) views_per_worker: usize,
    /// Seconds after which a view ends, whatever its deadline: otherwise a client that does not read would
    /// keep its place.
    pub(crate) view_secs: f64,
    /// Seconds for a client to read one MiB of its frame. After that the frame or its session ends.
    pub(crate) read_secs: f64,
    /// Seconds that a view may wait in the queue, by measured costs. A view that would wait longer is rejected, so
    /// that workers spend their time on clients that still wait.
    pub(crate) wait_secs: f64,
    /// Pixels per second of all clients; unset: no limit.
    pub(crate) pixels_per_sec: Option<f64>,
    /// Pixels per second of one client; unset: no limit.
    pub(crate) pixels_per_sec_per_client: Option<f64>,
    /// Open sessions. Each holds a task and two frames in flight.
    pub(crate) sessions: usize,
    /// Open sessions of one client: three quarters of all.
    pub(crate) sessions_per_client: usize,
    /// Open connections, of which a quarter is reserved for the cluster's own processes. Machines allow many times as
    /// many file descriptors.
    pub(crate) connections: usize,
    /// KiB of a client's request. The largest valid request, a view with a pinned plan, takes some hundred bytes.
    pub(crate) request_kib: usize,
    /// Largest side of a view in pixels.
    pub(crate) view_side: u32,
    /// Largest number of pixels of a view.
    pub(crate) view_pixels: u64,
}

impl Default for Limits {
    fn default() -> Self {
        let view = argus_scene::Limits::default();
        Self {
            views: 2048,
            views_per_client: 1536,
            views_per_worker: 128,
            view_secs: 600.0,
            read_secs: 20.0,
            wait_secs: 60.0,
            pixels_per_sec: None,
            pixels_per_sec_per_client: None,
            sessions: 16384,
            sessions_per_client: 12288,
            connections: 16384,
            request_kib: 1024,
            view_side: view.max_side,
            view_pixels: view.max_pixels,
        }
    }
}

/// Certificates and tokens. `argus certs` makes all files.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct Security {
    /// PEM file of this process's certificate; with it, all of its connections use TLS.
    pub(crate) certificate: Option<PathBuf>,
    /// PEM file of the certificate's private key.
    pub(crate) key: Option<PathBuf>,
    /// PEM file of the authority that signs the certificates of the cluster's processes.
    pub(crate) ca: Option<PathBuf>,
    /// File of the clients' tokens, one per line: role (view, author or admin), name, token.
    pub(crate) tokens: Option<PathBuf>,
    /// Whether clients must have certificates too; health probes then need one as well.
    pub(crate) require_client_certificates: bool,
    /// Whether to listen beyond this machine without TLS.
    pub(crate) insecure: bool,
}
