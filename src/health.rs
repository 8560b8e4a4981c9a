//! `argus health`: a health check for containers and scripts.

use std::time::Duration;

use argus_client::{ConnectOptions, Health, health};

use crate::settings::Sources;
use crate::{args, output};

/// Asks a coordinator or a worker whether it can answer views. Exits 0 if it can, 1 if it cannot or does not reply.
///
/// The same is available from the standard gRPC health service (the names "" and "live") and, over HTTP on the same port
/// (HTTPS with HTTP/2 if there are certificates), at /readyz and /livez.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  argus health                                    ready to answer views?
  argus health --live --server http://host-b:7401 does that worker still make progress?")]
pub(crate) struct Args {
    #[command(flatten)]
    server: args::Server,
    /// Ask whether the process is alive; if not, it should be restarted
    #[arg(long)]
    live: bool,
    /// Seconds to wait for the reply
    #[arg(long, value_name = "SECONDS", default_value = "5", value_parser = args::positive)]
    timeout: f64,
    /// Print one JSON object: well
    #[arg(long)]
    json: bool,
}

/// The JSON output.
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
    anyhow::ensure!(well, "{url} is not {word}: see its log or `argus status`");
    if !args.json {
        println!("{word}");
    }
    Ok(())
}
