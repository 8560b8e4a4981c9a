//! Mitsuba 3 as a rival: `scripts/mitsuba --timed` renders exported views with several numbers of paths a pixel.
//!
//! Mitsuba's images are judged against its own converged ones, so that only its noise counts, not its other definition of
//! gloss and of texture filters.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use anyhow::{Context as _, Result, ensure};
use argus_scene::metrics::flip_mean;
use argus_scene::mitsuba::{Settings, SkyLight, write};
use argus_scene::tone::display_from_radiance;
use argus_scene::{Camera, Scene};
use glam::Vec3;
use image::RgbImage;
use serde::Deserialize;

use crate::median::mean;

/// What is rendered by Mitsuba.
#[derive(Debug, Clone)]
pub(super) struct Mitsuba {
    /// The script: `scripts/mitsuba`.
    pub(super) script: PathBuf,
    /// Numbers of paths a pixel that are timed.
    pub(super) paths: Vec<u32>,
    /// Paths a pixel of the converged images.
    pub(super) converged: u32,
}

/// A measured number of paths.
pub(super) struct Timed {
    /// Paths a pixel.
    pub(super) paths: u32,
    /// Milliseconds of a view.
    pub(super) view_ms: f64,
    /// Mean FLIP against the converged images.
    pub(super) flip: f64,
}

/// What the script prints.
#[derive(Deserialize)]
struct Printed {
    views: Vec<PrintedView>,
}

#[derive(Deserialize)]
struct PrintedView {
    converged: PathBuf,
    rows: Vec<PrintedRow>,
}

#[derive(Deserialize)]
struct PrintedRow {
    spp: u32,
    seconds: f64,
    image: PathBuf,
}

impl Mitsuba {
    /// Renders views of a size, with at most `bounces` reflections between a light and a visible surface. `folder` takes the
    /// exported scenes and the images.
    ///
    /// # Errors
    /// The scene cannot be exported, or the script fails.
    pub(super) fn measure(
        &self,
        scene: &Scene,
        views: &[Camera],
        size: [u32; 2],
        bounces: u32,
        folder: &Path,
    ) -> Result<Vec<Timed>> {
        let mut command = Command::new(&self.script);
        let paths: Vec<String> = self.paths.iter().map(u32::to_string).collect();
        command.args(["--timed", &paths.join(","), "--spp", &self.converged.to_string()]);
        command.args(["--bounces", &bounces.to_string(), "--json"]);
        for (number, camera) in views.iter().enumerate() {
            let folder = folder.join(format!("view-{number}"));
            let settings = Settings { camera: *camera, size, time_secs: 0.0, sky: SkyLight::Seen };
            write(scene, &settings, &folder)
                .with_context(|| format!("cannot write the scene to {}", folder.display()))?;
            command.arg(folder);
        }
        let done = command.stdout(Stdio::piped()).output();
        let done = done.with_context(|| format!("cannot start {}", self.script.display()))?;
        ensure!(done.status.success(), "{} failed: {}", self.script.display(), done.status);
        let printed: Printed = serde_json::from_slice(&done.stdout).context("the script printed no views")?;
        ensure!(printed.views.len() == views.len(), "the script rendered {} views", printed.views.len());
        judged(&printed, &self.paths, scene.lighting.exposure)
    }
}

/// Means over the views, for each number of paths.
fn judged(printed: &Printed, paths: &[u32], exposure: f32) -> Result<Vec<Timed>> {
    let mut found: Vec<(Vec<f64>, Vec<f64>)> = vec![Default::default(); paths.len()];
    for view in &printed.views {
        let truth = displayed(&view.converged, exposure)?;
        for (row, (times, errors)) in view.rows.iter().zip(&mut found) {
            times.push(row.seconds * 1e3);
            errors.push(flip_mean(&truth, &displayed(&row.image, exposure)?)?);
        }
        let same = view.rows.iter().map(|row| row.spp).eq(paths.iter().copied());
        ensure!(same, "the script rendered other numbers of paths than it was asked for");
    }
    let rows = paths.iter().zip(found);
    Ok(rows.map(|(&paths, (ms, flip))| Timed { paths, view_ms: mean(ms), flip: mean(flip) }).collect())
}

/// An OpenEXR image of linear radiance, as a display shows it.
fn displayed(file: &Path, exposure: f32) -> Result<RgbImage> {
    let image = image::open(file).with_context(|| format!("cannot read {}", file.display()))?.into_rgb32f();
    let bytes = image.pixels().flat_map(|pixel| display_from_radiance(Vec3::from_array(pixel.0), exposure));
    RgbImage::from_raw(image.width(), image.height(), bytes.collect()).context("the image is short")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn written(folder: &Path, name: &str, value: f32) -> PathBuf {
        let file = folder.join(name);
        let pixels = std::iter::repeat_n(value, 8 * 8 * 3).collect();
        image::Rgb32FImage::from_raw(8, 8, pixels).unwrap().save(&file).unwrap();
        file
    }

    #[test]
    fn rows_are_means_over_views_against_the_converged_images() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str, value| written(folder.path(), name, value);
        let row = |seconds, image| PrintedRow { spp: 4, seconds, image };
        let view = |rows| PrintedView { converged: at("truth.exr", 0.5), rows };
        let printed = Printed {
            views: vec![view(vec![row(1.0, at("a.exr", 0.5))]), view(vec![row(3.0, at("b.exr", 0.1))])],
        };
        let found = judged(&printed, &[4], 1.0).unwrap();
        assert_eq!((found[0].paths, found[0].view_ms), (4, 2000.0));
        assert!(found[0].flip > 0.01);
        assert!(judged(&printed, &[5], 1.0).is_err());
    }

    #[test]
    fn a_script_that_does_not_exist_is_named() {
        let mitsuba = Mitsuba { script: "no/such/script".into(), paths: vec![1], converged: 4 };
        let folder = tempfile::tempdir().unwrap();
        let scene = argus_scene::procedural::terrain(200);
        let found = mitsuba.measure(&scene, &[scene.default_camera()], [8, 8], 1, folder.path());
        assert!(format!("{:#}", found.err().unwrap()).contains("no/such/script"));
    }
}
