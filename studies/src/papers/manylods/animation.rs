//! Cuts of an animation by three methods: anew, from the last frame's cut, and lazily (table 1 and figure 8).

use std::collections::BTreeSet;

use anyhow::Result;
use argus_manylods::{CutMethod, CutStats, ManyLods};
use argus_megaviews::hierarchy::HierarchyError;
use argus_megaviews::many_views::ViewList;
use argus_plot::{Axis, Plot, Series};
use indicatif::ProgressBar;

use super::motion::{Path, triangles_at, views_at};
use super::options::Options;
use super::stage::{Stage, Tree};
use super::table::Row;

/// The number of steps that the progress bar counts.
pub(super) fn length(options: &Options) -> usize {
    let runs = options.motions.len() * 2 + options.motions.len();
    runs + 1
}

/// The rows of every path, motion, tree and method, with plots of visits against motion and of time per frame.
pub(super) fn rows(stage: &Stage<'_>, progress: &ProgressBar) -> Result<(Vec<Row>, Vec<Plot>)> {
    let mut rows = Vec::new();
    for path in Path::ALL {
        // An octree would have to be rebuilt each frame.
        let trees = if path == Path::Scene { &Tree::ALL[..1] } else { &Tree::ALL[..] };
        for &tree in trees {
            for &motion in &stage.options.motions {
                progress.set_message(format!("{} of {} by {motion}", path.name(), tree.name()));
                progress.inc(1);
                rows.extend(run(stage, path, tree, motion)?);
            }
        }
    }
    progress.set_message("frame by frame");
    let plots = vec![against_motion(&rows), time_line(stage)?];
    progress.inc(1);
    Ok((rows, plots))
}

fn methods(options: &Options) -> [CutMethod; 3] {
    [CutMethod::Basic, CutMethod::Incremental, CutMethod::Lazy { edges: options.edges }]
}

/// Runs the three methods over the same frames.
fn run(stage: &Stage<'_>, path: Path, tree: Tree, motion: f64) -> Result<Vec<Row>> {
    let options = stage.options;
    let warm = options.frames.div_ceil(4);
    let distances: Vec<f64> =
        (0..warm + options.frames).map(|n| f64::from(n) * motion * stage.extent()).collect();
    let Some(frames) = frames(stage, path, tree, &distances)? else {
        return Ok(Vec::new());
    };
    let row = |(of, method): (&Frames, CutMethod)| {
        let row = Row {
            part: "animation",
            tree: Some(tree.name()),
            method: Some(method.name()),
            path: Some(path.name()),
            threshold: Some(1.0),
            views: Some(options.views),
            motion: Some(motion),
            differing: Some(of.differing),
            ..Row::default()
        };
        row.of(&of.stats[warm as usize..])
    };
    let rows: Vec<Row> = frames.iter().zip(methods(options)).map(row).collect();
    let basic = rows[0].clone();
    let compared = rows.into_iter().map(|row| {
        let ratio = |of: &dyn Fn(&Row) -> Option<f64>| Some(of(&basic)? / of(&row)?);
        Row {
            fewer_visits: ratio(&|row| row.visits),
            fewer_operations: ratio(&|row| Some(row.operations())),
            faster: ratio(&|row| row.cut_ms),
            ..row
        }
    });
    Ok(compared.collect())
}

/// One method's frames, and the share of its last cuts' nodes that differ from the basic method's.
struct Frames {
    stats: Vec<CutStats>,
    differing: f64,
}

/// Renders the same frames with the three methods. `distances`: how far things have moved at each frame, in metres. `None` if
/// the cuts do not fit.
fn frames(stage: &Stage<'_>, path: Path, tree: Tree, distances: &[f64]) -> Result<Option<Vec<Frames>>> {
    let mut balls = None;
    let cut_tree = match path {
        Path::Scene => {
            let own = stage.builder.build(stage.root, stage.options.ball_levels, &stage.triangles)?;
            let tree = argus_manylods::CutTree::of_spheres(&own);
            balls = Some(own);
            tree
        }
        Path::Views => stage.tree(tree)?,
    };
    let make = |method| ManyLods::new(stage.gpu, cut_tree.clone(), stage.settings(method, 1.0));
    let mut cuts = methods(stage.options).map(make).into_iter().collect::<Result<Vec<_>, _>>()?;
    let mut stats = vec![Vec::new(); cuts.len()];
    for &distance in distances {
        let list = match (&mut balls, path) {
            (Some(balls), Path::Scene) => {
                stage.builder.update(balls, &triangles_at(stage, distance))?;
                ViewList::new(stage.gpu, &stage.root, &stage.views)?
            }
            _ => ViewList::new(stage.gpu, &stage.root, &views_at(stage, distance))?,
        };
        for (cuts, stats) in cuts.iter_mut().zip(&mut stats) {
            match cuts.select(&list) {
                Err(HierarchyError::TooLarge { .. }) => return Ok(None),
                frame => stats.push(frame?),
            }
        }
    }
    let sets = cuts
        .iter()
        .map(|cuts| Ok(cuts.cuts()?.into_iter().collect()))
        .collect::<Result<Vec<BTreeSet<_>>>>()?;
    let differing =
        |set: &BTreeSet<[u32; 2]>| set.difference(&sets[0]).count() as f64 / sets[0].len().max(1) as f64;
    let all = stats.into_iter().zip(&sets).map(|(stats, set)| Frames { stats, differing: differing(set) });
    Ok(Some(all.collect()))
}

/// A plot of the basic method's visits over each other method's, against the motion of the views.
fn against_motion(rows: &[Row]) -> Plot {
    let series = |(tree, method): (Tree, &str)| {
        let is = |row: &&Row| {
            row.path == Some("views") && row.tree == Some(tree.name()) && row.method == Some(method)
        };
        let points = rows.iter().filter(is).filter_map(|row| Some((100.0 * row.motion?, row.fewer_visits?)));
        Series { name: format!("{method}, {}", tree.name()), points: points.collect(), line: true }
    };
    let kinds = Tree::ALL.into_iter().flat_map(|tree| ["incremental", "lazy"].map(|method| (tree, method)));
    Plot {
        name: "visits-motion".to_owned(),
        title: "Moving views: node visits of the basic method over those of each method".to_owned(),
        x: Axis::log("motion a frame, % of the scene"),
        y: Axis::log("times fewer visits"),
        series: kinds.map(series).collect(),
        ..Plot::default()
    }
}

/// A plot of the time of each frame while views stand, start, rush and stop.
fn time_line(stage: &Stage<'_>) -> Result<Plot> {
    let count = 2 * stage.options.frames;
    let mut distances = vec![0.0];
    for frame in 0..count {
        // Two bursts up to the fastest motion; the second is shorter.
        let at = f64::from(frame) / f64::from(count);
        let burst = |middle: f64, width: f64| (1.0 - ((at - middle) / width).powi(2)).max(0.0);
        let most = stage.options.motions.iter().copied().fold(0.0, f64::max);
        let speed = most * (burst(0.35, 0.25) + burst(0.8, 0.1)).min(1.0);
        distances.push(distances[distances.len() - 1] + speed * stage.extent());
    }
    let frames = frames(stage, Path::Views, Tree::Balls, &distances)?.unwrap_or_default();
    let series = |(of, method): (&Frames, CutMethod)| {
        let points = of.stats.iter().enumerate().skip(1).map(|(n, frame)| (n as f64, frame.cut_ms()));
        Series { name: method.name().to_owned(), points: points.collect(), line: true }
    };
    Ok(Plot {
        name: "frames".to_owned(),
        title: format!("Cuts of {} views that stand, rush and stop", stage.options.views),
        x: Axis::linear("frame"),
        y: Axis::linear("finding the cuts, ms"),
        series: frames.iter().zip(methods(stage.options)).map(series).collect(),
        ..Plot::default()
    })
}
