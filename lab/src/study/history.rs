//! Arguments of `argus-lab study history`.

use argus::args;
use argus_studies::history::{Options, run};
use argus_studies::{Effort as _, Report};
use indicatif::ProgressBar;

use super::arguments::{Scene, Size, blocking};

/// Measures temporal reprojection: whether a session's search should start from its previous frame or from samples,
/// by time and error against the camera's motion, and over a chain of frames
///
/// Without --scene: terrain:500000; without --size: 200x150.
#[derive(clap::Args)]
pub(super) struct History {
    #[command(flatten)]
    scene: Scene,
    #[command(flatten)]
    size: Size,
    /// Number of views in the walk [default: 12]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=256))]
    views: Option<u16>,
    #[command(flatten)]
    rig: args::Rig,
}

impl History {
    pub(super) async fn run(self, quick: bool, progress: &ProgressBar) -> anyhow::Result<Report> {
        let mut options = Options::of(quick);
        self.scene.replace(&mut options.scene);
        self.size.replace(&mut options.size);
        options.views = self.views.map_or(options.views, usize::from);
        options.rig = self.rig.knobs();
        options.samples = self.rig.samples.map_or(options.samples, |n| n as usize);
        blocking(options, progress, run).await
    }
}
