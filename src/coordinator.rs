//! `argus coordinator`: accepts clients and workers, and assigns the workers' roles.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::Context;
use argus_cluster::SceneSource;
use argus_cluster::coordinator::{Config, Prepared, SceneToServe, prepare, serve_prepared};
use argus_cluster::core::quality::Model;
use argus_cluster::leadership::{LazyRegistry, LocalRegistry, NatsRegistry, Registry};
use argus_cluster::security::ReloadableSecurity;
use argus_local::models;
use argus_scene::{Camera, Rig, Sampling, Scene};
use serde::Serialize;
use tokio::net::TcpListener;
use tokio_util::sync::CancellationToken;

use crate::browse::{Page, Place};
use crate::exit::bad_arguments;
use crate::served_scenes::{self, NamedScene};
use crate::settings::{self, Flags, Settings, Sources};
use crate::wiring::OpenScene;
use crate::{args, credentials, output, shutdown};

/// Pause between two attempts to reach a registry.
const TRY_AGAIN: Duration = Duration::from_millis(500);

/// Accepts workers and answers clients. It renders nothing itself.
///
/// Workers join it with `argus worker --coordinator URL`, from this machine or from others. A worker without the scene fetches it
/// from the coordinator. Ctrl-C finishes the requests in work and exits 0.
#[derive(clap::Args)]
#[command(after_help = "\
Example: a cluster over machines that trust their network; `argus certs` shows the same by TLS
  host-a$ argus coordinator --scene model.glb --listen 0.0.0.0:7400 --insecure
  host-b$ argus worker --coordinator http://host-a:7400 --listen 0.0.0.0:7401 --advertise http://host-b:7401 --insecure
  host-c$ argus view --server http://host-a:7400 --out view.png")]
pub(crate) struct Args {
    /// A file (.glb, .gltf, .obj, .ply), `terrain[:TRIANGLES]`, `mirrors[:BALLS]` or `rooms[:WALL_MM]`, and `+balls:N`
    /// after it for mirroring balls. Given several times, the service has several scenes, and moves workers between them; each may be
    /// NAME=S, else it has the name of its file
    #[arg(long, value_name = "S")]
    scene: Vec<String>,
    #[command(flatten)]
    service: Service,
}

/// The flags that `coordinator` and `serve` share.
#[derive(clap::Args)]
pub(crate) struct Service {
    #[command(flatten)]
    environment: args::Environment,
    /// Address to listen on; port 0 takes a free port [default: 127.0.0.1:7400]
    #[arg(long, value_name = "ADDR")]
    listen: Option<String>,
    /// Address of the page that shows the scene in a browser, or `off` [default: 127.0.0.1:7480 or a free port for `serve`, off
    /// for `coordinator`]
    #[arg(long, value_name = "ADDR")]
    page: Option<String>,
    /// Print one JSON object once clients can connect: url, page, pid, scene, scenes, workers, default_camera
    #[arg(long)]
    json: bool,
    /// Also stop when standard input ends
    #[arg(long, hide = true)]
    exit_with_stdin: bool,
    /// Whether samplers with time to spare also compose views [default: true]
    #[arg(long, value_name = "BOOL")]
    samplers_composite: Option<bool>,
    /// Greatest share of the samplers' time for additional samples where views have holes, 0 to 1; 0 places none
    /// [default: 0.5]
    #[arg(long, value_name = "SHARE", value_parser = args::share)]
    refining_share: Option<f64>,
    /// Calibration that `argus-lab study views bounds` wrote, instead of the one kept on this machine for the scene
    #[arg(long, value_name = "FILE")]
    model: Option<PathBuf>,
    /// NATS server with JetStream through which several coordinators elect a leader, such as nats://127.0.0.1:4222
    /// [default: none; this is the only coordinator]
    #[arg(long, value_name = "URL")]
    registry: Option<String>,
    /// Address at which clients and workers reach this coordinator, if it is not the one it listens on; a standby
    /// redirects clients to the leader's
    #[arg(long, value_name = "URL")]
    advertise: Option<String>,
    #[command(flatten)]
    security: args::Security,
    /// File with the clients' tokens, one a line: role (view, author or admin), name, token
    #[arg(long, value_name = "FILE", help_heading = "Security (`argus certs` makes the files)")]
    tokens: Option<PathBuf>,
    #[command(flatten)]
    samples: args::Samples,
    /// Shortest interval in milliseconds between two rendered moments of an animated scene; shorter is
    /// smoother and costs more [default: 100]
    #[arg(long, value_name = "MS", value_parser = args::positive)]
    epoch_ms: Option<f64>,
    /// Render all samples anew after this many views, even if nothing moves (the cluster paper's experiments); 0: never
    #[arg(long, value_name = "VIEWS", default_value_t = 0)]
    refresh_views: u64,
    /// Speed of an animated scene; 1 is real time, 0 holds it still [default: 1]
    #[arg(long, value_name = "FACTOR", value_parser = args::zero_or_more)]
    time_scale: Option<f64>,
}

/// A coordinator that listens but has no scene yet.
pub(crate) struct Listening {
    /// Address for clients on this machine.
    pub(crate) url: String,
    listener: TcpListener,
    security: Option<Arc<ReloadableSecurity>>,
    page: Option<Page>,
    /// Cancelled when this process must stop.
    pub(crate) shutdown: CancellationToken,
}

/// A coordinator that is ready to serve.
pub(crate) struct Ready {
    /// Address for clients on this machine.
    pub(crate) url: String,
    listener: TcpListener,
    /// At least one.
    scenes: Vec<ReadyScene>,
    config: Config,
    registry: Arc<dyn Registry>,
    page: Option<Page>,
    /// Cancelled when this process must stop.
    pub(crate) shutdown: CancellationToken,
}

/// A scene that is ready to be served.
struct ReadyScene {
    name: String,
    source: Arc<OpenScene>,
    prepared: Prepared,
}

/// The JSON announcement of a service.
#[derive(Serialize)]
struct Announcement<'a> {
    url: &'a str,
    /// Link of the page for browsers; none if there is no page.
    page: Option<&'a str>,
    pid: u32,
    scene: &'a str,
    /// Names of all scenes.
    scenes: Vec<&'a str>,
    workers: usize,
    /// The view of clients that name no camera.
    default_camera: Camera,
}

pub(crate) async fn run(args: Args, sources: &Sources) -> anyhow::Result<()> {
    let settings = args.service.settings(&args.scene, sources)?;
    let scenes = served_scenes::of(&settings.coordinator)?;
    if scenes.is_empty() {
        return Err(bad_arguments("--scene S is required: a file, or `terrain`"));
    }
    let listening = args.service.listen(&settings, Place::Off).await?;
    let ready = args.service.open(listening, scenes, &settings).await?;
    args.service.announce(&ready, 0)?;
    if !args.service.json {
        println!("workers join with: argus worker --coordinator {}", ready.url);
    }
    ready.serve(CancellationToken::new()).await
}

impl Service {
    /// The settings, including these arguments and the scenes. Scenes that are given replace all that other sources name.
    pub(crate) fn settings(&self, scenes: &[String], sources: &Sources) -> anyhow::Result<Settings> {
        let first = scenes.first();
        let more = first.map(|_| serde_json::to_string(&scenes[1..])).transpose()?;
        let flags = Flags::default()
            .with("coordinator.scene", "--scene", first)
            .with("coordinator.more_scenes", "--scene", more)
            .with("coordinator.environment", "--environment", self.environment.file())
            .with("coordinator.listen", "--listen", self.listen.as_ref())
            .with("coordinator.samplers_composite", "--samplers-composite", self.samplers_composite)
            .with("coordinator.refining_share", "--refining-share", self.refining_share)
            .with("coordinator.model", "--model", settings::path(self.model.as_ref()))
            .with("coordinator.epoch_ms", "--epoch-ms", self.epoch_ms)
            .with("coordinator.time_scale", "--time-scale", self.time_scale)
            .with("coordinator.registry", "--registry", self.registry.as_ref())
            .with("coordinator.advertise", "--advertise", self.advertise.as_ref())
            .with("security.tokens", "--tokens", settings::path(self.tokens.as_ref()));
        // Flags that exclude one another are refused before anything is started.
        self.samples.sampling.indirect.settings()?;
        Ok(sources.load(self.security.with(self.samples.source.with(flags)))?.settings)
    }

    /// Binds the addresses first, so that a conflict is reported at once. `page`: where the page is, unless a flag says so.
    pub(crate) async fn listen(&self, settings: &Settings, page: Place<'_>) -> anyhow::Result<Listening> {
        let shutdown = shutdown::requested(self.exit_with_stdin);
        let security = credentials::of_member(&settings.security, true)?;
        let address = &settings.coordinator.listen;
        let listener = credentials::listen(address, security.is_some(), &settings.security).await?;
        let url = credentials::url(security.is_some(), listener.local_addr()?);
        let page = self.page.as_deref().map_or(page, Place::named);
        let page = Page::listen(page, security.as_ref(), settings.security.insecure).await?;
        if let Some(security) = &security {
            let kept = credentials::keep_member(security.clone(), settings.security.clone(), true);
            tokio::spawn(shutdown.clone().run_until_cancelled_owned(kept));
        }
        Ok(Listening { url, listener, security, page, shutdown })
    }

    /// Opens the scenes and prepares their light.
    pub(crate) async fn open(
        &self,
        Listening { url, listener, security, page, shutdown }: Listening,
        scenes: Vec<NamedScene>,
        settings: &Settings,
    ) -> anyhow::Result<Ready> {
        let coordinator = &settings.coordinator;
        if scenes.len() > 1 && coordinator.model.is_some() {
            return Err(bad_arguments(
                "--model is calibrated for one scene: with several, leave it out; each takes what `argus-lab study views \
                 bounds` kept for it on this machine",
            ));
        }
        let mut config = Config { security, ..coordinator.config(&settings.limits) };
        let args::Samples { rig, sampling, visibility, .. } = &self.samples;
        config.rig = config.sampling.rig_settings(rig.settings());
        config.advertise = Some(coordinator.advertise.clone().unwrap_or_else(|| url.clone()));
        config.core.visibility = visibility.visibility();
        config.core.refresh_views = self.refresh_views;
        config.sub_samples = sampling.sub_samples;
        config.light = sampling.light;
        config.effects = sampling.effects;
        config.exposure = sampling.exposure;
        config.indirect = sampling.indirect.settings()?;
        config.core.samples_per_view = rig.samples.unwrap_or(config.core.samples_per_view);
        let mut ready = Vec::new();
        for scene in scenes {
            let scene = tokio::select! {
                scene = self.open_scene(scene, &config) => scene?,
                () = shutdown.cancelled() => anyhow::bail!("stopped before the scenes were open and their light known"),
            };
            config.models.extend(self.models(coordinator.model.as_deref(), scene.source.scene(), &config)?);
            ready.push(scene);
        }
        let registry = tokio::select! {
            registry = registry(settings) => registry?,
            () = shutdown.cancelled() => anyhow::bail!("stopped before the registry answered"),
        };
        Ok(Ready { url, listener, scenes: ready, config, registry, page, shutdown })
    }

    /// Opens a scene and prepares its light.
    async fn open_scene(&self, scene: NamedScene, config: &Config) -> anyhow::Result<ReadyScene> {
        let NamedScene { name, spec } = scene;
        let sampling = &self.samples.sampling;
        let (light, metering) = (sampling.light, sampling.effects.metering(sampling.indirect.settings()?));
        let opening = tokio::task::spawn_blocking(move || OpenScene::open(&spec, light, metering));
        let source = Arc::new(opening.await.context("a task of this process failed")??);
        source.report();
        let preparing = {
            let (config, source) = (config.clone(), source.clone());
            tokio::task::spawn_blocking(move || prepare(&config, source.as_ref()))
        };
        let prepared = preparing.await.context("a task of this process failed")??;
        Ok(ReadyScene { name, source, prepared })
    }

    /// The calibrated models of the scene and its rig.
    fn models(&self, model: Option<&Path>, scene: &Scene, config: &Config) -> anyhow::Result<Vec<Model>> {
        let rig = Rig::for_scene(scene, &config.rig)?;
        config.sampling.validate(&rig)?;
        if config.sampling != Sampling::Triangles {
            // Calibration measures samples from triangles; other samples have other errors.
            anyhow::ensure!(model.is_none(), "--model was calibrated with --sampling triangles");
            return Ok(Vec::new());
        }
        let Some(path) = model else { return Ok(models::kept(scene.hash, &rig)) };
        let text = std::fs::read(path).with_context(|| format!("cannot read {}", path.display()))?;
        let model: Model = serde_json::from_slice(&text)
            .with_context(|| format!("{} is not a calibrated model", path.display()))?;
        anyhow::ensure!(
            model.fits(scene.hash, &rig),
            "{} was calibrated for another scene, other sample cameras or by another version: `argus-lab study \
            bounds --scene {}` makes a new one",
            path.display(),
            scene.name
        );
        Ok(vec![model])
    }

    /// Prints the service's address.
    pub(crate) fn announce(&self, ready: &Ready, workers: usize) -> anyhow::Result<()> {
        let first = &ready.scenes[0].source;
        let (url, scene) = (ready.url.as_str(), first.name());
        let default_camera = first.scene().default_camera();
        let scenes: Vec<&str> = ready.scenes.iter().map(|scene| scene.name.as_str()).collect();
        if self.json {
            let pid = std::process::id();
            let page = ready.page.as_ref().map(|page| page.url.as_str());
            return output::json(&Announcement { url, page, pid, scene, scenes, workers, default_camera });
        }
        println!("serving {scene} at {url}");
        println!("light {}", first.light());
        for ReadyScene { name, source, .. } in &ready.scenes[1..] {
            println!("   and {} by --scene-name {name}, light {}", source.name(), source.light());
        }
        if let Some(page) = &ready.page {
            println!("in a browser: {}", page.url);
        }
        println!("try:  argus status --server {url}");
        println!("      argus view --server {url} --out view.png");
        println!("      argus view --server {url} {} --out view.png", args::flags_of(&default_camera));
        Ok(())
    }
}

impl Ready {
    /// Serves until the process must stop. Cancels `answers` once the service is ready for load.
    pub(crate) async fn serve(self, answers: CancellationToken) -> anyhow::Result<()> {
        let Self { url, config, listener, scenes, registry, page, shutdown } = self;
        let to_serve = |ReadyScene { name, source, prepared }| SceneToServe { name, source, prepared };
        let scenes = scenes.into_iter().map(to_serve).collect();
        let (security, closing) = (config.security.clone(), shutdown.child_token());
        let page = async {
            let Some(page) = page else { return };
            // Without its page, a service still serves.
            if let Err(error) = page.serve(&url, security, closing.clone()).await {
                tracing::error!("{error:#}");
            }
        };
        let served = async {
            let served = serve_prepared(config, scenes, listener, registry, shutdown, answers).await;
            closing.cancel();
            served
        };
        let (served, ()) = tokio::join!(served, page);
        Ok(served?)
    }
}

/// The registry through which coordinators elect their leader.
async fn registry(settings: &Settings) -> anyhow::Result<Arc<dyn Registry>> {
    let coordinator = &settings.coordinator;
    let Some(url) = &coordinator.registry else { return Ok(Arc::new(LocalRegistry::alone())) };
    let access = credentials::of_registry(url, coordinator, &settings.security)?;
    let lease = Duration::try_from_secs_f64(coordinator.registry_lease_secs)?;
    let Some(most) = coordinator.registry_wait_secs.map(settings::secs) else {
        return Ok(Arc::new(LazyRegistry::new(url, lease, access)));
    };
    let began = Instant::now();
    loop {
        match NatsRegistry::connect_as(url, lease, access.clone()).await {
            Ok(registry) => return Ok(Arc::new(registry)),
            Err(error) if began.elapsed() >= most => return Err(error.into()),
            Err(_) => tokio::time::sleep(TRY_AGAIN).await,
        }
    }
}
