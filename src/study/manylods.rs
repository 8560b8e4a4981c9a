//! Arguments of `argus study manylods`.

use argus_studies::manylods::{Options, run};
use argus_studies::megaviews::{Emitter, parse_light};
use argus_studies::{Effort as _, Report};
use indicatif::ProgressBar;

use super::arguments::{Scene, blocking};

/// Cuts of many views through a tree of balls and an octree: what it takes to make and fit the hierarchies, to find cuts
/// at several thresholds, anew or from the last frame's as views or the scene move, and what their maps are worth beside
/// imperfect and rasterised ones that take as long
///
/// Without --scene: terrain:50000.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  argus study manylods --scene sponza.glb --light spot:0,10,0:0,-1,0:35 --out figures
  argus study manylods --scene sponza.glb --views 256 --threshold 1,2 --motion 0.1,0.2,0.5 --json")]
pub(super) struct ManyLods {
    #[command(flatten)]
    scene: Scene,
    /// Views, where light meets surfaces first [default: 1024]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1_048_576))]
    views: Option<u32>,
    /// Texels of a hemisphere's side, a power of two [default: 16]
    #[arg(long, value_name = "TEXELS", value_parser = clap::value_parser!(u32).range(8..=256))]
    resolution: Option<u32>,
    /// Levels of the octree below its root [default: 9]
    #[arg(long, value_name = "L", value_parser = clap::value_parser!(u32).range(1..=10))]
    levels: Option<u32>,
    /// Levels of the tree of balls: it has 2^L points [default: 20]
    #[arg(long, value_name = "L", value_parser = clap::value_parser!(u32).range(1..=22))]
    ball_levels: Option<u32>,
    /// How large nodes may appear, texels [default: 1,2,4]
    #[arg(long, value_name = "TEXELS", value_delimiter = ',', value_parser = clap::value_parser!(f32))]
    threshold: Vec<f32>,
    /// Motion a frame, percent of the scene's largest extent [default: 0.05,0.1,0.2,0.5,1]
    #[arg(long, value_name = "PERCENT", value_delimiter = ',', value_parser = crate::args::positive)]
    motion: Vec<f64>,
    /// Frames of an animation that count [default: 24]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=10_000))]
    frames: Option<u32>,
    /// Edges that a lazy cut is followed down in a frame [default: 1]
    #[arg(long, value_name = "Q", value_parser = clap::value_parser!(u32).range(1..=32))]
    edges: Option<u32>,
    /// Motion by which lazy cuts may lag, percent of the scene [default: 0.5]
    #[arg(long, value_name = "PERCENT", value_parser = crate::args::positive)]
    lag: Option<f64>,
    /// Where light comes from: point:X,Y,Z or spot:X,Y,Z:DX,DY,DZ:HALF_DEG [default: the scene's first light that has
    /// a place, else a spot from above its middle]
    #[arg(long, value_name = "LIGHT", value_parser = parse_light, allow_hyphen_values = true)]
    light: Option<Emitter>,
    /// Frames that times are the median of where nothing moves [default: 3]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1000))]
    rounds: Option<u16>,
}

impl ManyLods {
    pub(super) async fn run(self, quick: bool, progress: &ProgressBar) -> anyhow::Result<Report> {
        let mut options = Options::of(quick);
        self.scene.replace(&mut options.scene);
        options.views = self.views.unwrap_or(options.views);
        options.resolution = self.resolution.unwrap_or(options.resolution);
        options.levels = self.levels.unwrap_or(options.levels);
        options.ball_levels = self.ball_levels.unwrap_or(options.ball_levels);
        if !self.threshold.is_empty() {
            options.thresholds = self.threshold;
        }
        if !self.motion.is_empty() {
            options.motions = self.motion.iter().map(|percent| percent / 100.0).collect();
        }
        options.frames = self.frames.unwrap_or(options.frames);
        options.edges = self.edges.unwrap_or(options.edges);
        options.lag = self.lag.map_or(options.lag, |percent| percent / 100.0);
        options.light = self.light.or(options.light);
        options.rounds = self.rounds.map_or(options.rounds, usize::from);
        blocking(options, progress, run).await
    }
}
