//! Arguments of `argus-lab study break-even`.

use argus::args;
use argus_studies::break_even::{Options, run};
use argus_studies::{Effort as _, Report};
use indicatif::ProgressBar;

use super::arguments::{Scenes, Size, blocking};

/// Measures from how many views on samples are cheaper than direct views, for each visibility backend
///
/// Without --scene: terrain:2000000; without --size: 200x150.
#[derive(clap::Args)]
pub(super) struct BreakEven {
    #[command(flatten)]
    scenes: Scenes,
    #[command(flatten)]
    size: Size,
    #[command(flatten)]
    rig: args::Rig,
}

impl BreakEven {
    pub(super) async fn run(self, quick: bool, progress: &ProgressBar) -> anyhow::Result<Report> {
        let mut options = Options::of(quick);
        self.scenes.replace(&mut options.scenes);
        self.size.replace(&mut options.size);
        options.rig = self.rig.knobs();
        options.samples = self.rig.samples.map_or(options.samples, |n| n as usize);
        blocking(options, progress, run).await
    }
}
