//! Arguments of `argus-lab study device parts`.

use argus_studies::device::parts::{Options, run};
use argus_studies::{Effort as _, Report};
use indicatif::ProgressBar;

use crate::study::arguments::{Scene, Size, blocking};

/// Measures parts of the device: scattered atomics, rays, fragment and compute programs, readback, encoding; with targets
/// for a data-centre GPU
///
/// Without --scene: terrain:500000; without --size: 200x150. Only these have targets.
#[derive(clap::Args)]
pub(in crate::study) struct Parts {
    #[command(flatten)]
    scene: Scene,
    #[command(flatten)]
    size: Size,
}

impl Parts {
    pub(in crate::study) async fn run(self, quick: bool, progress: &ProgressBar) -> anyhow::Result<Report> {
        let mut options = Options::of(quick);
        self.scene.replace(&mut options.scene);
        self.size.replace(&mut options.size);
        blocking(options, progress, run).await
    }
}
