//! Arguments of `argus-lab study method probes`.

use std::path::PathBuf;

use argus_studies::papers::probes::{Options, run};
use argus_studies::{Effort as _, Report};
use indicatif::ProgressBar;

use crate::study::arguments::{Scene, Size, blocking};

/// Measures reflection probes (`argus serve --reflections maps` and `points`): their cost beside brute force, and their error
/// against traced reflections
///
/// Without --scene: mirrors:60; without --size: 320x240.
#[derive(clap::Args)]
#[command(after_help = "\
Example:
  LP_NUM_THREADS=1 argus-lab study method probes --scene mirrors:400 --images pictures --out figures")]
pub(in crate::study) struct Probes {
    #[command(flatten)]
    scene: Scene,
    #[command(flatten)]
    size: Size,
    /// Side of a probe's map in texels, besides 64: powers of two [default: 16,32,128]
    #[arg(long, value_name = "TEXELS", value_delimiter = ',', value_parser = clap::value_parser!(u32).range(16..=256))]
    side: Vec<u32>,
    /// Levels of the scene's octree, besides 8 [default: 6,7,9]
    #[arg(long, value_name = "L", value_delimiter = ',', value_parser = clap::value_parser!(u32).range(1..=10))]
    levels: Vec<u32>,
    /// Number of measured rounds, after one that is not counted; times are their median [default: 3]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1000))]
    rounds: Option<u16>,
    /// Folder for images of all views, rows and references
    #[arg(long, value_name = "DIR")]
    images: Option<PathBuf>,
}

impl Probes {
    pub(in crate::study) async fn run(self, quick: bool, progress: &ProgressBar) -> anyhow::Result<Report> {
        let mut options = Options::of(quick);
        self.scene.replace(&mut options.scene);
        self.size.replace(&mut options.size);
        for (said, default) in [(self.side, &mut options.sides), (self.levels, &mut options.levels)] {
            if !said.is_empty() {
                *default = said;
            }
        }
        options.rounds = self.rounds.map_or(options.rounds, usize::from);
        options.images = self.images;
        blocking(options, progress, run).await
    }
}
