//! The demo's files: images, the contact sheet, and the curves of latency and error over time.

use std::path::Path;

use anyhow::Context;
use argus_plot::{Axis, Plot, Series};
use image::RgbImage;

use crate::demo::judge::Row;
use crate::demo::phase::{Outcome, Phase};
use crate::{output, sheet};

/// Writes the images of all rows and the contact sheet into a folder.
pub(crate) fn write_images(folder: &Path, title: &str, phases: &[(String, Vec<Row>)]) -> anyhow::Result<()> {
    for (i, row) in phases.iter().flat_map(|(_, rows)| rows).enumerate() {
        write(folder, &format!("view-{i:02}.png"), &row.shown)?;
        write(folder, &format!("reference-{i:02}.png"), &row.reference)?;
        write(folder, &format!("flip-{i:02}.png"), &row.difference)?;
        if let Some(source) = &row.source {
            write(folder, &format!("source-{i:02}.png"), source)?;
        }
    }
    let entry = |row: &Row| sheet::Entry {
        images: [
            row.source.clone(),
            Some(row.shown.clone()),
            Some(row.reference.clone()),
            Some(row.difference.clone()),
        ],
        caption: row.caption.clone(),
    };
    // One phase takes two columns, so that the sheet is not twice as high.
    let parts = if phases.len() == 1 { 2 } else { 1 };
    let columns = phases.iter().flat_map(|(heading, rows)| {
        let part = rows.len().div_ceil(parts).max(1);
        rows.chunks(part).map(|rows| (heading.clone(), rows.iter().map(entry).collect::<Vec<_>>()))
    });
    let columns: Vec<_> = columns.collect();
    write(folder, "contact-sheet.png", &sheet::draw(title, HEADINGS, MISSING, &columns))
}

/// What the images of a row are.
const HEADINGS: [&str; 4] = ["sample: a source", "reconstruction", "reference", "FLIP error"];
/// Stands in the place of a source.
const MISSING: [&str; 2] = ["no single source:", "triangles or a rig"];

/// Writes `latency.svg` and `latency.png` into a folder that exists: latency over time, and below it the error.
pub(crate) fn write_curves<'a>(
    folder: &Path,
    title: &str,
    phases: impl Iterator<Item = &'a Phase>,
    direct: Option<&Outcome>,
) -> anyhow::Result<()> {
    let phases: Vec<&Phase> = phases.collect();
    let (mut p50, mut p99, mut excess, mut guides, mut begin) = (vec![], vec![], vec![], vec![], 0.0);
    for phase in &phases {
        let shifted = |points: Vec<(f64, f64)>| points.into_iter().map(move |(x, y)| (begin + x, y));
        let timeline = &phase.outcome.by_second;
        p50.extend(shifted(timeline.latency(0.5)));
        p99.extend(shifted(timeline.latency(0.99)));
        excess.extend(shifted(timeline.excess()));
        guides.push((begin, format!("{:.1} times", phase.rate.times())));
        begin += phase.outcome.seconds;
    }
    // Both plots end there.
    guides.push((begin, String::new()));
    let line = |name: &str, points: Vec<(f64, f64)>| Series { name: name.to_owned(), points, line: true };
    let mut latency = vec![line("as Argus decides, p50", p50), line("as Argus decides, p99", p99)];
    if let Some(direct) = direct {
        latency.push(line("all from triangles, p50", direct.by_second.latency(0.5)));
        latency.push(line("all from triangles, p99", direct.by_second.latency(0.99)));
    }
    let zero = line("all from triangles, one sample a pixel", vec![(0.0, 0.0), (begin, 0.0)]);
    let seconds = || Axis::linear("seconds since the crowd began");
    let plots = [
        Plot {
            name: "latency".to_owned(),
            title: title.to_owned(),
            x: seconds(),
            y: Axis::log("latency, milliseconds"),
            series: latency,
            guides: guides.clone(),
            headroom: 0.4,
            ..Plot::default()
        },
        Plot {
            name: "error".to_owned(),
            title: "Error beyond that of the views from triangles".to_owned(),
            x: seconds(),
            y: Axis::linear("mean FLIP, excess"),
            series: vec![line("as Argus decides", excess), zero],
            guides: guides.into_iter().map(|(at, _)| (at, String::new())).collect(),
            headroom: 0.4,
            ..Plot::default()
        },
    ];
    let path = folder.join("latency.svg");
    std::fs::write(&path, argus_plot::stacked_svg(&plots)?)
        .with_context(|| format!("cannot write {}", path.display()))?;
    write(folder, "latency.png", &argus_plot::stacked_image(&plots)?)
}

fn write(folder: &Path, name: &str, image: &RgbImage) -> anyhow::Result<()> {
    output::write_rgb_png(&folder.join(name), image.width(), image.height(), image)
}
