//! Arguments of `argus-lab study shadows`.

use std::path::PathBuf;

use argus::args;
use argus_scene::Camera;
use argus_studies::shadows::{Options, run};
use argus_studies::{Effort as _, Report};
use glam::DVec3;
use indicatif::ProgressBar;

use super::arguments::{Scene, Size, blocking};

/// Measures direct light by rays: what shadows, the blocked sky and emitters cost a view and a sample, and their error
/// against the reference
///
/// Without --scene: terrain:500000; without --size: 200x150.
#[derive(clap::Args)]
#[command(after_help = "\
Example:
  argus-lab study shadows --scene model.glb --eye=3,2,5 --target 0,1,0 --images pictures --out figures")]
pub(super) struct ShadowStudy {
    #[command(flatten)]
    scene: Scene,
    #[command(flatten)]
    size: Size,
    /// Viewpoint x,y,z; without it the scene's own viewpoints
    #[arg(long, value_name = "X,Y,Z", requires = "target", value_parser = args::point, allow_hyphen_values = true)]
    eye: Option<DVec3>,
    /// Point that the view looks at
    #[arg(long, value_name = "X,Y,Z", requires = "eye", value_parser = args::point, allow_hyphen_values = true)]
    target: Option<DVec3>,
    /// Numbers of rays of a texel to the sky and to emitters [default: 1,2,4,8]
    #[arg(long, value_name = "N", value_delimiter = ',', value_parser = clap::value_parser!(u32).range(1..=64))]
    rays: Vec<u32>,
    /// Number of measured rounds, after one that is not counted; times are their median [default: 3]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1000))]
    rounds: Option<u16>,
    /// Folder for images of all views, rows and references
    #[arg(long, value_name = "DIR")]
    images: Option<PathBuf>,
}

impl ShadowStudy {
    pub(super) async fn run(self, quick: bool, progress: &ProgressBar) -> anyhow::Result<Report> {
        let mut options = Options::of(quick);
        self.scene.replace(&mut options.scene);
        self.size.replace(&mut options.size);
        if let (Some(eye), Some(target)) = (self.eye, self.target) {
            options.camera = Some(Camera::look_at(eye, target));
        }
        if !self.rays.is_empty() {
            options.rays = self.rays;
        }
        options.rounds = self.rounds.map_or(options.rounds, usize::from);
        options.images = self.images;
        blocking(options, progress, run).await
    }
}
