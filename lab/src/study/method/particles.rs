//! Arguments of `argus-lab study method particles`.

use std::path::PathBuf;

use argus::args;
use argus_scene::Camera;
use argus_studies::papers::particles::{Options, run};
use argus_studies::{Effort as _, Report};
use glam::DVec3;
use indicatif::ProgressBar;

use crate::study::arguments::{Scene, Size, blocking};

/// Measures glowing particles that drift through a scene: the time of their maps by MegaViews, ManyLoDs and exact
/// maps, and the error of the shadows and of a view that they light
///
/// Without --scene: terrain:50000; without --size: 192x144.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  argus-lab study method particles --scene sponza.glb --eye=-11,3,0 --target 0,4,0 --out figures --images pictures
  argus-lab study method particles --scene sponza.glb --particles 1024,4096 --levels 7 --json")]
pub(in crate::study) struct Particles {
    #[command(flatten)]
    scene: Scene,
    /// Numbers of particles, ascending [default: 4096,65536]
    #[arg(long, value_name = "N", value_delimiter = ',', value_parser = clap::value_parser!(u32).range(1..=1 << 20))]
    particles: Vec<u32>,
    /// Side of a hemisphere's map in texels [default: 16]
    #[arg(long, value_name = "TEXELS", value_parser = clap::value_parser!(u32).range(8..=256))]
    resolution: Option<u32>,
    /// Levels of the scene's octree below its root [default: 8]
    #[arg(long, value_name = "L", value_parser = clap::value_parser!(u32).range(1..=10))]
    levels: Option<u32>,
    /// Levels of the octree over the particles [default: few enough that each particle lies within one or two cells
    /// of the scene's octree of the point from which its map is rendered]
    #[arg(long, value_name = "L", value_parser = clap::value_parser!(u32).range(1..=10))]
    view_levels: Option<u32>,
    /// Number of measured frames, after one that is not counted; times are their median [default: 3]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1000))]
    rounds: Option<u16>,
    /// Number of particles that light the judged view [default: 256]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=65_536))]
    lights: Option<u32>,
    /// Position of the viewer in metres [default: the scene's first camera]
    #[arg(long, value_name = "X,Y,Z", value_parser = args::point, allow_hyphen_values = true, requires = "target")]
    eye: Option<DVec3>,
    /// Point that the viewer looks at
    #[arg(long, value_name = "X,Y,Z", value_parser = args::point, allow_hyphen_values = true, requires = "eye")]
    target: Option<DVec3>,
    #[command(flatten)]
    size: Size,
    /// Folder for the images of all rows
    #[arg(long, value_name = "DIR")]
    images: Option<PathBuf>,
}

impl Particles {
    pub(in crate::study) async fn run(self, quick: bool, progress: &ProgressBar) -> anyhow::Result<Report> {
        let mut options = Options::of(quick);
        self.scene.replace(&mut options.scene);
        self.size.replace(&mut options.size);
        if !self.particles.is_empty() {
            options.particles = self.particles;
            options.particles.sort_unstable();
        }
        options.resolution = self.resolution.unwrap_or(options.resolution);
        options.levels = self.levels.unwrap_or(options.levels);
        options.view_levels = self.view_levels.or(options.view_levels);
        options.rounds = self.rounds.map_or(options.rounds, usize::from);
        options.lights = self.lights.unwrap_or(options.lights);
        if let (Some(eye), Some(target)) = (self.eye, self.target) {
            let camera = Camera { fov_deg: 60.0, ..Camera::look_at(eye, target) };
            camera.validate()?;
            options.camera = Some(camera);
        }
        options.images = self.images;
        blocking(options, progress, run).await
    }
}
