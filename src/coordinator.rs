//! `argus coordinator`: one address for clients, and the split of workers between the roles.

use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use anyhow::Context;
use argus_cluster::coordinator::{Config, serve};
use argus_cluster::core::quality::Model;
use argus_cluster::{SceneSource, core};
use argus_scene::{Camera, Rig, Scene};
use argus_studies::calibration;
use serde::Serialize;
use tokio::net::TcpListener;
use tokio_util::sync::CancellationToken;

use crate::wiring::OpenScene;
use crate::{args, output, shutdown};

/// Accepts workers and answers clients; renders nothing itself.
///
/// Workers join it with `argus worker --coordinator URL`, from this machine or others; one that does not have
/// the scene takes it from here. Ctrl-C finishes what is in work and exits 0.
#[derive(clap::Args)]
#[command(after_help = "\
Example: a cluster over machines
  host-a$ argus coordinator --scene model.glb --listen 0.0.0.0:7400
  host-b$ argus worker --coordinator http://host-a:7400 --listen 0.0.0.0:7401 --advertise http://host-b:7401
  host-c$ argus view --server http://host-a:7400 --eye 3,2,5 --target 0,1,0 --out view.png")]
pub(crate) struct Args {
    /// A file (.glb, .gltf, .obj, .ply) or `terrain[:TRIANGLES]`
    #[arg(long, value_name = "S")]
    scene: String,
    #[command(flatten)]
    service: Service,
}

/// What `coordinator` and `serve` have in common.
#[derive(clap::Args)]
pub(crate) struct Service {
    /// Where to listen; port 0 takes any that is free
    #[arg(long, value_name = "ADDR", default_value = "127.0.0.1:7400")]
    pub(crate) listen: String,
    /// Print one JSON object as soon as clients can connect: url, pid, scene, workers
    #[arg(long)]
    json: bool,
    /// Also stop when standard input ends
    #[arg(long, hide = true)]
    exit_with_stdin: bool,
    /// Whether samplers that have nothing to sample also compose views
    #[arg(long, value_name = "BOOL", default_value_t = true, action = clap::ArgAction::Set)]
    samplers_composite: bool,
    /// Share of the samplers' time that may go into samples where views have holes; 0: none are placed
    #[arg(long, value_name = "SHARE", default_value_t = 0.5, value_parser = args::share)]
    refining_share: f64,
    /// What `argus study bounds` calibrated, in place of what it kept on this machine for the scene
    #[arg(long, value_name = "FILE")]
    model: Option<PathBuf>,
    #[command(flatten)]
    rig: args::Rig,
    #[command(flatten)]
    seeing: args::Seeing,
    /// Milliseconds until the next moment of an animated scene is rendered, at the least
    #[arg(long, value_name = "MS", default_value = "100", value_parser = args::positive)]
    epoch_ms: f64,
    /// Seconds that an animated scene moves on in a second; 0 holds it still
    #[arg(long, value_name = "FACTOR", default_value = "1", value_parser = args::zero_or_more)]
    time_scale: f64,
}

/// A coordinator that listens, and has not yet begun to serve.
pub(crate) struct Ready {
    /// Where clients on this machine reach it.
    pub(crate) url: String,
    listener: TcpListener,
    source: Arc<OpenScene>,
    config: Config,
    /// Cancelled when this process is to stop.
    pub(crate) shutdown: CancellationToken,
}

/// The one JSON object of a service.
#[derive(Serialize)]
struct Announcement<'a> {
    url: &'a str,
    pid: u32,
    scene: &'a str,
    workers: usize,
}

pub(crate) async fn run(args: Args) -> anyhow::Result<()> {
    let ready = args.service.prepare(&args.scene).await?;
    args.service.announce(&ready, 0)?;
    if !args.service.json {
        println!("workers join with: argus worker --coordinator {}", ready.url);
    }
    ready.serve().await
}

impl Service {
    /// Takes the address, so that a conflict shows at once, then opens the scene.
    pub(crate) async fn prepare(&self, scene: &str) -> anyhow::Result<Ready> {
        let shutdown = shutdown::requested(self.exit_with_stdin);
        let listener = listen(&self.listen).await?;
        let url = format!("http://{}", reachable(listener.local_addr()?));
        let spec = scene.to_owned();
        let opening = tokio::task::spawn_blocking(move || OpenScene::open(&spec));
        let source = tokio::select! {
            source = opening => Arc::new(source.context("a task of this process failed")??),
            () = shutdown.cancelled() => anyhow::bail!("stopped before the scene was open"),
        };
        source.report();
        let models = self.models(source.scene())?;
        let (rig, time_scale) = (self.rig.knobs(), self.time_scale);
        let mut config = Config { rig, time_scale, models, ..Config::default() };
        config.core = core::Config {
            samplers_composite: self.samplers_composite,
            refining_share: self.refining_share,
            visibility: self.seeing.visibility(),
            epoch: Duration::try_from_secs_f64(self.epoch_ms * 1e-3).context("--epoch-ms")?,
            samples_per_view: self.rig.samples.unwrap_or(config.core.samples_per_view),
            ..config.core
        };
        Ok(Ready { url, listener, source, config, shutdown })
    }

    /// What was calibrated of the scene, as its sample cameras will stand.
    fn models(&self, scene: &Scene) -> anyhow::Result<Vec<Model>> {
        let rig = Rig::for_scene(scene, &self.rig.knobs())?;
        let Some(path) = &self.model else { return Ok(calibration::kept(scene.hash, &rig)) };
        let text = std::fs::read(path).with_context(|| format!("cannot read {}", path.display()))?;
        let model: Model =
            serde_json::from_slice(&text).with_context(|| format!("{} is no model", path.display()))?;
        anyhow::ensure!(
            model.fits(scene.hash, &rig),
            "{} was calibrated for another scene, other sample cameras or by another version: `argus study \
             bounds --scene {}` makes one that fits",
            path.display(),
            scene.name
        );
        Ok(vec![model])
    }

    /// Says where the service is.
    pub(crate) fn announce(&self, ready: &Ready, workers: usize) -> anyhow::Result<()> {
        let (url, scene) = (ready.url.as_str(), ready.source.name());
        if self.json {
            return output::json(&Announcement { url, pid: std::process::id(), scene, workers });
        }
        println!("serving {scene} at {url}");
        println!("try:  argus status --server {url}");
        let Camera { eye, target, fov_deg, .. } = ready.source.scene().default_camera();
        println!(
            "      argus view --server {url} --eye {:.5},{:.5},{:.5} --target {:.5},{:.5},{:.5} --fov-deg {fov_deg:.3} --out view.png",
            eye.x, eye.y, eye.z, target.x, target.y, target.z
        );
        Ok(())
    }
}

impl Ready {
    /// Serves until the process is to stop.
    pub(crate) async fn serve(self) -> anyhow::Result<()> {
        Ok(serve(self.config, self.listener, self.source, self.shutdown).await?)
    }
}

/// Listens on `address`, or says what to do instead.
pub(crate) async fn listen(address: &str) -> anyhow::Result<TcpListener> {
    TcpListener::bind(address).await.with_context(|| {
        format!("cannot listen on {address}: choose another address with --listen, such as 127.0.0.1:0")
    })
}

/// Where a process on this machine reaches what listens on `address`.
fn reachable(mut address: SocketAddr) -> SocketAddr {
    if address.ip().is_unspecified() {
        address.set_ip(match address.ip() {
            IpAddr::V4(_) => Ipv4Addr::LOCALHOST.into(),
            IpAddr::V6(_) => Ipv6Addr::LOCALHOST.into(),
        });
    }
    address
}
