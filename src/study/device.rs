//! Arguments of `argus study device`.

use argus_studies::device::{Options, run};
use argus_studies::{Effort as _, Report};
use indicatif::ProgressBar;

use super::arguments::{Scene, Size, blocking};

/// What the device does by itself: scattered atomics, rays, programs in fragments and in compute, readback, encoding; with
/// targets for a data-centre GPU
///
/// Without --scene: terrain:500000; without --size: 200x150. Targets stand beside these alone.
#[derive(clap::Args)]
pub(super) struct Device {
    #[command(flatten)]
    scene: Scene,
    #[command(flatten)]
    size: Size,
}

impl Device {
    pub(super) async fn run(self, quick: bool, progress: &ProgressBar) -> anyhow::Result<Report> {
        let mut options = Options::of(quick);
        self.scene.replace(&mut options.scene);
        self.size.replace(&mut options.size);
        blocking(options, progress, run).await
    }
}
