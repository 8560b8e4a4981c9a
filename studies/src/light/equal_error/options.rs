//! Arguments of the study.

use std::path::PathBuf;

use super::mitsuba::Mitsuba;
use crate::arguments::{count, or_quick, positive, size};

/// Measures what a view with all light costs from samples, directly, by paths without a cache and by Mitsuba, at equal error
#[derive(Debug, Clone, clap::Args)]
#[command(after_help = "\
Examples:
  argus-lab study light equal-error --scene sponza.glb --mitsuba scripts/mitsuba --out figures")]
pub struct Options {
    /// A file, `terrain[:TRIANGLES]`, `mirrors[:BALLS]` or `rooms[:WALL_MM]`; `+balls:N` after it for mirroring balls,
    /// `?environment=FILE` for another sky
    #[arg(long, value_name = "S", default_value = "rooms")]
    pub scene: String,
    /// Size of a view in pixels
    #[arg(long, value_name = "WxH", value_parser = size, default_value = or_quick("200x150", "48x36"))]
    pub size: [u32; 2],
    /// Number of views, along a walk from the scene's viewpoints
    #[arg(long, value_name = "N", value_parser = count, default_value = or_quick("4", "2"))]
    pub views: usize,
    /// Samples that a view is warped from
    #[arg(long, value_name = "N", value_parser = count, default_value = or_quick("4", "2"))]
    pub samples: usize,
    /// Distances in metres of direct frames that serve as samples, to the left and right of a view
    #[arg(long, value_name = "LIST", value_delimiter = ',', default_value = or_quick("0.05,0.2,0.8", "0.1"))]
    pub frames_aside: Vec<f64>,
    /// Resolutions of samples: texels along a cube's edge x sub-samples of a texel
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = size, default_value = or_quick("512x4,256x4,256x1,128x1,64x1", "64x1"))]
    pub resolutions: Vec<[u32; 2]>,
    /// Settings of the tracer without cache: samples a pixel x paths of each
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = size, default_value = or_quick("1x1,1x4,4x4,4x16,16x16", "1x1,1x4"))]
    pub tracer: Vec<[u32; 2]>,
    /// Samples a pixel of direct views
    #[arg(long, value_name = "LIST", value_delimiter = ',', default_value = or_quick("1,4,16", "1,4"))]
    pub direct: Vec<u32>,
    /// Seconds of a view beyond which slower settings of the tracer are left out
    #[arg(long, value_name = "SECONDS", value_parser = positive, default_value = "20")]
    pub patience_secs: f64,
    /// Measure Mitsuba 3, too, by this script: `scripts/mitsuba`, which installs it
    #[arg(long, value_name = "SCRIPT")]
    pub mitsuba: Option<PathBuf>,
    /// Paths a pixel of Mitsuba's converged images, against which its noise is judged
    #[arg(long, value_name = "N", default_value = "512", requires = "mitsuba", value_parser = clap::value_parser!(u32).range(2..=65536))]
    pub mitsuba_converged: u32,
    /// Samples a pixel of the reference
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..), default_value = or_quick("16", "4"))]
    pub truth_samples: u32,
    /// Paths of the reference for each of these samples; its time is proportional
    #[arg(long = "paths", value_name = "N", value_parser = clap::value_parser!(u32).range(1..), default_value = or_quick("8", "4"))]
    pub truth_paths: u32,
    /// Number of measured rounds, after one that is not counted; times are their median
    #[arg(long, value_name = "N", value_parser = count, default_value = or_quick("3", "1"))]
    pub rounds: usize,
    /// Folder for all images
    #[arg(long, value_name = "DIR")]
    pub images: Option<PathBuf>,
}

impl Options {
    /// Mitsuba, if it is to be measured.
    pub(super) fn mitsuba(&self) -> Option<Mitsuba> {
        let (script, converged) = (self.mitsuba.clone()?, self.mitsuba_converged);
        let paths = [1, 4, 16, 64, 256].into_iter().filter(|paths| *paths < converged).collect();
        Some(Mitsuba { script, paths, converged })
    }
}
