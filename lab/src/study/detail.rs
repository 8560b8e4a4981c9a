//! Arguments of `argus-lab study detail`.

use argus_studies::detail::{Options, run};
use argus_studies::{Effort as _, Report};
use indicatif::ProgressBar;

use super::arguments::{Scenes, Size, blocking};

/// Measures views from triangles in less detail: time and error, which the planner weighs under load
///
/// Without --scene: terrain of 50000 and 500000 triangles, and rooms; without --size: 320x240.
#[derive(clap::Args)]
pub(super) struct DetailStudy {
    #[command(flatten)]
    scenes: Scenes,
    #[command(flatten)]
    size: Size,
}

impl DetailStudy {
    pub(super) async fn run(self, quick: bool, progress: &ProgressBar) -> anyhow::Result<Report> {
        let mut options = Options::of(quick);
        self.scenes.replace(&mut options.scenes);
        self.size.replace(&mut options.size);
        blocking(options, progress, run).await
    }
}
