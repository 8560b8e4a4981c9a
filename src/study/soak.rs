//! Arguments of `argus study soak`.

use std::time::Duration;

use argus_studies::soak::{Options, run};
use argus_studies::{Effort as _, Report};
use indicatif::ProgressBar;

use super::arguments::{Scene, Size, Workers};
use crate::args;

/// Many sessions for a long time: all frames answered, latencies, memory over time; with --chaos workers are killed and
/// paused meanwhile, and frames compared byte by byte with pinned repeats
///
/// The cluster is started for it, on this machine, and ends with it.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  LP_NUM_THREADS=1 argus study soak --out figures
  argus study soak --sessions 200 --minutes 2
  argus study soak --sessions 200 --chaos --seed 7 --workers 4")]
pub(super) struct Soak {
    #[command(flatten)]
    scene: Scene,
    /// Sessions at the same time [default: 1000]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    sessions: Option<u32>,
    /// Cameras a second, all sessions together [default: 0.6 of what the machine is measured to carry, 0.2
    /// with --chaos]
    #[arg(long, value_name = "N", value_parser = args::positive)]
    rate: Option<f64>,
    /// How long [default: 10]
    #[arg(long, value_name = "M", value_parser = args::positive)]
    minutes: Option<f64>,
    #[command(flatten)]
    size: Size,
    #[command(flatten)]
    workers: Workers,
    /// Let sessions fetch their frames from the workers, instead of relaying them
    #[arg(long)]
    redirect: bool,
    /// Kill and pause workers meanwhile
    #[arg(long)]
    chaos: bool,
    /// Which workers, and when: the same for the same seed
    #[arg(long, value_name = "N", default_value_t = 1, requires = "chaos")]
    seed: u64,
    /// Seconds between two of these, while there is somebody to disturb
    #[arg(long, value_name = "SECONDS", default_value = "2.8", value_parser = args::positive, requires = "chaos")]
    chaos_every: f64,
}

impl Soak {
    pub(super) async fn run(self, quick: bool, progress: &ProgressBar) -> anyhow::Result<Report> {
        let mut options = Options::of(quick);
        self.scene.replace(&mut options.scene);
        self.size.replace(&mut options.size);
        self.workers.replace(&mut options.workers);
        options.sessions = self.sessions.unwrap_or(options.sessions);
        options.rate = self.rate.or(options.rate);
        options.redirect = self.redirect;
        options.duration = self.minutes.map_or(options.duration, |m| Duration::from_secs_f64(m * 60.0));
        options.chaos = self.chaos.then(|| (self.seed, Duration::from_secs_f64(self.chaos_every)));
        run(&std::env::current_exe()?, &options, progress).await
    }
}
