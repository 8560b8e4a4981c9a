//! Arguments of `argus-lab study effects`.

use std::path::PathBuf;

use argus_studies::effects::{Options, run};
use argus_studies::{Effort as _, Report};
use indicatif::ProgressBar;

use super::arguments::{Size, blocking};

/// Measures what each effect of direct light costs and how much it changes, beside the bound of the effect plan
///
/// Each scene is rendered with effects auto, all and none, and with each effect switched. The command fails if an effect
/// changes more than its bound, if an effect of auto changes nothing, or if it changes nothing and costs more than 5% of a
/// frame. Without --size: 200x150. With --out, the folder also gets the pictures of all rows.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  argus-lab study effects --out figures
  argus-lab study effects --scene sponza.glb,rooms --size 320x240
  argus-lab study effects --quick --json")]
pub(super) struct EffectStudy {
    /// Scenes with commas between: `matt` (a ball that nothing shades), `room` (closed, at night, with a lamp), a file,
    /// `terrain[:TRIANGLES]`, `mirrors[:BALLS]` or `rooms[:WALL_MM]` [default: matt,room,rooms,terrain:100000,mirrors]
    #[arg(long = "scene", value_name = "S", value_delimiter = ',')]
    scenes: Vec<String>,
    #[command(flatten)]
    size: Size,
    /// Side of a cube face of the sample, texels [default: 128]
    #[arg(long, value_name = "TEXELS", value_parser = clap::value_parser!(u32).range(8..=2048))]
    face: Option<u32>,
    /// Number of measured rounds, after one that is not counted; times are their median [default: 5]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1000))]
    rounds: Option<u16>,
}

impl EffectStudy {
    /// `out` is the folder for pictures.
    pub(super) async fn run(
        self,
        quick: bool,
        out: Option<PathBuf>,
        progress: &ProgressBar,
    ) -> anyhow::Result<Report> {
        let mut options = Options::of(quick);
        if !self.scenes.is_empty() {
            options.scenes = self.scenes;
        }
        self.size.replace(&mut options.size);
        options.face = self.face.unwrap_or(options.face);
        options.rounds = self.rounds.map_or(options.rounds, usize::from);
        options.pictures = out;
        blocking(options, progress, run).await
    }
}
