//! `argus health`: is a process well? For containers and scripts, which go by the exit code.

use std::time::Duration;

use argus_client::{ConnectOptions, Health, health};

use crate::settings::Sources;
use crate::{args, output};

/// Asks a coordinator or a worker whether it can answer views; exits 0 if it can, 1 if not or if nobody answers.
///
/// The same is said by the standard gRPC health service (the names "" and "live") and, over HTTP on the same port (HTTPS by
/// HTTP/2 where there are certificates), at /readyz and /livez.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  argus health                                    ready to answer views?
  argus health --live --server http://host-b:7401 does that worker still get on with its work?")]
pub(crate) struct Args {
    #[command(flatten)]
    server: args::Server,
    /// Ask whether it is alive: that fails only for a process that should be started again
    #[arg(long)]
    live: bool,
    /// How long it may take to answer
    #[arg(long, value_name = "SECONDS", default_value = "5", value_parser = args::positive)]
    timeout: f64,
    /// Print one JSON object: well
    #[arg(long)]
    json: bool,
}

/// The one JSON object.
#[derive(serde::Serialize)]
struct Report {
    well: bool,
}

pub(crate) async fn run(args: Args, sources: &Sources) -> anyhow::Result<()> {
    let (what, word) = if args.live { (Health::Live, "live") } else { (Health::Ready, "ready") };
    let (url, options) = args.server.options(sources)?;
    let options = ConnectOptions { timeout: Duration::try_from_secs_f64(args.timeout)?, ..options };
    let well = health(&url, what, &options).await?;
    if args.json {
        output::json(&Report { well })?;
    }
    anyhow::ensure!(well, "{url} is not {word}: its log, or `argus status`, says why");
    if !args.json {
        println!("{word}");
    }
    Ok(())
}
