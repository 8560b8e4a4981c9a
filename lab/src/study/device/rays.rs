//! Arguments of `argus-lab study device rays`.

use argus_studies::device::rays::{Options, run};
use argus_studies::{Effort as _, Report};
use indicatif::ProgressBar;

use crate::study::arguments::{Scenes, Size, blocking};

/// Measures the tracers in millions of rays a second: primary rays, shadow rays to the sun and to a point light, sky rays
/// and bounces, on one thread of the CPU, on all, and on the device
///
/// Without a device its rows are left out. Without --scene: terrain:500000; without --size: 400x300.
#[derive(clap::Args)]
#[command(after_help = "\
Example:
  argus-lab study device rays --scene sponza.glb --json")]
pub(in crate::study) struct RayStudy {
    #[command(flatten)]
    scenes: Scenes,
    #[command(flatten)]
    size: Size,
    /// Number of viewpoints whose visible points rays start from [default: 4]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=256))]
    views: Option<u16>,
    /// Number of measured rounds, after one that is not counted; times are their median [default: 5]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1000))]
    rounds: Option<u16>,
}

impl RayStudy {
    pub(in crate::study) async fn run(self, quick: bool, progress: &ProgressBar) -> anyhow::Result<Report> {
        let mut options = Options::of(quick);
        self.scenes.replace(&mut options.scenes);
        self.size.replace(&mut options.size);
        options.views = self.views.map_or(options.views, usize::from);
        options.rounds = self.rounds.map_or(options.rounds, usize::from);
        blocking(options, progress, run).await
    }
}
