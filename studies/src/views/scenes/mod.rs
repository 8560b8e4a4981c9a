//! Scenes: the picture of each file of a folder as a newcomer sees it, without a flag, and whether it can be made out.
//!
//! Each file is shown in its default view, in all the light that a service would give it. The bars are those of a picture
//! that is neither dark nor washed out ([`Shown::passed`]). They are judged on pixels that show a surface, since a sky says
//! nothing of how surfaces are lit.

mod judgement;

use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result};
use argus::wiring::Alone;
use argus::{output, sheet};
use argus_cluster::coordinator::Config;
use argus_scene::{LightLevel, Output, Outputs, PlanRequest, View};
use image::RgbImage;
use indicatif::ProgressBar;
use serde_json::json;

use self::judgement::Shown;
use crate::arguments::size;
use crate::report::row;
use crate::{Machine, Report};

/// Endings of scene files.
const ENDINGS: [&str; 4] = ["glb", "gltf", "obj", "ply"];
/// Begin of the names of folders with deliberately broken files.
const BROKEN: &str = "nasty";
/// Seconds that the first view may take beyond opening the scene.
const FIRST_VIEW_SECS: f64 = 2.0;
/// Columns of the contact sheet.
const COLUMNS: u32 = 5;
/// Sub-pixels on a side of each pixel.
const SUPERSAMPLING: u32 = 2;

/// Shows each scene file of a folder in its default view, and says whether the picture is too dark or too bright
///
/// Files are .glb, .gltf, .obj and .ply in the folder and its folders, except those whose name begins with `nasty`. Each is
/// rendered in this process, in the light that `argus serve` gives it. With --out, the folder also gets all pictures as one
/// contact sheet, scenes.png. The command fails if a picture is out of bounds.
#[derive(Debug, Clone, clap::Args)]
#[command(after_help = "\
Examples:
  argus-lab study views scenes --scenes models --out pictures
  argus-lab study views scenes --scenes models --size 640x400 --json")]
pub struct Options {
    /// Folder of scene files
    #[arg(long, value_name = "DIR")]
    pub scenes: PathBuf,
    /// Size of each picture in pixels
    #[arg(long, value_name = "WxH", default_value = "320x200", value_parser = size)]
    pub size: [u32; 2],
    /// Folder for the contact sheet.
    #[arg(skip)]
    pub pictures: Option<PathBuf>,
}

/// What was rendered of a scene.
struct Picture {
    /// The default view, in all light.
    image: RgbImage,
    /// Metres to the surface of each pixel, +inf for the sky.
    ranges: Vec<f32>,
    /// The chosen light, in words.
    light: String,
    /// Factor from radiance to display-linear values.
    exposure: f32,
    /// Seconds to open the file.
    open_secs: f64,
    /// Seconds from the start to the first view, in direct light.
    first_view_secs: f64,
    /// Seconds from the start to the view in all light.
    picture_secs: f64,
    /// Number of the loader's warnings.
    warnings: usize,
}

/// The scene files of a folder and its folders, sorted. Folders of deliberately broken files are left out.
///
/// # Errors
/// A folder that cannot be read.
fn files(folder: &Path) -> Result<Vec<PathBuf>> {
    let mut found = Vec::new();
    let mut folders = vec![folder.to_path_buf()];
    while let Some(folder) = folders.pop() {
        let entries =
            std::fs::read_dir(&folder).with_context(|| format!("cannot read {}", folder.display()))?;
        for entry in entries {
            let path = entry?.path();
            let name = path.file_name().unwrap_or_default().to_string_lossy().to_lowercase();
            let ending = name.rsplit_once('.').map_or("", |(_, ending)| ending);
            match path.is_dir() {
                true if !name.starts_with(BROKEN) => folders.push(path),
                false if ENDINGS.contains(&ending) => found.push(path),
                _ => {}
            }
        }
    }
    found.sort();
    Ok(found)
}

/// Runs the study; `progress` counts scenes. A file that cannot be shown is a row that failed.
///
/// # Errors
/// A folder that cannot be read or has no scene, or a contact sheet that cannot be written.
pub fn run(options: &Options, progress: &ProgressBar) -> Result<Report> {
    let (effects, exposure) = Default::default();
    let config = Config { effects, exposure, indirect: None, ..Alone::usual_config() };
    let (report, pictures) = report_of(&options.scenes, |file| show(file, options.size, &config), progress)?;
    if let Some(folder) = &options.pictures {
        output::write_small_png(&folder.join("scenes.png"), &sheet::tiles(&pictures, COLUMNS))?;
    }
    Ok(report)
}

/// Renders the default view of a scene, first in direct light and then in all of it.
fn show(file: &str, [width, height]: [u32; 2], config: &Config) -> Result<Picture> {
    // Opened by itself first: below, its light is chosen as well.
    let opening = std::time::Instant::now();
    drop(argus_scene::open(file)?);
    let open_secs = opening.elapsed().as_secs_f64();
    let began = std::time::Instant::now();
    let mut alone = Alone::open(file, config)?;
    let scene = alone.scene().clone();
    let plan = PlanRequest { direct: true, ..PlanRequest::default() };
    let (camera, outputs) = (scene.default_camera(), Outputs::COLOR);
    let view = View { camera, width, height, outputs, plan, pin: None, flow_to: None, rays: None };
    alone.render(&view, LightLevel::Direct.min(alone.full_light()), 0.0)?;
    let first_view_secs = began.elapsed().as_secs_f64();
    let plan = PlanRequest { supersampling: Some(SUPERSAMPLING), ..plan };
    let frame = alone.render(
        &View { outputs: outputs.with(Output::Range), plan, ..view },
        alone.full_light(),
        0.0,
    )?;
    let set = &alone.prepared().set;
    let (color, range) = frame.images[Output::Color]
        .clone()
        .zip(frame.images[Output::Range].clone())
        .context("the frame lacks an image")?;
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

/// The report of a folder's scenes, and each picture under its file's name within the folder.
fn report_of(
    folder: &Path,
    mut show: impl FnMut(&str) -> Result<Picture>,
    progress: &ProgressBar,
) -> Result<(Report, Vec<(String, RgbImage)>)> {
    let files = files(folder)?;
    anyhow::ensure!(!files.is_empty(), "{} has no scene files ({})", folder.display(), ENDINGS.join(", "));
    progress.set_length(files.len() as u64);
    let (mut rows, mut pictures) = (Vec::new(), Vec::new());
    for file in &files {
        let name = file.strip_prefix(folder).unwrap_or(file).display().to_string();
        progress.set_message(name.clone());
        rows.push(match show(&file.display().to_string()) {
            Ok(picture) => {
                let row = row_of(&name, &picture);
                pictures.push((name, picture.image));
                row
            }
            Err(error) => failed(&name, &error),
        });
        progress.inc(1);
    }
    let mut report = Report::new(folder.display().to_string(), Machine::here(""), rows);
    report.notes.push(format!(
        "The default view of each file, without a flag. mean, white, dark: of the pixels that show a surface, the mean display \
         value (0 to 1), the share that is clipped white and the share below {} of 255; passed: mean {} to {}, white at most {}, \
         dark at most {}. first_view_secs: direct light, from the start of the process's work; in_time: within {FIRST_VIEW_SECS} s \
         of opening the file.",
        judgement::DARK, judgement::MEAN[0], judgement::MEAN[1], judgement::MOST_WHITE, judgement::MOST_DARK
    ));
    Ok((report, pictures))
}

fn row_of(name: &str, picture: &Picture) -> serde_json::Map<String, serde_json::Value> {
    let shown = Shown::of(&picture.image, &picture.ranges);
    let Shown { visible, mean, white, dark } = shown;
    let in_time = picture.first_view_secs <= picture.open_secs + FIRST_VIEW_SECS;
    row(json!({
        "file": name,
        "passed": shown.passed(),
        "light": picture.light,
        "exposure": picture.exposure,
        "visible": visible,
        "mean": mean,
        "white": white,
        "dark": dark,
        "warnings": picture.warnings,
        "open_secs": picture.open_secs,
        "first_view_secs": picture.first_view_secs,
        "in_time": in_time,
        "picture_secs": picture.picture_secs,
    }))
}

/// The row of a file that cannot be shown.
fn failed(name: &str, error: &anyhow::Error) -> serde_json::Map<String, serde_json::Value> {
    row(json!({
        "file": name, "passed": false, "light": format!("{error:#}"), "exposure": null, "visible": null, "mean": null,
        "white": null, "dark": null, "warnings": null, "open_secs": null, "first_view_secs": null, "in_time": null,
        "picture_secs": null,
    }))
}

#[cfg(test)]
mod tests {
    use image::Rgb;

    use super::*;

    #[test]
    fn a_file_that_cannot_be_shown_and_a_dark_picture_fail_by_name() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["b.glb", "a/dark.OBJ", "a/lost.ply", "nasty_gltf/x.glb", "a/notes.txt"] {
            let path = folder.path().join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, "").unwrap();
        }
        let show = |file: &str| {
            anyhow::ensure!(!file.ends_with("lost.ply"), "it is lost");
            let level = if file.ends_with("OBJ") { 2 } else { 100 };
            Ok(Picture {
                image: RgbImage::from_pixel(4, 4, Rgb([level; 3])),
                ranges: vec![1.0; 16],
                light: "file".to_owned(),
                exposure: 1.0,
                open_secs: 1.0,
                first_view_secs: 2.5,
                picture_secs: 4.0,
                warnings: 0,
            })
        };
        let (report, pictures) = report_of(folder.path(), show, &ProgressBar::hidden()).unwrap();
        let said: Vec<(&str, bool)> =
            report.rows.iter().map(|row| (row["file"].as_str().unwrap(), row["passed"] == true)).collect();
        assert_eq!(said, [("a/dark.OBJ", false), ("a/lost.ply", false), ("b.glb", true)]);
        assert_eq!(pictures.len(), 2);
        assert!(report.rows[1]["light"].as_str().unwrap().contains("it is lost"));
        let keys = |row: usize| report.rows[row].keys().collect::<Vec<_>>();
        assert_eq!(keys(0), keys(1));
        assert!(report_of(&folder.path().join("nasty_gltf/none"), show, &ProgressBar::hidden()).is_err());
    }
}
