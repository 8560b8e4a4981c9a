//! The demo's files: images, the contact sheet, and the curve of latency over time.

use std::path::Path;

use anyhow::Context;
use argus_plot::{Axis, Plot};
use image::RgbImage;

use crate::demo::crowd::Crowd;
use crate::demo::judge::Judged;
use crate::{output, sheet};

/// Writes all images and the contact sheet into a folder.
pub(crate) fn write_images(folder: &Path, title: &str, judged: &[Judged]) -> anyhow::Result<()> {
    for (i, view) in judged.iter().enumerate() {
        write(folder, &format!("view-{i:02}.png"), &view.shown)?;
        write(folder, &format!("reference-{i:02}.png"), &view.truth)?;
        write(folder, &format!("flip-{i:02}.png"), &view.difference)?;
    }
    let entries: Vec<sheet::Entry<'_>> = judged.iter().enumerate().map(|(i, view)| view.entry(i)).collect();
    write(folder, "contact-sheet.png", &sheet::draw(title, &entries))
}

/// Writes `latency.svg` and `latency.png` into a folder that exists.
pub(crate) fn write_curve(
    folder: &Path,
    title: &str,
    by_default: &Crowd,
    direct: &Crowd,
) -> anyhow::Result<()> {
    let plot = Plot {
        name: "latency".to_owned(),
        title: title.to_owned(),
        x: Axis::linear("seconds since the crowd began"),
        y: Axis::log("milliseconds from when a view was due"),
        series: vec![
            by_default.timeline.curve("by default, p50", 0.5),
            by_default.timeline.curve("by default, p99", 0.99),
            direct.timeline.curve("from triangles, p50", 0.5),
            direct.timeline.curve("from triangles, p99", 0.99),
        ],
        ..Plot::default()
    };
    let path = folder.join("latency.svg");
    std::fs::write(&path, plot.svg()?).with_context(|| format!("cannot write {}", path.display()))?;
    write(folder, "latency.png", &plot.image()?)
}

fn write(folder: &Path, name: &str, image: &RgbImage) -> anyhow::Result<()> {
    output::write_rgb_png(&folder.join(name), image.width(), image.height(), image)
}
