//! Arguments of `argus-lab study method omni-maps`.

use argus::args;
use argus_studies::papers::omni_maps::{Options, run};
use argus_studies::{Effort as _, Report};
use indicatif::ProgressBar;

use crate::study::arguments::{Scene, Size, blocking};

/// Measures omnidirectional samples from triangles beside those from maps of an octree (`argus serve --sampling
/// megaviews`): their cost, and the error of views warped from them
///
/// Without --scene: terrain:500000; without --size: 400x300.
#[derive(clap::Args)]
#[command(after_help = "\
Example:
  LP_NUM_THREADS=1 argus-lab study method omni-maps --scene sponza.glb --map-side 256,512,1024 --levels 8,9,10 --out figures")]
pub(in crate::study) struct OmniMaps {
    #[command(flatten)]
    scene: Scene,
    #[command(flatten)]
    size: Size,
    /// Number of views in the walk [default: 4]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=256))]
    views: Option<u16>,
    #[command(flatten)]
    rig: args::Rig,
    /// Side of a map's hemisphere in texels [default: 256,512]
    #[arg(long, value_name = "TEXELS", value_delimiter = ',', value_parser = clap::value_parser!(u32).range(8..=1024))]
    map_side: Vec<u32>,
    /// Levels of the scene's octree below its root [default: 8,9]
    #[arg(long, value_name = "L", value_delimiter = ',', value_parser = clap::value_parser!(u32).range(1..=10))]
    levels: Vec<u32>,
    /// Cameras along an edge of the blocks that share maps: 1, 2 or 4 [default: 1]
    #[arg(long, value_name = "N", value_delimiter = ',', value_parser = block)]
    block: Vec<u32>,
    /// Number of measured rounds, after one that is not counted; times are their median [default: 3]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1000))]
    rounds: Option<u16>,
}

impl OmniMaps {
    pub(in crate::study) async fn run(self, quick: bool, progress: &ProgressBar) -> anyhow::Result<Report> {
        let mut options = Options::of(quick);
        self.scene.replace(&mut options.scene);
        self.size.replace(&mut options.size);
        options.views = self.views.map_or(options.views, usize::from);
        let rig = self.rig.settings();
        options.rig = argus_scene::RigSettings { face: rig.face.or(options.rig.face), ..rig };
        options.samples = self.rig.samples.map_or(options.samples, |n| n as usize);
        for (said, default) in [
            (self.map_side, &mut options.map_sides),
            (self.levels, &mut options.levels),
            (self.block, &mut options.blocks),
        ] {
            if !said.is_empty() {
                *default = said;
            }
        }
        options.rounds = self.rounds.map_or(options.rounds, usize::from);
        blocking(options, progress, run).await
    }
}

fn block(text: &str) -> Result<u32, String> {
    match text {
        "1" => Ok(1),
        "2" => Ok(2),
        "4" => Ok(4),
        _ => Err("must be 1, 2 or 4".to_owned()),
    }
}
