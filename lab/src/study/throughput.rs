//! Arguments of `argus-lab study throughput`.

use argus_studies::throughput::{Options, run};
use argus_studies::{Effort as _, Report};
use indicatif::ProgressBar;

use super::arguments::{Scene, Sizes, Workers};

/// Measures warped views per second of one scene: on the device, read back, and delivered over gRPC
///
/// Without --scene: terrain:500000; without --size: 128x128 and 200x150.
#[derive(clap::Args)]
pub(super) struct Throughput {
    #[command(flatten)]
    scene: Scene,
    #[command(flatten)]
    sizes: Sizes,
    #[command(flatten)]
    workers: Workers,
    /// Number of views in a batch; larger batches are faster and use more memory [default: 256]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=4096))]
    batch: Option<u16>,
}

impl Throughput {
    pub(super) async fn run(self, quick: bool, progress: &ProgressBar) -> anyhow::Result<Report> {
        let mut options = Options::of(quick);
        self.scene.replace(&mut options.scene);
        self.sizes.replace(&mut options.sizes);
        self.workers.replace(&mut options.workers);
        options.batch = self.batch.map_or(options.batch, usize::from);
        run(&std::env::current_exe()?, &options, progress).await
    }
}
