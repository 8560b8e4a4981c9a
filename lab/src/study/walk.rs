//! Arguments of `argus-lab study walk`.

use argus::args;
use argus_studies::walk::{Options, run};
use argus_studies::{Effort as _, Report};
use indicatif::ProgressBar;

use super::arguments::{Scene, Size, Workers};

/// Measures laps through a scene: pixels that no sample saw, and how they vanish as samples are placed where views have
/// holes
///
/// Without --scene: terrain:50000; without --size: 200x150.
#[derive(clap::Args)]
pub(super) struct Walk {
    #[command(flatten)]
    scene: Scene,
    #[command(flatten)]
    size: Size,
    #[command(flatten)]
    workers: Workers,
    /// Number of viewpoints in a lap [default: 48]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=10_000))]
    views: Option<u16>,
    /// Number of laps [default: 6]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1000))]
    laps: Option<u16>,
    /// Longest pause between two laps in seconds, for samples to be placed [default: 60]
    #[arg(long, value_name = "SECONDS", value_parser = args::positive)]
    pause: Option<f64>,
    #[command(flatten)]
    rig: args::PassedOn<args::Rig>,
}

impl Walk {
    pub(super) async fn run(self, quick: bool, progress: &ProgressBar) -> anyhow::Result<Report> {
        let mut options = Options::of(quick);
        self.scene.replace(&mut options.scene);
        self.size.replace(&mut options.size);
        self.workers.replace(&mut options.workers);
        options.views = self.views.map_or(options.views, usize::from);
        options.laps = self.laps.map_or(options.laps, usize::from);
        options.pause_secs = self.pause.unwrap_or(options.pause_secs);
        options.serve = self.rig.arguments;
        run(&std::env::current_exe()?, &options, progress).await
    }
}
