//! Arguments of the study.

use std::ops::RangeInclusive;
use std::path::PathBuf;

use super::stage::Pose;
use super::ways::TapRule;
use crate::arguments::{count, or_quick, size};

/// Parts of the study, each with a table of its own.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Part {
    /// Points and their rivals: tables 1 and 2, figures 7 and 8.
    Reflections,
    /// Error against time for reflectors of several sizes, densities and rules for the number of taps: figure 6.
    Accuracy,
    /// Several bounces between two cylinders: figure 5.
    Recursion,
    /// Stability over time: the eye and all reflectors move.
    Motion,
    /// Shadows of a spherical light: table 3 and figure 10.
    Shadows,
}

/// Measures eye-based point rendering (reflections by points as dense as the eye's pixels) beside its alternatives: points,
/// shades, memory, time and error
///
/// All on the CPU; needs no GPU. With --out, the folder also gets the pictures of all rows.
#[derive(Debug, Clone, clap::Args)]
#[command(after_help = "\
Example:
  argus-lab study method eye-points --scene sponza.glb --reflectors 1,10,50 --size 1920x1080 --out figures")]
pub struct Options {
    /// A file, `terrain[:TRIANGLES]`, `mirrors[:BALLS]` or `rooms[:WALL_MM]`; `+balls:N` after it for mirroring balls,
    /// `?environment=FILE` for another sky
    #[arg(long, value_name = "S", default_value = "rooms")]
    pub scene: String,
    /// Size of a view in pixels
    #[arg(long, value_name = "WxH", value_parser = size, default_value = or_quick("640x360", "96x72"))]
    pub size: [u32; 2],
    /// What is measured
    #[arg(long, value_name = "PART", default_value = "reflections")]
    pub part: Part,
    /// Numbers of points of the light of --part shadows
    #[arg(long, value_name = "N", value_delimiter = ',', value_parser = clap::value_parser!(u32).range(1..=256), default_value = "1,5,10,20")]
    pub light_samples: Vec<u32>,
    /// Frames of --part motion
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(2..=10_000), default_value = or_quick("8", "2"))]
    pub frames: u32,
    /// Numbers of mirroring balls that are added to the scene; 0 for the scene's own reflective objects
    #[arg(long, value_name = "N", value_delimiter = ',', value_parser = clap::value_parser!(u32).range(0..=2048), default_value = or_quick("1,10,50", "3"))]
    pub reflectors: Vec<u32>,
    /// Where the eye is
    #[arg(long, value_name = "P", value_delimiter = ',', default_value = "distant,close")]
    pub poses: Vec<Pose>,
    /// Points for each pixel of the view, by area (the paper's rho_scale), 0.01 to 16
    #[arg(long = "density", value_name = "D", value_delimiter = ',', value_parser = density, default_value = or_quick("0.25,0.5,1", "0.5"))]
    pub densities: Vec<f64>,
    /// Lookups of each reflective pixel
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=256), default_value = or_quick("25", "4"))]
    pub taps: u32,
    /// Rules for the number of lookups of --part accuracy
    #[arg(long, value_name = "RULE", value_delimiter = ',', default_value = "fixed,adaptive")]
    pub tap_rules: Vec<TapRule>,
    /// Mean diameters of the reflectors in sight for --part accuracy, in pixels of a view of 1080 rows; other heights scale them
    #[arg(long, value_name = "PX", value_delimiter = ',', value_parser = reflector_pixels, default_value = or_quick("68,106,128,160,208,230,260", "128"))]
    pub reflector_pixels: Vec<f64>,
    /// Rows of --part reflections, to leave out those that take long: `points`, `points-planar`, `points-culled`,
    /// `points-bufferless`, `points-hybrid`, `points-compute`, `points-device`, `ivir`, `mvr-adaptive`, `mvr-512`, `traced-maps`, `rays` [default: all]
    #[arg(long, value_name = "WAY", value_delimiter = ',')]
    pub ways: Vec<String>,
    /// Most points, 8 bytes each. A smaller number lowers the density where needed
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1 << 30), default_value = "33554432")]
    pub budget: u32,
    /// Number of measured rounds; times are their median
    #[arg(long, value_name = "N", value_parser = count, default_value = "1")]
    pub rounds: usize,
    /// Folder for the images of all rows.
    #[arg(skip)]
    pub images: Option<PathBuf>,
}

fn density(text: &str) -> Result<f64, String> {
    within(text, 0.01..=16.0)
}

fn reflector_pixels(text: &str) -> Result<f64, String> {
    within(text, 1.0..=4096.0)
}

fn within(text: &str, range: RangeInclusive<f64>) -> Result<f64, String> {
    let number = text.parse().ok().filter(|number| range.contains(number));
    number.ok_or_else(|| format!("must be a number from {} to {}", range.start(), range.end()))
}
