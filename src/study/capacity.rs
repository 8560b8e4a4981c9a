//! Arguments of `argus study capacity`.

use argus_studies::capacity::{Options, run};
use argus_studies::{Effort as _, Report};
use indicatif::ProgressBar;

/// What one coordinator carries: simulated sessions and workers over real gRPC; its time on a core, memory, relayed
/// frames, and how soon a lost worker's views are with another
#[derive(clap::Args)]
pub(super) struct Capacity {
    /// Sessions open at the same time [default: 10000]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    sessions: Option<u32>,
    /// Connections to the coordinator that they have in all [default: one each, as far as the limit on open files reaches]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    connections: Option<u32>,
    /// Simulated workers [default: 1000]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(2..=8192))]
    workers: Option<u32>,
}

impl Capacity {
    pub(super) async fn run(self, quick: bool, progress: &ProgressBar) -> anyhow::Result<Report> {
        let mut options = Options::of(quick);
        options.sessions = self.sessions.map_or(options.sessions, |n| n as usize);
        options.connections = self.connections.map(|n| n as usize);
        options.workers = self.workers.map_or(options.workers, |n| n as usize);
        run(&std::env::current_exe()?, &options, progress).await
    }
}
