//! Equal time: maps from cuts against imperfect and rasterised maps that take as long (figure 7).

use anyhow::{Context as _, Result};
use argus_manylods::{CutMethod, ImperfectViews, ManyLods};
use argus_megaviews::many_views::{RasterViews, Settings, ViewList, ViewPoint};
use glam::DVec3;
use indicatif::ProgressBar;

use super::stage::{Stage, Tree, frames};
use super::table::Row;
use crate::median::median;

/// Points per imperfect map in the first trial, which measures their cost.
const PROBE: u32 = 512;
/// Views rasterised in the first trial, which measures their cost.
const RASTERED: usize = 32;

/// A row for cuts of each tree, one for imperfect maps, and two for rasterised maps: all views, and as many as fit
/// the time. The time is that of cuts of the ball tree, or of the octree if those do not fit.
pub(super) fn rows(stage: &Stage<'_>, progress: &ProgressBar) -> Result<Vec<Row>> {
    let list = ViewList::new(stage.gpu, &stage.root, &stage.views)?;
    let shadows = stage.shadows();
    let asked = shadows.asked();
    let own = |nth: usize| stage.views[asked[nth]].position;
    let row = |method| Row {
        part: "equal-time",
        method: Some(method),
        views: Some(stage.options.views),
        ..Row::default()
    };
    let mut rows = Vec::new();

    progress.set_message("cuts");
    for tree in Tree::ALL {
        let mut cuts = ManyLods::new(stage.gpu, stage.tree(tree)?, stage.settings(CutMethod::Basic, 1.0))?;
        let row = Row { tree: Some(tree.name()), threshold: Some(1.0), ..row("manylods") };
        let Some(frames) = frames(stage.options.rounds, || cuts.render(&list))? else {
            rows.push(row);
            continue;
        };
        let maps = cuts.maps().context("no maps were drawn")?;
        let wrong = shadows.wrong(|nth| Ok((maps.read(stage.gpu, asked[nth] as u32)?, own(nth))))?;
        rows.push(Row { wrong: Some(wrong), ..row.of(&frames) });
    }
    progress.inc(1);
    // Without cuts there is no time to match.
    let Some(budget_ms) = rows.iter().find_map(|row| row.frame_ms) else { return Ok(rows) };

    progress.set_message("imperfect maps");
    let settings = Settings { side: stage.options.resolution, ..Settings::default() };
    let mut imperfect = ImperfectViews::new(stage.gpu, &stage.balls, settings)?;
    let mut time = |points: u32| -> Result<f64> {
        imperfect.render(&list, points)?;
        let times: Result<Vec<f64>> =
            (0..stage.options.rounds.max(1)).map(|_| Ok(imperfect.render(&list, points)?.frame_ms)).collect();
        Ok(median(&times?))
    };
    // Time grows linearly with points: two measurements give the slope.
    let (few, more) = (time(PROBE)?, time(4 * PROBE)?);
    let each = ((more - few) / f64::from(3 * PROBE)).max(1e-9);
    let points = f64::from(PROBE) + (budget_ms - few) / each;
    let points = points.clamp(16.0, f64::from(u32::MAX / 4) / f64::from(stage.options.views)) as u32;
    let frame_ms = time(points)?;
    let wrong = shadows.wrong(|nth| Ok((imperfect.maps().read(stage.gpu, asked[nth] as u32)?, own(nth))))?;
    rows.push(Row {
        points: Some(points),
        frame_ms: Some(frame_ms),
        wrong: Some(wrong),
        bytes: Some(imperfect.maps().bytes()),
        ..row("imperfect")
    });
    progress.inc(1);

    progress.set_message("rasterised maps");
    let triangles = || stage.triangles.iter().copied();
    let mut raster = RasterViews::new(stage.gpu, stage.root, triangles(), settings)?;
    let mut rendered = |count: usize| -> Result<(Vec<ViewPoint>, f64)> {
        let few: Vec<ViewPoint> = (0..count).map(|i| stage.views[i * stage.views.len() / count]).collect();
        let list = ViewList::new(stage.gpu, &stage.root, &few)?;
        raster.render(&list)?;
        Ok((few, raster.render(&list)?.frame_ms))
    };
    let (few, ms) = rendered(RASTERED.min(stage.views.len()))?;
    let count = (budget_ms / (ms / few.len() as f64)) as usize;
    let (few, few_ms) = rendered(count.clamp(1, stage.views.len()))?;
    let nearest = |position: DVec3| {
        let off = |view: &&ViewPoint| view.position.distance_squared(position);
        few.iter().enumerate().min_by(|(_, a), (_, b)| off(a).total_cmp(&off(b))).map_or(0, |(at, _)| at)
    };
    let wrong = shadows.wrong(|nth| {
        let map = nearest(own(nth));
        Ok((raster.maps().read(stage.gpu, map as u32)?, few[map].position))
    })?;
    rows.push(Row {
        views: Some(few.len() as u32),
        frame_ms: Some(few_ms),
        wrong: Some(wrong),
        bytes: Some(raster.maps().bytes()),
        ..row("raster, as long")
    });
    // Rasterises only the views whose maps are judged, and scales the time to all views.
    let all: Vec<ViewPoint> = asked.iter().map(|&view| stage.views[view]).collect();
    let list = ViewList::new(stage.gpu, &stage.root, &all)?;
    let ms = raster.render(&list)?.frame_ms;
    let wrong = shadows.wrong(|nth| Ok((raster.maps().read(stage.gpu, nth as u32)?, own(nth))))?;
    let share = stage.views.len() as f64 / all.len() as f64;
    rows.push(Row {
        frame_ms: Some(ms * share),
        wrong: Some(wrong),
        bytes: Some((raster.maps().bytes() as f64 * share) as u64),
        ..row("raster, as many")
    });
    progress.inc(1);
    Ok(rows)
}
