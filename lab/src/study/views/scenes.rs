//! Arguments of `argus-lab study views scenes`.

use std::path::{Path, PathBuf};

use anyhow::Context as _;
use argus::wiring::Alone;
use argus::{args, sheet};
use argus_cluster::coordinator::Config;
use argus_scene::{LightLevel, Output, Outputs, PlanRequest, View};
use argus_studies::Report;
use argus_studies::views::scenes::{Picture, run};
use image::RgbImage;
use indicatif::ProgressBar;

/// Columns of the contact sheet.
const COLUMNS: u32 = 5;
/// Sub-pixels on a side of each pixel.
const SUPERSAMPLING: u32 = 2;

/// Shows each scene file of a folder in its default view, and says whether the picture is too dark or too bright
///
/// Files are .glb, .gltf, .obj and .ply in the folder and its folders, except those whose name begins with `nasty`. Each is
/// rendered in this process, in the light that `argus serve` gives it. With --out, the folder also gets all pictures as one
/// contact sheet, scenes.png. The command fails if a picture is out of bounds.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  argus-lab study views scenes --scenes models --out pictures
  argus-lab study views scenes --scenes models --size 640x400 --json")]
pub(in crate::study) struct Scenes {
    /// Folder of scene files
    #[arg(long, value_name = "DIR")]
    scenes: PathBuf,
    /// Size of each picture in pixels
    #[arg(long, value_name = "WxH", default_value = "320x200", value_parser = args::size)]
    size: [u32; 2],
}

impl Scenes {
    /// `out` is the folder for the contact sheet.
    pub(in crate::study) async fn run(
        self,
        out: Option<PathBuf>,
        progress: &ProgressBar,
    ) -> anyhow::Result<Report> {
        let bar = progress.clone();
        let study = move || {
            let config = Config {
                effects: Default::default(),
                exposure: Default::default(),
                indirect: None,
                ..Alone::usual_config()
            };
            let (report, pictures) = run(&self.scenes, |file| show(file, self.size, &config), &bar)?;
            if let Some(folder) = out {
                write(&folder, &pictures)?;
            }
            Ok(report)
        };
        tokio::task::spawn_blocking(study).await.context("the study panicked")?
    }
}

/// Renders the default view of a scene, first in direct light and then in all of it.
fn show(file: &str, [width, height]: [u32; 2], config: &Config) -> anyhow::Result<Picture> {
    // Opened by itself first: below, its light is chosen as well.
    let opening = std::time::Instant::now();
    drop(argus_scene::open(file)?);
    let open_secs = opening.elapsed().as_secs_f64();
    let began = std::time::Instant::now();
    let mut alone = Alone::open(file, config)?;
    let scene = alone.scene().clone();
    let plan = PlanRequest { direct: true, ..PlanRequest::default() };
    let (camera, outputs) = (scene.default_camera(), Outputs::COLOR);
    let view = View { camera, width, height, outputs, plan, pin: None };
    alone.render(&view, LightLevel::Direct.min(alone.full_light()), 0.0)?;
    let first_view_secs = began.elapsed().as_secs_f64();
    let plan = PlanRequest { supersampling: Some(SUPERSAMPLING), ..plan };
    let frame = alone.render(
        &View { outputs: outputs.with(Output::Range), plan, ..view },
        alone.full_light(),
        0.0,
    )?;
    let set = &alone.prepared().set;
    let (color, range) = frame.color.zip(frame.range).context("the frame lacks an image")?;
    Ok(Picture {
        image: RgbImage::from_raw(width, height, color.to_vec()).context("the frame is short")?,
        ranges: range.as_chunks::<4>().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect(),
        light: alone.light.clone(),
        exposure: set.lighting.exposure,
        open_secs,
        first_view_secs,
        picture_secs: began.elapsed().as_secs_f64(),
        warnings: scene.warnings.len(),
    })
}

/// Writes the contact sheet.
fn write(folder: &Path, pictures: &[(String, RgbImage)]) -> anyhow::Result<()> {
    let sheet = sheet::tiles(pictures, COLUMNS);
    argus::output::write_small_png(&folder.join("scenes.png"), &sheet)
}
