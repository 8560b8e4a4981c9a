//! Arguments of `argus-lab study overload`.

use argus::args;
use argus_studies::overload::{Options, run};
use argus_studies::{Effort as _, Report};
use indicatif::ProgressBar;

use super::arguments::{Scene, Size, Workers};

/// Measures a cluster under more load than it can carry: which views it still answers, how late, and what happens
/// to the rest
///
/// Without --scene: terrain:500000. Loads are multiples of the cluster's measured capacity.
#[derive(clap::Args)]
pub(super) struct Overload {
    #[command(flatten)]
    scene: Scene,
    #[command(flatten)]
    size: Size,
    #[command(flatten)]
    workers: Workers,
    /// Seconds of each load [default: 15]
    #[arg(long, value_name = "T", value_parser = args::positive)]
    seconds: Option<f64>,
    /// Seconds that a view may wait in the queue before the service rejects it [default: 1]
    #[arg(long, value_name = "SECONDS", value_parser = args::positive)]
    wait: Option<f64>,
}

impl Overload {
    pub(super) async fn run(self, quick: bool, progress: &ProgressBar) -> anyhow::Result<Report> {
        let mut options = Options::of(quick);
        self.scene.replace(&mut options.scene);
        self.size.replace(&mut options.size);
        self.workers.replace(&mut options.workers);
        options.seconds = self.seconds.unwrap_or(options.seconds);
        options.wait_secs = self.wait.unwrap_or(options.wait_secs);
        run(&std::env::current_exe()?, &options, progress).await
    }
}
