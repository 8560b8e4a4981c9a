//! Arguments of `argus-lab study light`.

use std::path::PathBuf;

use argus::args;
use argus_scene::Camera;
use argus_studies::light::{Options, run};
use argus_studies::{Effort as _, Report};
use glam::DVec3;
use indicatif::ProgressBar;

use super::arguments::{Scene, Size, blocking};

/// Measures indirect light by paths, virtual point lights and points: seconds and error against the path-traced reference
///
/// Without --scene: rooms; without --size: 160x120. The reference takes minutes.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  argus-lab study light --scene sponza.glb --eye=-11,3,0 --target 0,4,0 --out figures --images pictures")]
pub(super) struct Light {
    #[command(flatten)]
    scene: Scene,
    /// Position of the viewer in metres [default: the scene's first three cameras]
    #[arg(long, value_name = "X,Y,Z", value_parser = args::point, allow_hyphen_values = true, requires = "target")]
    eye: Option<DVec3>,
    /// Point that the viewer looks at
    #[arg(long, value_name = "X,Y,Z", value_parser = args::point, allow_hyphen_values = true, requires = "eye")]
    target: Option<DVec3>,
    #[command(flatten)]
    size: Size,
    /// Paths a pixel of the reference; its noise falls with their root, and its time is proportional [default: 128]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1 << 16))]
    paths: Option<u32>,
    /// Only methods of these names, with commas between: off, paths, cells, vpl, points [default: all]
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    methods: Vec<String>,
    /// Folder for the images of all rows
    #[arg(long, value_name = "DIR")]
    images: Option<PathBuf>,
}

impl Light {
    pub(super) async fn run(self, quick: bool, progress: &ProgressBar) -> anyhow::Result<Report> {
        let mut options = Options::of(quick);
        self.scene.replace(&mut options.scene);
        self.size.replace(&mut options.size);
        if let (Some(eye), Some(target)) = (self.eye, self.target) {
            let camera = Camera { fov_deg: 60.0, ..Camera::look_at(eye, target) };
            camera.validate()?;
            options.camera = Some(camera);
        }
        options.paths = self.paths.unwrap_or(options.paths);
        options.images = self.images;
        if !self.methods.is_empty() {
            let is_named = |method: &str| self.methods.iter().any(|name| method.starts_with(name.as_str()));
            options.methods.retain(|method| is_named(&method.to_string()));
        }
        blocking(options, progress, run).await
    }
}
