//! Arguments of `argus-lab study soak`.

use std::time::Duration;

use argus::args;
use argus_studies::soak::{Options, run};
use argus_studies::{Effort as _, Report};
use indicatif::ProgressBar;

use super::arguments::{Scene, Size, Workers};

/// Runs many sessions for a long time: lost frames, latencies, memory over time; with --chaos, workers are killed and
/// paused meanwhile, and frames are compared byte by byte with pinned repeats
///
/// The study starts and ends its own cluster on this machine.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  LP_NUM_THREADS=1 argus-lab study soak --out figures
  argus-lab study soak --sessions 200 --minutes 2
  argus-lab study soak --sessions 200 --chaos --seed 7 --workers 4")]
pub(super) struct Soak {
    #[command(flatten)]
    scene: Scene,
    /// Number of sessions at the same time [default: 1000]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    sessions: Option<u32>,
    /// Cameras per second of all sessions together [default: 0.6 of the machine's measured capacity, 0.2 with --chaos]
    #[arg(long, value_name = "N", value_parser = args::positive)]
    rate: Option<f64>,
    /// Duration in minutes [default: 10]
    #[arg(long, value_name = "M", value_parser = args::positive)]
    minutes: Option<f64>,
    #[command(flatten)]
    size: Size,
    #[command(flatten)]
    workers: Workers,
    /// Let sessions fetch their frames from the workers, instead of relaying them through the coordinator
    #[arg(long)]
    redirect: bool,
    /// Kill and pause workers during the run
    #[arg(long)]
    chaos: bool,
    /// Random seed of the kills and pauses; the same seed repeats them
    #[arg(long, value_name = "N", default_value_t = 1, requires = "chaos")]
    seed: u64,
    /// Seconds between two kills or pauses; delayed while fewer than two workers run
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
