//! Arguments of `argus-lab study capacity`.

use argus_studies::capacity::{Options, run};
use argus_studies::{Effort as _, Report};
use indicatif::ProgressBar;

/// Measures the load that one coordinator carries, with simulated sessions and workers over real gRPC: CPU time, memory,
/// relayed frames, and the time until a lost worker's views have another worker
#[derive(clap::Args)]
pub(super) struct Capacity {
    /// Number of sessions open at the same time [default: 10000]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    sessions: Option<u32>,
    /// Number of connections to the coordinator that sessions share [default: one each, within the limit of open files]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    connections: Option<u32>,
    /// Number of simulated workers [default: 1000]
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
