//! Arguments of `argus-lab study cluster`.

use std::path::PathBuf;

use anyhow::Context as _;
use argus::args;
use argus_studies::cluster::{Options, run};
use argus_studies::simulate::Parameters;
use argus_studies::{Effort as _, Report};
use indicatif::ProgressBar;

use super::arguments::{Scene, Size};

/// Measures or simulates the cluster paper's figures: the time of a tick against views and against processes
///
/// Real clusters are separate processes on this machine. Each tick renders the samples anew, as in the paper.
/// Variants let samplers also compose in their spare time, keep the scene still, or render all views directly. With
/// --simulate the real coordinator core drives any number of simulated workers.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  argus-lab study cluster --out figures
  argus-lab study cluster --simulate --out figures
  argus-lab study cluster --simulate --processes 64 --sample-ms 9 --view-ms 1 --link-gbit 1")]
pub(super) struct Cluster {
    #[command(flatten)]
    scene: Scene,
    /// Number of processes: real clusters of 1 to P [default: 3], or one simulated cluster of P [default: 2 to 4096]
    #[arg(long, value_name = "P", value_parser = clap::value_parser!(u32).range(1..=8192))]
    processes: Option<u32>,
    /// Views per tick of real clusters; may be given more than once [default: 10 to 1000]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    views: Vec<u32>,
    #[command(flatten)]
    size: Size,
    /// Simulate the cluster instead of measuring real processes
    #[arg(long)]
    simulate: bool,
    #[command(flatten)]
    costs: Costs,
}

/// Costs of work in a simulation.
#[derive(clap::Args)]
#[command(next_help_heading = "Costs of a simulation")]
pub(super) struct Costs {
    /// JSON file of costs, as this study prints them after a real run [default: round numbers of that order]
    #[arg(long, value_name = "FILE")]
    costs: Option<PathBuf>,
    /// g: milliseconds for a sample
    #[arg(long, value_name = "MS", value_parser = args::positive)]
    sample_ms: Option<f64>,
    /// c: milliseconds for a view from samples
    #[arg(long, value_name = "MS", value_parser = args::positive)]
    view_ms: Option<f64>,
    /// Milliseconds for a view from the triangles
    #[arg(long, value_name = "MS", value_parser = args::positive)]
    direct_ms: Option<f64>,
    /// Speed of each machine's network link
    #[arg(long, value_name = "GBIT/S", value_parser = args::positive)]
    link_gbit: Option<f64>,
    /// One-way latency between two machines
    #[arg(long, value_name = "MS", value_parser = args::positive)]
    latency_ms: Option<f64>,
}

impl Costs {
    pub(super) fn parameters(self) -> anyhow::Result<Parameters> {
        let mut parameters = match &self.costs {
            None => Parameters::default(),
            Some(path) => {
                let text = std::fs::read(path).with_context(|| format!("cannot read {}", path.display()))?;
                serde_json::from_slice(&text)
                    .with_context(|| format!("{} is not a JSON file of costs", path.display()))?
            }
        };
        let Parameters { sample_ms, view_ms, direct_ms, latency_ms, .. } = &mut parameters;
        for (given, cost) in [
            (self.sample_ms, sample_ms),
            (self.view_ms, view_ms),
            (self.direct_ms, direct_ms),
            (self.latency_ms, latency_ms),
        ] {
            *cost = given.unwrap_or(*cost);
        }
        if let Some(gbit) = self.link_gbit {
            parameters.link_bytes_per_sec = gbit * 1.25e8;
        }
        Ok(parameters)
    }
}

impl Cluster {
    pub(super) async fn run(self, quick: bool, progress: &ProgressBar) -> anyhow::Result<Report> {
        let mut options = Options::of(quick);
        self.scene.replace(&mut options.scene);
        self.size.replace(&mut options.size);
        if !self.views.is_empty() {
            options.views = self.views;
        }
        if let Some(processes) = self.processes {
            (options.processes, options.simulated) = (processes, vec![processes.max(2)]);
        }
        options.simulate = if self.simulate { Some(self.costs.parameters()?) } else { None };
        run(&std::env::current_exe()?, &options, progress).await
    }
}
