//! Arguments of `argus-lab study method eye-points`.

use std::path::PathBuf;

use argus_studies::papers::eye_points::{Options, Part, Pose, TapRule, run};
use argus_studies::{Effort as _, Report};
use indicatif::ProgressBar;

use crate::study::arguments::{Scene, Size, blocking};

/// Measures eye-based point rendering (reflections by points as dense as the eye's pixels) beside its alternatives: points,
/// shades, memory, time and error
///
/// All on the CPU; needs no GPU. Without --scene: rooms; without --size: 640x360. With --out, also pictures of all rows.
#[derive(clap::Args)]
#[command(after_help = "\
Example:
  argus-lab study method eye-points --scene sponza.glb --reflectors 1,10,50 --size 1920x1080 --out figures")]
pub(in crate::study) struct EyePoints {
    #[command(flatten)]
    scene: Scene,
    #[command(flatten)]
    size: Size,
    /// What is measured: `reflections` (points and their rivals), `accuracy` (error against time, with plots), `recursion` (one to three bounces between two cylinders),
    /// `motion` (stability over time) or `shadows` (of a spherical light) [default: reflections]
    #[arg(long, value_name = "PART", value_parser = part)]
    part: Option<Part>,
    /// Numbers of points of the light of --part shadows [default: 1,5,10,20]
    #[arg(long, value_name = "N", value_delimiter = ',', value_parser = clap::value_parser!(u32).range(1..=256))]
    light_samples: Vec<u32>,
    /// Frames of --part motion [default: 8]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(2..=10_000))]
    frames: Option<u32>,
    /// Numbers of mirroring balls that are added to the scene; 0 for the scene's own reflective objects [default: 1,10,50]
    #[arg(long, value_name = "N", value_delimiter = ',', value_parser = clap::value_parser!(u32).range(0..=2048))]
    reflectors: Vec<u32>,
    /// Where the eye is: `distant`, at the scene's first viewpoint, or `close` to a ball [default: distant,close]
    #[arg(long, value_name = "P", value_delimiter = ',', value_parser = pose)]
    poses: Vec<Pose>,
    /// Points for each pixel of the view, by area (the paper's rho_scale), 0.01 to 16 [default: 0.25,0.5,1]
    #[arg(long, value_name = "D", value_delimiter = ',', value_parser = density)]
    density: Vec<f64>,
    /// Lookups of each reflective pixel, 1 to 256; for --part accuracy also `fixed`, `adaptive` (four more until the variance
    /// of their colour declines no more) or both [default: 25,fixed,adaptive]
    #[arg(long, value_name = "N", value_delimiter = ',', value_parser = taps)]
    taps: Vec<Taps>,
    /// Mean diameters of the reflectors in sight for --part accuracy, in pixels of a view of 1080 rows; other heights scale them
    /// [default: 68,106,128,160,208,230,260]
    #[arg(long, value_name = "PX", value_delimiter = ',', value_parser = reflector_pixels)]
    reflector_pixels: Vec<f64>,
    /// Rows of --part reflections, to leave out those that take long: `points`, `points-planar`, `points-culled`,
    /// `points-bufferless`, `points-hybrid`, `ivir`, `mvr-adaptive`, `mvr-512`, `traced-maps`, `rays` [default: all]
    #[arg(long, value_name = "WAY", value_delimiter = ',')]
    ways: Vec<String>,
    /// Most points, 8 bytes each. A smaller number lowers the density where needed [default: 33554432]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1 << 30))]
    budget: Option<u32>,
    /// Number of measured rounds; times are their median [default: 1]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1000))]
    rounds: Option<u16>,
}

/// A number of taps, or a rule for it.
#[derive(Debug, Clone, Copy)]
enum Taps {
    Number(u32),
    Rule(TapRule),
}

fn taps(text: &str) -> Result<Taps, String> {
    let rule = TapRule::ALL.into_iter().find(|rule| rule.to_string() == text).map(Taps::Rule);
    let number = || text.parse().ok().filter(|number| (1..=256).contains(number)).map(Taps::Number);
    rule.or_else(number).ok_or_else(|| "must be a number from 1 to 256, fixed or adaptive".to_owned())
}

fn reflector_pixels(text: &str) -> Result<f64, String> {
    let within = |pixels: &f64| (1.0..=4096.0).contains(pixels);
    text.parse().ok().filter(within).ok_or_else(|| "must be a number from 1 to 4096".to_owned())
}

fn part(text: &str) -> Result<Part, String> {
    let found = Part::ALL.into_iter().find(|part| part.to_string() == text);
    found.ok_or_else(|| format!("must be one of {}", Part::ALL.map(|part| part.to_string()).join(", ")))
}

fn pose(text: &str) -> Result<Pose, String> {
    let found = Pose::ALL.into_iter().find(|pose| pose.to_string() == text);
    found.ok_or_else(|| "must be distant or close".to_owned())
}

fn density(text: &str) -> Result<f64, String> {
    let within = |density: &f64| (0.01..=16.0).contains(density);
    text.parse().ok().filter(within).ok_or_else(|| "must be a number from 0.01 to 16".to_owned())
}

impl EyePoints {
    pub(in crate::study) async fn run(
        self,
        quick: bool,
        out: Option<PathBuf>,
        progress: &ProgressBar,
    ) -> anyhow::Result<Report> {
        let mut options = Options::of(quick);
        self.scene.replace(&mut options.scene);
        self.size.replace(&mut options.size);
        if !self.reflectors.is_empty() {
            options.reflectors = self.reflectors;
        }
        if !self.poses.is_empty() {
            options.poses = self.poses;
        }
        if !self.density.is_empty() {
            options.densities = self.density;
        }
        options.part = self.part.unwrap_or(options.part);
        options.frames = self.frames.unwrap_or(options.frames);
        if !self.light_samples.is_empty() {
            options.light_samples = self.light_samples;
        }
        let mut rules = Vec::new();
        for taps in self.taps {
            match taps {
                Taps::Number(number) => options.taps = number,
                Taps::Rule(rule) => rules.push(rule),
            }
        }
        if !rules.is_empty() {
            options.tap_rules = rules;
        }
        if !self.reflector_pixels.is_empty() {
            options.reflector_pixels = self.reflector_pixels;
        }
        options.ways = self.ways;
        options.budget = self.budget.unwrap_or(options.budget);
        options.rounds = self.rounds.map_or(options.rounds, usize::from);
        options.images = out;
        blocking(options, progress, run).await
    }
}
