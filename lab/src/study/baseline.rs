//! Arguments of `argus-lab study baseline`.

use argus_studies::baseline::{Options, run};
use argus_studies::{Effort as _, Report};
use indicatif::ProgressBar;

use super::arguments::{Scenes, Sizes, blocking};

/// Measures the cost of direct views, samples, and the splat and linear searches, and their error against the reference
///
/// Without --scene: terrain of 50000, 500000 and 2000000 triangles; without --size: 200x150 and 640x480.
#[derive(clap::Args)]
pub(super) struct Baseline {
    #[command(flatten)]
    scenes: Scenes,
    #[command(flatten)]
    sizes: Sizes,
}

impl Baseline {
    pub(super) async fn run(self, quick: bool, progress: &ProgressBar) -> anyhow::Result<Report> {
        let mut options = Options::of(quick);
        self.scenes.replace(&mut options.scenes);
        self.sizes.replace(&mut options.sizes);
        blocking(options, progress, run).await
    }
}
