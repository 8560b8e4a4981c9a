//! Arguments of `argus-lab study bounds`.

use argus_studies::bounds::{Options, run};
use argus_studies::{Effort as _, Report};
use indicatif::ProgressBar;

use super::arguments::{Scenes, Size, blocking};

/// Measures how often error bounds hold in random views, and what they cost against the cheapest setting that keeps them.
/// The calibrated model is saved, and services on this machine use it from then on
///
/// Without --scene: terrain:500000; without --size: 200x150.
#[derive(clap::Args)]
pub(super) struct Bounds {
    #[command(flatten)]
    scenes: Scenes,
    #[command(flatten)]
    size: Size,
    /// Number of random views that test the bounds [default: 100]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=10_000))]
    views: Option<u16>,
    /// Number of further random views that calibrate the model [default: 100]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(8..=10_000))]
    calibration: Option<u16>,
}

impl Bounds {
    pub(super) async fn run(self, quick: bool, progress: &ProgressBar) -> anyhow::Result<Report> {
        let mut options = Options::of(quick);
        self.scenes.replace(&mut options.scenes);
        self.size.replace(&mut options.size);
        options.views = self.views.map_or(options.views, usize::from);
        options.calibration = self.calibration.map_or(options.calibration, usize::from);
        blocking(options, progress, run).await
    }
}
