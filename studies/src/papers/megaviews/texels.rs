//! The error of texel formats with fewer bits, against the time they save.

use std::sync::Arc;

use anyhow::Result;
use argus_gpu::Gpu;
use argus_megaviews::hierarchy::HierarchyError;
use argus_megaviews::many_views::{ManyViews, Settings, Texel, ViewList};
use argus_plot::{Axis, Plot, Series};
use serde_json::{Map, Value};

use super::Placement;

/// Mean relative range error of some maps against the same maps with uncompressed texels; `None` if those do not fit into
/// memory.
pub(super) fn range_error(
    gpu: &Arc<Gpu>,
    list: &ViewList,
    many: &ManyViews,
    maps: &[u32],
) -> Result<Option<f64>> {
    let settings = *many.settings();
    if settings.texel == settings.texel.exact() {
        return Ok(Some(0.0));
    }
    let exact = Settings { texel: settings.texel.exact(), ..settings };
    let mut exact = ManyViews::new(gpu, Arc::clone(many.octree()), exact)?;
    // Renders two frames, since the second may fall back.
    for _ in 0..2 {
        match exact.render(list) {
            Err(HierarchyError::TooLarge { .. }) => return Ok(None),
            frame => frame?,
        };
    }
    let (mut error, mut texels) = (0.0, 0u32);
    for &map in maps {
        let (stored, exact) = (many.maps().read(gpu, map)?, exact.maps().read(gpu, map)?);
        for (stored, exact) in stored.iter().zip(&exact) {
            let [stored, exact] = [stored, exact].map(|texel| f64::from(f32::from_bits(texel[0])));
            if exact > 0.0 {
                error += (stored / exact - 1.0).abs();
                texels += 1;
            }
        }
    }
    Ok(Some(error / f64::from(texels.max(1))))
}

/// A plot of error against time, with a series for each texel format and a point for each row of a placement.
pub(super) fn plot(
    rows: &[Map<String, Value>],
    texels: &[Texel],
    placement: Placement,
    title: String,
) -> Plot {
    let number = |row: &Map<String, Value>, key: &str| row[key].as_f64().unwrap_or(f64::NAN);
    let series = texels.iter().map(|texel| {
        let of = |row: &&Map<String, Value>| {
            row["placement"] == placement.name() && row["texel"] == texel.name() && row["method"] != "raster"
        };
        let point = |row| (number(row, "frame_ms"), number(row, "wrong_shadow_fraction"));
        Series {
            name: texel.name().to_owned(),
            points: rows.iter().filter(of).map(point).collect(),
            line: false,
        }
    });
    Plot {
        name: format!("texels-{}", placement.name()),
        title,
        x: Axis::log("time of a frame, ms"),
        y: Axis::linear("wrong shadows, share"),
        series: series.collect(),
        ..Plot::default()
    }
}
