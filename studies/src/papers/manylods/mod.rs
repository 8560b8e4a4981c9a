//! ManyLoDs: cuts of many views through a hierarchy of the scene (the paper's tables 1 and 2, figures 7 and 8).
//!
//! Measures building and refitting the hierarchy, finding cuts anew and from the last frame's, and the error of maps
//! drawn from the cuts beside other maps that take as long.

mod animation;
mod equal_time;
mod motion;
mod table;

use std::sync::Arc;

use anyhow::{Result, ensure};
use argus_gpu::{Gpu, GpuOptions};
use argus_manylods::{CutMethod, CutSettings, CutStats, CutTree, ManyLods};
use argus_manylods::{SphereBuilder, SphereHierarchy};
use argus_megaviews::hierarchy::{HierarchyError, Octree, OctreeBuilder, RootCube, Triangle, stream};
use argus_megaviews::many_views::{ViewList, ViewPoint};
use argus_scene::reference::Tracer;
use argus_scene::{Bounds, Pose, Scene};
use indicatif::ProgressBar;

use self::table::Row;
use crate::median::median;
use crate::papers::megaviews::shadows::Shadows;
use crate::papers::megaviews::{Emitter, Placement, default_light, placement};
use crate::{Effort, Machine, Report};

/// What the study measures.
#[derive(Debug, Clone)]
pub struct Options {
    /// A scene, as [`argus_scene::open`] takes it.
    pub scene: String,
    /// Views: the points that the light reaches first.
    pub views: u32,
    /// Side of a hemisphere's map in texels.
    pub resolution: u32,
    /// Levels of the octree.
    pub levels: u32,
    /// Levels of the ball tree: the logarithm (base 2) of its number of points.
    pub ball_levels: u32,
    /// Largest projected size of a node in texels.
    pub thresholds: Vec<f32>,
    /// Motion per frame, as shares of the scene's largest extent.
    pub motions: Vec<f64>,
    /// Measured frames of an animation, after a quarter as many to warm up.
    pub frames: u32,
    /// Edges that a lazy cut may follow down in a frame.
    pub edges: u32,
    /// How far lazy cuts may lag, as a share of the root's edge.
    pub lag: f64,
    /// The light that places the views, as in [`crate::papers::megaviews::Options::light`].
    pub light: Option<Emitter>,
    /// Measured frames where nothing moves; each time is their median.
    pub rounds: usize,
}

impl Default for Options {
    /// Takes some minutes on two cores.
    fn default() -> Self {
        Self {
            scene: "terrain:50000".to_owned(),
            views: 1024,
            resolution: 16,
            levels: 9,
            ball_levels: 20,
            thresholds: vec![1.0, 2.0, 4.0],
            motions: vec![0.0005, 0.001, 0.002, 0.005, 0.01],
            frames: 24,
            edges: 1,
            lag: 0.005,
            light: None,
            rounds: 3,
        }
    }
}

impl Effort for Options {
    fn quick() -> Self {
        Self {
            scene: "terrain:20000".to_owned(),
            views: 64,
            levels: 5,
            ball_levels: 12,
            thresholds: vec![1.0, 4.0],
            motions: vec![0.002, 0.005],
            frames: 8,
            rounds: 1,
            ..Self::default()
        }
    }
}

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

/// The kinds of tree.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Tree {
    Balls,
    Octree,
}

impl Tree {
    const ALL: [Self; 2] = [Self::Balls, Self::Octree];

    fn name(self) -> &'static str {
        match self {
            Self::Balls => "balls",
            Self::Octree => "octree",
        }
    }
}

/// One scene, ready to be measured.
struct Stage<'a> {
    gpu: &'a Arc<Gpu>,
    options: &'a Options,
    scene: &'a Arc<Scene>,
    bounds: Bounds,
    root: RootCube,
    triangles: Vec<Triangle>,
    octree: Octree,
    builder: SphereBuilder,
    balls: SphereHierarchy,
    tracer: Tracer,
    views: Vec<ViewPoint>,
}

impl<'a> Stage<'a> {
    fn new(gpu: &'a Arc<Gpu>, scene: &'a Arc<Scene>, options: &'a Options) -> Result<Self> {
        let pose: Pose = scene.at(0.0);
        let triangles: Vec<Triangle> = stream::triangles(scene, &pose).collect();
        // The bounds include every pose of an animated scene, and the bent poses of a still one.
        let mut bounds = stream::bounds(triangles.iter().copied());
        if scene.is_animated() {
            bounds.extend(scene.bounds().min);
            bounds.extend(scene.bounds().max);
        }
        let root = RootCube::around(&bounds);
        let builder = SphereBuilder::new(gpu);
        let balls = builder.build(root, options.ball_levels, &triangles)?;
        let octree = OctreeBuilder::new(gpu).build(root, options.levels, triangles.iter().copied())?;
        let tracer = Tracer::new(Arc::clone(scene));
        let emitter = options.light.unwrap_or_else(|| default_light(&pose, &bounds));
        let (count, seed) = (options.views as usize, 1);
        let views = placement::place(&tracer, &pose, &bounds, &emitter, Placement::SingleBounce, count, seed);
        ensure!(views.len() == count, "light from {emitter:?} reaches {} points only: move it", views.len());
        Ok(Self { gpu, options, scene, bounds, root, triangles, octree, builder, balls, tracer, views })
    }

    fn tree(&self, tree: Tree) -> Result<CutTree> {
        Ok(match tree {
            Tree::Balls => CutTree::of_spheres(&self.balls),
            Tree::Octree => CutTree::of_octree(self.gpu, &self.octree)?,
        })
    }

    fn settings(&self, method: CutMethod, threshold: f32) -> CutSettings {
        CutSettings {
            method,
            side: self.options.resolution,
            threshold,
            lag: self.options.lag,
            ..CutSettings::default()
        }
    }

    /// The length in metres to which motions are relative.
    fn extent(&self) -> f64 {
        self.bounds.size().max_element()
    }

    fn shadows(&self) -> Shadows<'_> {
        Shadows::new(&self.tracer, &self.views, self.octree.root.edge / f64::from(1u32 << self.octree.depth))
    }

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

/// Renders frames after a first one that finds the memory they need; `None` if the device has too little.
fn frames(
    rounds: usize,
    mut render: impl FnMut() -> Result<CutStats, HierarchyError>,
) -> Result<Option<Vec<CutStats>>, HierarchyError> {
    match render() {
        Err(HierarchyError::TooLarge { .. }) => Ok(None),
        first => first.and_then(|_| (0..rounds.max(1)).map(|_| render()).collect::<Result<_, _>>().map(Some)),
    }
}
