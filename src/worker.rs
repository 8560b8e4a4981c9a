//! `argus worker`: a process that renders what a coordinator asks of it.

use std::path::PathBuf;
use std::sync::Arc;

use argus_cluster::worker::{Config, run as run_worker};

use crate::coordinator::listen;
use crate::wiring::{Device, SceneFolder};
use crate::{args, shutdown};

/// Joins a coordinator and renders for it: samples, views from samples, or views from triangles, as it says.
///
/// The worker takes the scene from the coordinator if it does not have it. Ctrl-C finishes what is in work
/// and exits 0. `ARGUS_ADAPTER` chooses among several graphics adapters by a part of their name.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  argus worker --coordinator http://127.0.0.1:7400
  argus worker --coordinator http://host-a:7400 --listen 0.0.0.0:7401 --advertise http://host-b:7401")]
pub(crate) struct Args {
    /// Where the coordinator is
    #[arg(long, value_name = "URL")]
    coordinator: String,
    /// Where to listen for the coordinator and other workers; port 0 takes any that is free
    #[arg(long, value_name = "ADDR", default_value = "127.0.0.1:0")]
    listen: String,
    /// Where others reach this worker, if that is not where it listens
    #[arg(long, value_name = "URL")]
    advertise: Option<String>,
    /// Folder to look for the scene in, and to keep scenes that were fetched [default: the user's cache]
    #[arg(long, value_name = "DIR")]
    scenes: Option<PathBuf>,
    #[command(flatten)]
    sampling: args::Sampling,
    /// Also stop when standard input ends
    #[arg(long, hide = true)]
    exit_with_stdin: bool,
}

pub(crate) async fn run(args: Args) -> anyhow::Result<()> {
    let shutdown = shutdown::requested(args.exit_with_stdin);
    let listener = listen(&args.listen).await?;
    let config = Config { advertise: args.advertise, ..Config::new(args.coordinator) };
    let device = Arc::new(Device::new(args.sampling.knobs()));
    let opener = Arc::new(SceneFolder::new(args.scenes));
    Ok(run_worker(config, listener, device, opener, shutdown).await?)
}
