//! Arguments of the study.

use std::path::PathBuf;

use crate::arguments::{count, or_quick, size};

/// Measures what each effect of direct light costs and how much it changes, beside the bound of the effect plan
///
/// Each scene is rendered with effects auto, all and none, and with each effect switched. The command fails if an effect
/// changes more than its bound, if an effect of auto changes nothing, or if it changes nothing and costs more than 5% of a
/// frame. With --out, the folder also gets the pictures of all rows.
#[derive(Debug, Clone, clap::Args)]
pub struct Options {
    /// Scenes with commas between: `matt` (a ball that nothing shades), `room` (closed, at night, with a lamp), a file,
    /// `terrain[:TRIANGLES]`, `mirrors[:BALLS]` or `rooms[:WALL_MM]`
    #[arg(long = "scene", value_name = "S", value_delimiter = ',', default_value = or_quick("matt,room,rooms,terrain:100000,mirrors", "matt,room,terrain:3000"))]
    pub scenes: Vec<String>,
    /// Size of a view in pixels
    #[arg(long, value_name = "WxH", value_parser = size, default_value = or_quick("200x150", "64x48"))]
    pub size: [u32; 2],
    /// Samples a pixel of views: 1, 4 or 16
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..), default_value = "4")]
    pub samples_per_pixel: u32,
    /// Most views of a scene: the first of its own viewpoints
    #[arg(long, value_name = "N", value_parser = count, default_value = or_quick("3", "1"))]
    pub views: usize,
    /// Side of a cube face of the sample, texels
    #[arg(long, value_name = "TEXELS", value_parser = clap::value_parser!(u32).range(1..), default_value = or_quick("128", "24"))]
    pub face: u32,
    /// Rays to the sky and to emitters of the renderings whose change is judged, 2 to 64
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..), default_value = or_quick("32", "16"))]
    pub many_rays: u32,
    /// Number of measured rounds, after one that is not counted; times are their median
    #[arg(long, value_name = "N", value_parser = count, default_value = or_quick("5", "1"))]
    pub rounds: usize,
    /// Folder for pictures of all rows.
    #[arg(skip)]
    pub pictures: Option<PathBuf>,
}
