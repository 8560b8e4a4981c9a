//! Arguments of `argus-lab study visibility`.

use argus_studies::visibility::{Options, run};
use argus_studies::{Effort as _, Report};
use indicatif::ProgressBar;

use super::arguments::{Scenes, Sizes, blocking};

/// Measures the cost of each visibility backend, for whole views, single pixels and samples, and how far the backends
/// agree
///
/// Without --scene: terrain of 500000 and 2000000 triangles; without --size: 200x150 and 640x480.
#[derive(clap::Args)]
pub(super) struct Visibility {
    #[command(flatten)]
    scenes: Scenes,
    #[command(flatten)]
    sizes: Sizes,
}

impl Visibility {
    pub(super) async fn run(self, quick: bool, progress: &ProgressBar) -> anyhow::Result<Report> {
        let mut options = Options::of(quick);
        self.scenes.replace(&mut options.scenes);
        self.sizes.replace(&mut options.sizes);
        blocking(options, progress, run).await
    }
}
