//! Arguments of the study.

use crate::arguments::{count, or_quick, percent};
use crate::papers::megaviews::{Emitter, parse_light};

/// Measures cuts of many views through a tree of balls and an octree (ManyLoDs): building and refitting the hierarchies,
/// finding cuts at several thresholds, anew or from the last frame's, and the error of their maps beside imperfect and
/// rasterised maps that take as long
#[derive(Debug, Clone, clap::Args)]
#[command(after_help = "\
Examples:
  argus-lab study method manylods --scene sponza.glb --light spot:0,10,0:0,-1,0:35 --out figures
  argus-lab study method manylods --scene sponza.glb --views 256 --threshold 1,2 --motion 0.1,0.2,0.5 --json")]
pub struct Options {
    /// A file, `terrain[:TRIANGLES]`, `mirrors[:BALLS]` or `rooms[:WALL_MM]`; `+balls:N` after it for mirroring balls,
    /// `?environment=FILE` for another sky
    #[arg(long, value_name = "S", default_value = or_quick("terrain:50000", "terrain:20000"))]
    pub scene: String,
    /// Number of views, placed where light first meets surfaces
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1_048_576), default_value = or_quick("1024", "64"))]
    pub views: u32,
    /// Side of a hemisphere's map in texels, a power of two
    #[arg(long, value_name = "TEXELS", value_parser = clap::value_parser!(u32).range(8..=256), default_value = "16")]
    pub resolution: u32,
    /// Levels of the octree below its root
    #[arg(long, value_name = "L", value_parser = clap::value_parser!(u32).range(1..=10), default_value = or_quick("9", "5"))]
    pub levels: u32,
    /// Levels of the tree of balls, which has 2^L points
    #[arg(long, value_name = "L", value_parser = clap::value_parser!(u32).range(1..=22), default_value = or_quick("20", "12"))]
    pub ball_levels: u32,
    /// Largest projected size of a node in texels; larger is faster and coarser
    #[arg(long = "threshold", value_name = "TEXELS", value_delimiter = ',', default_value = or_quick("1,2,4", "1,4"))]
    pub thresholds: Vec<f32>,
    /// Motion per frame, in percent of the scene's largest extent
    #[arg(long = "motion", value_name = "PERCENT", value_delimiter = ',', value_parser = percent, default_value = or_quick("0.05,0.1,0.2,0.5,1", "0.2,0.5"))]
    pub motions: Vec<f64>,
    /// Number of measured frames of an animation
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=10_000), default_value = or_quick("24", "8"))]
    pub frames: u32,
    /// Edges that a lazy cut may follow down in a frame; more edges cost time and lag less
    #[arg(long, value_name = "Q", value_parser = clap::value_parser!(u32).range(1..=32), default_value = "1")]
    pub edges: u32,
    /// How far lazy cuts may lag, in percent of the scene
    #[arg(long, value_name = "PERCENT", value_parser = percent, default_value = "0.5")]
    pub lag: f64,
    /// Light that places the views: point:X,Y,Z or spot:X,Y,Z:DX,DY,DZ:HALF_DEG [default: the scene's first point or
    /// spot light, else a spot light above its middle]
    #[arg(long, value_name = "LIGHT", value_parser = parse_light, allow_hyphen_values = true)]
    pub light: Option<Emitter>,
    /// Number of measured frames where nothing moves; times are their median
    #[arg(long, value_name = "N", value_parser = count, default_value = or_quick("3", "1"))]
    pub rounds: usize,
}
