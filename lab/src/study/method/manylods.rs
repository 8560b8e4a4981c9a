//! Arguments of `argus-lab study method manylods`.

use argus_studies::papers::manylods::{Options, run};
use argus_studies::papers::megaviews::{Emitter, parse_light};
use argus_studies::{Effort as _, Report};
use indicatif::ProgressBar;

use crate::study::arguments::{Scene, blocking};

/// Measures cuts of many views through a tree of balls and an octree (ManyLoDs): building and refitting the hierarchies,
/// finding cuts at several thresholds, anew or from the last frame's, and the error of their maps beside imperfect and
/// rasterised maps that take as long
///
/// Without --scene: terrain:50000.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  argus-lab study method manylods --scene sponza.glb --light spot:0,10,0:0,-1,0:35 --out figures
  argus-lab study method manylods --scene sponza.glb --views 256 --threshold 1,2 --motion 0.1,0.2,0.5 --json")]
pub(in crate::study) struct ManyLods {
    #[command(flatten)]
    scene: Scene,
    /// Number of views, placed where light first meets surfaces [default: 1024]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1_048_576))]
    views: Option<u32>,
    /// Side of a hemisphere's map in texels, a power of two [default: 16]
    #[arg(long, value_name = "TEXELS", value_parser = clap::value_parser!(u32).range(8..=256))]
    resolution: Option<u32>,
    /// Levels of the octree below its root [default: 9]
    #[arg(long, value_name = "L", value_parser = clap::value_parser!(u32).range(1..=10))]
    levels: Option<u32>,
    /// Levels of the tree of balls, which has 2^L points [default: 20]
    #[arg(long, value_name = "L", value_parser = clap::value_parser!(u32).range(1..=22))]
    ball_levels: Option<u32>,
    /// Largest projected size of a node in texels; larger is faster and coarser [default: 1,2,4]
    #[arg(long, value_name = "TEXELS", value_delimiter = ',', value_parser = clap::value_parser!(f32))]
    threshold: Vec<f32>,
    /// Motion per frame, in percent of the scene's largest extent [default: 0.05,0.1,0.2,0.5,1]
    #[arg(long, value_name = "PERCENT", value_delimiter = ',', value_parser = argus::args::positive)]
    motion: Vec<f64>,
    /// Number of measured frames of an animation [default: 24]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=10_000))]
    frames: Option<u32>,
    /// Edges that a lazy cut may follow down in a frame; more edges cost time and lag less [default: 1]
    #[arg(long, value_name = "Q", value_parser = clap::value_parser!(u32).range(1..=32))]
    edges: Option<u32>,
    /// How far lazy cuts may lag, in percent of the scene [default: 0.5]
    #[arg(long, value_name = "PERCENT", value_parser = argus::args::positive)]
    lag: Option<f64>,
    /// Light that places the views: point:X,Y,Z or spot:X,Y,Z:DX,DY,DZ:HALF_DEG [default: the scene's first point or
    /// spot light, else a spot light above its middle]
    #[arg(long, value_name = "LIGHT", value_parser = parse_light, allow_hyphen_values = true)]
    light: Option<Emitter>,
    /// Number of measured frames where nothing moves; times are their median [default: 3]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1000))]
    rounds: Option<u16>,
}

impl ManyLods {
    pub(in crate::study) async fn run(self, quick: bool, progress: &ProgressBar) -> anyhow::Result<Report> {
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
