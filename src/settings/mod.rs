//! The one configuration: what can be set, and what it is unless somebody sets it.
//!
//! A setting is a section and a key, such as `limits.views`. In rising precedence it comes from the default below, from
//! the file (`--config`, else `ARGUS_CONFIG`, else `argus.toml` where Argus is started), from the environment
//! (`ARGUS_LIMITS__VIEWS`) and from flags (one of its own where there is one, else `--set limits.views=…`). `layers.rs`
//! puts them together; `argus config` prints what came of it. `docs/argus.toml` explains each to users.

mod convert;
mod layers;

use std::path::PathBuf;

use argus_scene::{MegaViews, Reflections, Sampling};
use serde::{Deserialize, Serialize};

pub(crate) use convert::{mib, secs};
pub(crate) use layers::{Flags, Sources, path};

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

/// How `view`, `load`, `status` and `health` reach a service.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct Client {
    /// Where the service is: `https://` where it has a certificate.
    pub(crate) server: String,
    /// PEM file of the authority that signed the service's certificate.
    pub(crate) ca: Option<PathBuf>,
    /// File that holds this client's token and nothing else.
    pub(crate) token_file: Option<PathBuf>,
    /// PEM file of a certificate of this client's own, for services that want one.
    pub(crate) certificate: Option<PathBuf>,
    /// PEM file of that certificate's private key.
    pub(crate) key: Option<PathBuf>,
}

impl Default for Client {
    fn default() -> Self {
        let server = "http://127.0.0.1:7400".to_owned();
        Self { server, ca: None, token_file: None, certificate: None, key: None }
    }
}

/// What a coordinator serves, and how it decides.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct Coordinator {
    /// A file, `terrain[:TRIANGLES]` or `mirrors[:BALLS]`. Said here or by a flag and never by a request.
    pub(crate) scene: Option<String>,
    /// Where to listen. This machine alone: what others reach needs TLS.
    pub(crate) listen: String,
    /// Whether samplers that have nothing to sample also compose views: a fifth less time on two workers.
    pub(crate) samplers_composite: bool,
    /// What samples are rendered from: `triangles`, each by itself, or `megaviews`, maps of an octree of the scene.
    pub(crate) sampling: String,
    /// Texels on a side of such a map's hemisphere: about as wide as those of a cube whose faces have half as many.
    pub(crate) map_side: u32,
    /// Levels of the octree: cells of a thousandth of the scene.
    pub(crate) octree_levels: u32,
    /// Cameras along an edge of the block whose maps share what looks alike: 1, since neighbours of a lattice see little
    /// alike at that resolution.
    pub(crate) map_block: u32,
    /// What glossy and transparent things show of the scene around them: `off`, the sky alone, or `maps` around them.
    pub(crate) reflections: String,
    /// Texels on a side of such a map: of three degrees.
    pub(crate) reflection_side: u32,
    /// Levels of the octree that they show: cells of a two-hundred-and-fiftieth of the scene.
    pub(crate) reflection_levels: u32,
    /// Things that have a map, the largest first: a map takes 50 KiB.
    pub(crate) reflectors: u32,
    /// Share of the samplers' time for samples where views have holes: they wait for everything else, so a half takes
    /// little from others.
    pub(crate) refining_share: f64,
    /// What `argus study bounds` calibrated, in place of what it kept on this machine.
    pub(crate) model: Option<PathBuf>,
    /// Milliseconds between two moments of an animated scene, at the least: what samples of a small scene take.
    pub(crate) epoch_ms: f64,
    /// Seconds that an animated scene moves on in a second.
    pub(crate) time_scale: f64,
    /// Silence after which a worker is lost: twenty reports, since a starved machine may be late by seconds.
    pub(crate) lease_secs: f64,
    /// How long views in work may take after a shutdown began.
    pub(crate) grace_secs: f64,
    /// Where several coordinators agree who leads, such as `nats://127.0.0.1:4222`; unset: this one is alone.
    pub(crate) registry: Option<String>,
    /// File that holds what the registry knows this process by: a token, or a user and a password.
    pub(crate) registry_credentials: Option<PathBuf>,
    /// How long leadership lasts unless renewed: a standby leads at most so long after the leader died, and a leader that
    /// hears nothing of the registry stops within it. Where the registry knows a lease already, that counts.
    pub(crate) registry_lease_secs: f64,
    /// How long the registry may be absent at the start before this process gives up; unset: it stands by until
    /// the registry is there.
    pub(crate) registry_wait_secs: Option<f64>,
    /// Samples beside the rig's own that may exist in a worker at the same time; half as much again, second copies of those.
    pub(crate) refining_mib: u64,
    /// Where others reach this coordinator, if not where it listens; whoever asks a standby is told.
    pub(crate) advertise: Option<String>,
}

impl Default for Coordinator {
    fn default() -> Self {
        let (maps, around) = (MegaViews::default(), Reflections::default());
        Self {
            scene: None,
            listen: "127.0.0.1:7400".to_owned(),
            samplers_composite: true,
            sampling: Sampling::default().name().to_owned(),
            map_side: maps.map_side,
            octree_levels: maps.levels,
            map_block: maps.block,
            reflections: "off".to_owned(),
            reflection_side: around.side,
            reflection_levels: around.levels,
            reflectors: around.most,
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

/// How a worker joins, and what it may hold.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct Worker {
    /// Where the coordinator is; several with commas between them, of which one leads.
    pub(crate) coordinator: Option<String>,
    /// How long nobody may answer there at the start before this process gives up; unset: it goes on trying, since processes
    /// are started in any order.
    pub(crate) coordinator_wait_secs: Option<f64>,
    /// Where to listen; port 0 takes any that is free, since only the coordinator has to find it.
    pub(crate) listen: String,
    /// Where others reach this worker, if not where it listens.
    pub(crate) advertise: Option<String>,
    /// Where clients reach it, whose sessions then fetch their frames there; `advertised`: where others do.
    pub(crate) public_address: Option<String>,
    /// Folder of scenes; the user's cache unless set.
    pub(crate) scenes: Option<PathBuf>,
    /// Samples that are kept, in memory and on the GPU together, before the least recently used one goes; those in use stay
    /// whatever they take. 2 GiB: forty samples of 2048² texels.
    pub(crate) samples_mib: u64,
    /// Of the copies that compositing makes of samples on the GPU, with their coarser levels, likewise.
    pub(crate) gpu_samples_mib: u64,
    /// Views that wait for the render thread: four batches, beyond which another worker is sooner done.
    pub(crate) queued_views: usize,
    /// Samples that wait for the render thread.
    pub(crate) queued_samples: usize,
    /// Frames that are being made, packed or sent; further views wait. 2 GiB: a hundred and fifty of 1920×1080 pixels, or six
    /// of the largest with all images.
    pub(crate) frames_mib: u64,
    /// Depth that frames leave for the next ones of their sessions, where those ask for that; 0: none. 256 MiB: two thousand
    /// sessions of 200×150 pixels, or thirty of 1920×1080.
    pub(crate) history_mib: u64,
    /// Requests in work, of the coordinator and of other workers.
    pub(crate) requests: usize,
    /// Open connections. A quarter is for the cluster's own processes.
    pub(crate) connections: usize,
    /// What the other role would need is given up after nobody has used it for so long.
    pub(crate) rest_secs: f64,
    /// The largest scene that is fetched from a coordinator.
    pub(crate) bundle_mib: u64,
    /// How long views in work may take after a shutdown began.
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
            requests: 2048,
            connections: 4096,
            rest_secs: 30.0,
            bundle_mib: 8192,
            grace_secs: 5.0,
        }
    }
}

/// What clients may ask of a coordinator, in all and each. Clients are told apart by their tokens, or else by their
/// addresses. What is beyond a limit is turned away at once, with a hint when to come again.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct Limits {
    /// Views waiting or in work: sixteen full batches of two workers.
    pub(crate) views: usize,
    /// Views of one client waiting or in work: three quarters of all, so that one client cannot fill the cluster.
    pub(crate) views_per_client: usize,
    /// Views at one worker: two full batches, so that one is ready when the other is done.
    pub(crate) views_per_worker: usize,
    /// A view is given up after this long, whatever its deadline: one whose client takes nothing would keep its place.
    pub(crate) view_secs: f64,
    /// A client that does not read a MiB of its frame for so long loses the frame, or its session.
    pub(crate) read_secs: f64,
    /// A view that would wait longer than this for its turn, by measured costs, is turned away: the work before it is
    /// done for clients who still wait.
    pub(crate) wait_secs: f64,
    /// Pixels a second; unset: what the workers manage.
    pub(crate) pixels_per_sec: Option<f64>,
    /// Pixels a second of one client; unset: no limit of its own.
    pub(crate) pixels_per_sec_per_client: Option<f64>,
    /// Open sessions. Each is a task and two frames on their way.
    pub(crate) sessions: usize,
    /// Open sessions of one client: three quarters of all.
    pub(crate) sessions_per_client: usize,
    /// Open connections, of which a quarter is for the cluster's own processes: a machine's file descriptors are many times
    /// as many.
    pub(crate) connections: usize,
    /// Bytes of a client's request. The largest one that means anything, a view with a pinned plan, is some hundred.
    pub(crate) request_kib: usize,
    /// Pixels on a side of a view.
    pub(crate) view_side: u32,
    /// Pixels of a view.
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
            request_kib: 256,
            view_side: view.max_side,
            view_pixels: view.max_pixels,
        }
    }
}

/// Who may listen, join and ask. `argus certs` makes all files.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct Security {
    /// PEM file of this process's certificate; with it, every listener and every connection of it is TLS.
    pub(crate) certificate: Option<PathBuf>,
    /// PEM file of its key.
    pub(crate) key: Option<PathBuf>,
    /// PEM file of the authority that signs the certificates of the cluster's processes.
    pub(crate) ca: Option<PathBuf>,
    /// File of clients' tokens, a line each: role (view or admin), name, token.
    pub(crate) tokens: Option<PathBuf>,
    /// Whether clients must have certificates, too; probes of health then need one as well.
    pub(crate) require_client_certificates: bool,
    /// Whether to listen beyond this machine without TLS all the same.
    pub(crate) insecure: bool,
}
