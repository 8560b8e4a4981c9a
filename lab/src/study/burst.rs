//! Arguments of `argus-lab study burst`.

use argus_studies::burst::{Options, run};
use argus_studies::{Effort as _, Report};
use indicatif::ProgressBar;

use super::arguments::{Scene, Workers};

/// Measures many views at once over gRPC, from a cluster without samples, against rendering them all directly
///
/// Without --scene: terrain:500000.
#[derive(clap::Args)]
pub(super) struct Burst {
    #[command(flatten)]
    scene: Scene,
    /// Number of views [default: 290]
    #[arg(long, value_name = "N")]
    views: Option<u32>,
    #[command(flatten)]
    workers: Workers,
}

impl Burst {
    pub(super) async fn run(self, quick: bool, progress: &ProgressBar) -> anyhow::Result<Report> {
        let mut options = Options::of(quick);
        self.scene.replace(&mut options.scene);
        options.views = self.views.unwrap_or(options.views);
        self.workers.replace(&mut options.workers);
        run(&std::env::current_exe()?, &options, progress).await
    }
}
