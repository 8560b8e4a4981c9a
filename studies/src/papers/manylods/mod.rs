//! ManyLoDs: cuts of many views through a hierarchy of the scene (the paper's tables 1 and 2, figures 7 and 8).
//!
//! Measures building and refitting the hierarchy, finding cuts anew and from the last frame's, and the error of maps
//! drawn from the cuts beside other maps that take as long.

mod animation;
mod equal_time;
mod motion;
mod options;
mod stage;
mod table;

use std::sync::Arc;

use anyhow::Result;
use argus_gpu::{Gpu, GpuOptions};
use argus_manylods::{CutMethod, ManyLods};
use argus_megaviews::hierarchy::OctreeBuilder;
use argus_megaviews::many_views::ViewList;
use indicatif::ProgressBar;

pub use self::options::Options;
use self::stage::{Stage, Tree, frames};
use self::table::Row;
use crate::median::median;
use crate::{Machine, Report};

/// Runs the study; `progress` counts steps.
///
/// # Errors
/// A scene that cannot be opened, a light that reaches nothing, no GPU, or a frame that fails.
pub fn run(options: &Options, progress: &ProgressBar) -> Result<Report> {
    let gpu = Gpu::new(&GpuOptions::default())?;
    let scene = Arc::new(argus_scene::open(&options.scene)?);
    progress.set_length((2 + 2 * options.thresholds.len() + 3 + animation::length(options)) as u64);
    let stage = Stage::new(&gpu, &scene, options)?;
    let mut rows = stage.hierarchies(progress)?;
    rows.extend(stage.thresholds(progress)?);
    rows.extend(equal_time::rows(&stage, progress)?);
    let (animated, plots) = animation::rows(&stage, progress)?;
    rows.extend(animated);
    let rows = rows.into_iter().map(Row::into_map).collect();
    let mut report = Report::new(options.scene.clone(), Machine::here(gpu.kind()), rows);
    report.plots = plots;
    report.notes = vec![
        "cut_ms is device time of finding the cuts, draw_ms of drawing their maps; frame_ms is wall time from the call to the \
        last counter. visits are nodes looked at, splits and merges are operations, all of all views; in an animation they \
        are means per frame. The incremental method's cuts equal the basic one's node by node. Rows without figures: the \
        cuts do not fit this device; use fewer --views."
            .to_owned(),
        "Equal time: imperfect maps have as many points, and raster renders as many maps, as fit the time of the basic cuts \
        of the ball tree. A view without its own map uses the nearest rendered one."
            .to_owned(),
    ];
    report.note_longest_pass(&gpu);
    Ok(report)
}

impl Stage<'_> {
    /// Rows of building and refitting the hierarchies: the first lines of table 2.
    fn hierarchies(&self, progress: &ProgressBar) -> Result<Vec<Row>> {
        progress.set_message("hierarchies");
        let mut updates = Vec::new();
        let mut tree = self.builder.build(self.root, self.options.ball_levels, &self.triangles)?;
        let build_ms = tree.times.total_ms;
        self.builder.rebuild(&mut tree, &self.triangles)?;
        let rebuild_ms = tree.times.total_ms;
        for _ in 0..self.options.rounds.max(1) {
            self.builder.update(&mut tree, &self.triangles)?;
            updates.push(tree.times.total_ms);
        }
        progress.inc(1);
        let again = OctreeBuilder::new(self.gpu).build(
            self.root,
            self.options.levels,
            self.triangles.iter().copied(),
        )?;
        progress.inc(1);
        let row = |tree: Tree, nodes: u32, bytes: u64| Row {
            part: "hierarchy",
            tree: Some(tree.name()),
            nodes: Some(f64::from(nodes)),
            bytes: Some(bytes),
            ..Row::default()
        };
        Ok(vec![
            Row {
                build_ms: Some(build_ms),
                rebuild_ms: Some(rebuild_ms),
                update_ms: Some(median(&updates)),
                ..row(Tree::Balls, tree.node_count(), tree.bytes())
            },
            Row {
                build_ms: Some(again.times.total_ms),
                rebuild_ms: Some(again.times.total_ms),
                ..row(Tree::Octree, again.node_count(), again.bytes())
            },
        ])
    }

    /// Rows of cuts at several thresholds: the last lines of table 2.
    fn thresholds(&self, progress: &ProgressBar) -> Result<Vec<Row>> {
        let list = ViewList::new(self.gpu, &self.root, &self.views)?;
        let mut rows = Vec::new();
        for tree in Tree::ALL {
            for &threshold in &self.options.thresholds {
                progress.set_message(format!("{} at {threshold} texels", tree.name()));
                progress.inc(1);
                let settings = self.settings(CutMethod::Basic, threshold);
                let mut cuts = ManyLods::new(self.gpu, self.tree(tree)?, settings)?;
                let row = Row {
                    part: "threshold",
                    tree: Some(tree.name()),
                    method: Some("basic"),
                    threshold: Some(threshold),
                    views: Some(self.options.views),
                    ..Row::default()
                };
                let Some(frames) = frames(self.options.rounds, || cuts.render(&list))? else {
                    rows.push(row);
                    continue;
                };
                let asked = self.shadows().asked();
                let wrong = self.shadows().wrong(|nth| {
                    let map = cuts.maps().map(|maps| maps.read(self.gpu, asked[nth] as u32)).transpose()?;
                    Ok((map.unwrap_or_default(), self.views[asked[nth]].position))
                })?;
                rows.push(Row { wrong: Some(wrong), ..row.of(&frames) });
            }
        }
        Ok(rows)
    }
}
