//! Arguments of `argus-lab study method virtual-lights`.

use std::path::PathBuf;

use argus::args;
use argus_scene::Camera;
use argus_studies::papers::megaviews::{Emitter, parse_light};
use argus_studies::papers::virtual_lights::{Options, run};
use argus_studies::{Effort as _, Report};
use glam::DVec3;
use indicatif::ProgressBar;

use crate::study::arguments::{Scene, Size, blocking};

/// Measures indirect light by virtual point lights: error and time over their number, maps, samples per pixel and filter
///
/// Without --scene: terrain:50000; without --size: 192x144.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  argus-lab study method virtual-lights --scene sponza.glb --light spot:0,10,0:0,-1,0:35 --eye=-11,3,0 --target 0,4,0 --out figures")]
pub(in crate::study) struct VirtualLights {
    #[command(flatten)]
    scene: Scene,
    /// One light in place of the scene's lights and sky: point:X,Y,Z or spot:X,Y,Z:DX,DY,DZ:HALF_DEG
    #[arg(long, value_name = "LIGHT", value_parser = parse_light, allow_hyphen_values = true)]
    light: Option<Emitter>,
    /// Position of the viewer in metres [default: the scene's first camera]
    #[arg(long, value_name = "X,Y,Z", value_parser = args::point, allow_hyphen_values = true, requires = "target")]
    eye: Option<DVec3>,
    /// Point that the viewer looks at
    #[arg(long, value_name = "X,Y,Z", value_parser = args::point, allow_hyphen_values = true, requires = "eye")]
    target: Option<DVec3>,
    #[command(flatten)]
    size: Size,
    /// Greatest number of reflections between a light and a visible surface [default: 1]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=4))]
    bounces: Option<u32>,
    /// Folder for the images of all rows
    #[arg(long, value_name = "DIR")]
    images: Option<PathBuf>,
}

impl VirtualLights {
    pub(in crate::study) async fn run(self, quick: bool, progress: &ProgressBar) -> anyhow::Result<Report> {
        let mut options = Options::of(quick);
        self.scene.replace(&mut options.scene);
        self.size.replace(&mut options.size);
        options.light = self.light.or(options.light);
        if let (Some(eye), Some(target)) = (self.eye, self.target) {
            let camera = Camera { fov_deg: 60.0, ..Camera::look_at(eye, target) };
            camera.validate()?;
            options.camera = Some(camera);
        }
        options.base.bounces = self.bounces.unwrap_or(options.base.bounces);
        options.images = self.images;
        blocking(options, progress, run).await
    }
}
