//! `argus worker`: a process that renders for a coordinator.

use std::path::PathBuf;
use std::sync::Arc;

use argus_cluster::worker::{Config, run as run_worker};

use crate::exit::bad_arguments;
use crate::settings::{self, Flags, Settings, Sources};
use crate::wiring::{Device, SceneFolder};
use crate::{args, credentials, shutdown};

/// Joins a coordinator and renders for it: samples, views from samples, and views from triangles.
///
/// The worker fetches the scene from the coordinator if it does not have it. Ctrl-C finishes the requests in work and exits 0.
/// `ARGUS_ADAPTER` selects one of several graphics adapters by a part of its name.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  argus worker --coordinator http://127.0.0.1:7400
  argus worker --coordinator http://host-a:7400 --listen 0.0.0.0:7401 --insecure
  argus worker --coordinator https://host-a:7400 --listen 0.0.0.0:7401 --public-address https://host-b.example:7401 \
    --certificate worker.pem --key worker.key --ca ca.pem")]
pub(crate) struct Args {
    /// Address of the coordinator
    #[arg(long, value_name = "URL")]
    coordinator: Option<String>,
    /// Address to listen on for the coordinator and other workers; port 0 takes a free port [default: 127.0.0.1:0]
    #[arg(long, value_name = "ADDR")]
    listen: Option<String>,
    /// Address at which the coordinator and other workers reach this worker [default: the address it listens on; if that
    /// is a wildcard, this machine's address towards the coordinator]
    #[arg(long, value_name = "URL")]
    advertise: Option<String>,
    /// Address at which clients reach this worker. Sessions then fetch their frames here, which relieves the coordinator;
    /// `advertised` means the address for other workers
    #[arg(long, value_name = "URL")]
    public_address: Option<String>,
    /// Open this scene and prepare to render it at once, while the coordinator meters its light: the first view comes sooner.
    /// Useless work if the coordinator serves another scene [default: wait for the coordinator to name it]
    #[arg(long, value_name = "S")]
    preload: Option<String>,
    /// Folder that is searched for the scene, and that keeps fetched scenes [default: the user's cache]
    #[arg(long, value_name = "DIR")]
    scenes: Option<PathBuf>,
    #[command(flatten)]
    security: args::Security,
    /// Also stop when standard input ends
    #[arg(long, hide = true)]
    exit_with_stdin: bool,
}

impl Args {
    /// The settings, including these arguments.
    fn settings(&self, sources: &Sources) -> anyhow::Result<Settings> {
        let flags = Flags::default()
            .with("worker.coordinator", "--coordinator", self.coordinator.as_ref())
            .with("worker.listen", "--listen", self.listen.as_ref())
            .with("worker.advertise", "--advertise", self.advertise.as_ref())
            .with("worker.public_address", "--public-address", self.public_address.as_ref())
            .with("worker.scenes", "--scenes", settings::path(self.scenes.as_ref()));
        Ok(sources.load(self.security.with(flags))?.settings)
    }
}

pub(crate) async fn run(args: Args, sources: &Sources) -> anyhow::Result<()> {
    let Settings { worker, limits, security: files, .. } = args.settings(sources)?;
    let Some(coordinator) = worker.coordinator.clone() else {
        return Err(bad_arguments("--coordinator URL is required: the coordinator's address"));
    };
    let shutdown = shutdown::requested(args.exit_with_stdin);
    let security = credentials::of_member(&files, false)?;
    let listener = credentials::listen(&worker.listen, security.is_some(), &files).await?;
    if let Some(security) = &security {
        let kept = credentials::keep_member(security.clone(), files.clone(), false);
        tokio::spawn(shutdown.clone().run_until_cancelled_owned(kept));
    }
    let config = Config { security, ..worker.config(coordinator, &limits) };
    let device = Arc::new(Device::new(settings::mib(worker.gpu_samples_mib)));
    let opener = SceneFolder::new(worker.scenes).preloading(args.preload, {
        let device = device.clone();
        move |scene| device.prepare(scene)
    });
    let opener = Arc::new(opener);
    Ok(run_worker(config, listener, device, opener, shutdown).await?)
}
