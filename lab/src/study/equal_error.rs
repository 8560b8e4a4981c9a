//! Arguments of `argus-lab study equal-error`.

use std::path::PathBuf;

use argus_studies::equal_error::{Mitsuba, Options, run};
use argus_studies::{Effort as _, Report};
use indicatif::ProgressBar;

use super::arguments::{Scene, Size, blocking};

/// Measures what a view with all light costs from samples, directly, by paths without a cache and by Mitsuba, at equal error
///
/// Without --scene: rooms; without --size: 200x150.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  argus-lab study equal-error --scene sponza.glb --mitsuba scripts/mitsuba --out figures")]
pub(super) struct EqualError {
    #[command(flatten)]
    scene: Scene,
    #[command(flatten)]
    size: Size,
    /// Number of views [default: 4]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=64))]
    views: Option<u16>,
    /// Paths of the reference for each of a pixel's 16 samples; its time is proportional [default: 8]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=4096))]
    paths: Option<u32>,
    /// Folder for all images
    #[arg(long, value_name = "DIR")]
    images: Option<PathBuf>,
    /// Measure Mitsuba 3, too, by this script: `scripts/mitsuba`, which installs it
    #[arg(long, value_name = "SCRIPT")]
    mitsuba: Option<PathBuf>,
    /// Paths a pixel of Mitsuba's converged images, against which its noise is judged
    #[arg(long, value_name = "N", default_value = "512", requires = "mitsuba", value_parser = clap::value_parser!(u32).range(2..=65536))]
    mitsuba_converged: u32,
}

impl EqualError {
    pub(super) async fn run(self, quick: bool, progress: &ProgressBar) -> anyhow::Result<Report> {
        let mut options = Options::of(quick);
        self.scene.replace(&mut options.scene);
        self.size.replace(&mut options.size);
        options.views = self.views.map_or(options.views, usize::from);
        options.truth_paths = self.paths.unwrap_or(options.truth_paths);
        options.images = self.images;
        let paths = [1, 4, 16, 64, 256];
        options.mitsuba = self.mitsuba.map(|script| Mitsuba {
            script,
            paths: paths.into_iter().filter(|paths| *paths < self.mitsuba_converged).collect(),
            converged: self.mitsuba_converged,
        });
        blocking(options, progress, run).await
    }
}
