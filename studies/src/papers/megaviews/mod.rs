//! MegaViews: time and memory of maps of many views, against the number, resolution and placement of views. One run
//! compares MegaViews, ManyLoDs and brute force (the paper's figures 10 to 12).

mod options;
pub(crate) mod placement;
pub(crate) mod shadows;
mod texels;

use std::cell::Cell;
use std::sync::Arc;

use anyhow::{Result, ensure};
use argus_gpu::{Gpu, GpuOptions};
use argus_megaviews::hierarchy::{HierarchyError, Octree, OctreeBuilder, RootCube, stream};
use argus_megaviews::many_views::{
    FrameStats, ManyViews, Occlusion, RasterViews, Settings, Texel, ViewList, ViewPoint,
};
use argus_plot::{Axis, Plot, Series};
use argus_scene::reference::Tracer;
use argus_scene::{Bounds, Light, Pose, Scene};
use glam::DVec3;
use indicatif::ProgressBar;
use serde_json::{Map, Value, json};

pub(crate) use self::options::parse_light;
pub use self::options::{Method, Options};
pub use self::placement::{Emitter, Placement};
use self::shadows::{Shadows, Wrong};
use crate::median::median;
use crate::{Machine, Report};

/// Runs the study; `progress` counts rows.
///
/// # Errors
/// A scene that cannot be opened, a light that reaches nothing, no GPU, or a frame that fails.
pub fn run(options: &Options, progress: &ProgressBar) -> Result<Report> {
    let mut options = options.clone();
    // A row may be extrapolated from the one before it.
    options.views.sort_unstable();
    let options = &options;
    let gpu = Gpu::new(&GpuOptions::default())?;
    let scene = Arc::new(argus_scene::open(&options.scene)?);
    let bench = Bench::new(&gpu, &scene, options)?;
    let variants = options.variants();
    let runs = options.levels.len() * options.placements.len() * options.resolutions.len() * variants.len();
    progress.set_length((runs * options.views.len()) as u64);
    let mut rows = Vec::new();
    for &levels in &options.levels {
        let triangles = || stream::triangles(&scene, &bench.pose);
        let before = gpu.waits();
        let octree = OctreeBuilder::new(&gpu).build(bench.root, levels, triangles())?;
        let octree_waits = gpu.waits() - before;
        let octree = Arc::new(octree);
        for &placement in &options.placements {
            for &resolution in &options.resolutions {
                for &Variant { method, occlusion, texel, discs } in &variants {
                    progress.set_message(format!("{} {} {resolution}²", method.name(), placement.name()));
                    let subject = Subject {
                        octree: &octree,
                        octree_waits,
                        placement,
                        resolution,
                        method,
                        occlusion,
                        texel,
                        discs,
                    };
                    rows.extend(bench.series(&subject, progress)?);
                }
            }
        }
    }
    let plots = plots(&rows, options);
    let mut report = Report::new(options.scene.clone(), Machine::here(gpu.kind()), rows);
    report.plots = plots;
    report.notes = vec![
        "Occlusion on: pairs are processed in four shells, near ones first, so more pairs are tested. Occlusion known: pairs \
        are tested against the finished maps, which shows how many pairs the best order could cull. Pairs that cover no \
        texel's sample point cannot be hidden and count as rendered, with and without occlusion."
            .to_owned(),
        "Pairs are counted once, even if the frame was split. The peak of untested pairs is what a queue would hold if pairs \
        were queued before their test. Extrapolated rows are scaled from the row before, or for raster from a few views."
            .to_owned(),
        "frame_waits, octree_waits: how often the CPU waited for the device for a frame, and to build the scene's octree; neither \
        depends on the number of levels."
            .to_owned(),
        "The range error is the mean relative error against maps with uncompressed texels, over the views whose shadows are \
        judged."
            .to_owned(),
    ];
    report.note_longest_pass(&gpu);
    Ok(report)
}

/// One combination of method and options.
struct Variant {
    method: Method,
    occlusion: Occlusion,
    texel: Texel,
    discs: [f32; 2],
}

impl Options {
    /// Every method with each of its options. Rasterised triangles ignore occlusion and discs, so they are measured
    /// only with the first options.
    fn variants(&self) -> Vec<Variant> {
        let first = (self.occlusion.first(), self.texels.first(), self.discs.first());
        let mut variants = Vec::new();
        for &method in &self.methods {
            for &occlusion in &self.occlusion {
                for &texel in &self.texels {
                    for &discs in &self.discs {
                        if method != Method::Raster || first == (Some(&occlusion), Some(&texel), Some(&discs))
                        {
                            variants.push(Variant { method, occlusion, texel, discs });
                        }
                    }
                }
            }
        }
        variants
    }
}

/// One scene, ready to be measured.
struct Bench<'a> {
    gpu: &'a Arc<Gpu>,
    scene: &'a Arc<Scene>,
    options: &'a Options,
    pose: Pose,
    bounds: Bounds,
    root: RootCube,
    tracer: Tracer,
    emitter: Emitter,
}

/// What the rows of a series share.
struct Subject<'a> {
    octree: &'a Arc<Octree>,
    /// Number of times that its building waited for the device.
    octree_waits: u64,
    placement: Placement,
    resolution: u32,
    method: Method,
    occlusion: Occlusion,
    texel: Texel,
    discs: [f32; 2],
}

impl<'a> Bench<'a> {
    fn new(gpu: &'a Arc<Gpu>, scene: &'a Arc<Scene>, options: &'a Options) -> Result<Self> {
        let pose = scene.at(0.0);
        let bounds = stream::bounds(stream::triangles(scene, &pose));
        let emitter = options.light.unwrap_or_else(|| default_light(&pose, &bounds));
        let tracer = Tracer::new(Arc::clone(scene));
        Ok(Self { gpu, scene, options, bounds, root: RootCube::around(&bounds), tracer, emitter, pose })
    }

    fn views(&self, placement: Placement, count: u32) -> Result<Vec<ViewPoint>> {
        let Self { tracer, pose, bounds, emitter, .. } = self;
        let views = placement::place(tracer, pose, bounds, emitter, placement, count as usize, 1);
        ensure!(
            views.len() == count as usize,
            "light from {emitter:?} reaches {} points only: move it with --light",
            views.len()
        );
        Ok(views)
    }

    /// One row for each number of views.
    fn series(&self, subject: &Subject<'_>, progress: &ProgressBar) -> Result<Vec<Map<String, Value>>> {
        let mut rows = Vec::new();
        let mut before: Option<(u32, Measured)> = None;
        for &count in &self.options.views {
            let expected_secs =
                before.as_ref().map_or(0.0, |(n, m)| m.frame_ms * 1e-3 * f64::from(count) / f64::from(*n));
            let affordable = expected_secs <= self.options.patience_secs;
            let measured = match affordable {
                true => self.measure(subject, count)?,
                false => None,
            };
            let measured = match (measured, &before) {
                (Some(measured), _) => measured,
                (None, Some((n, last))) => last.scaled(f64::from(count) / f64::from(*n)),
                (None, None) => {
                    progress.inc(1);
                    continue;
                }
            };
            rows.push(row(subject, count, &measured));
            before = Some((count, measured));
            progress.inc(1);
        }
        Ok(rows)
    }

    /// Measures one row; `None` if it does not fit into memory.
    fn measure(&self, subject: &Subject<'_>, count: u32) -> Result<Option<Measured>> {
        let &Subject { octree, placement, resolution, method, occlusion, texel, discs, .. } = subject;
        let views = self.views(placement, count)?;
        let settings = Settings {
            side: resolution,
            sharing: method != Method::ManyLods,
            scene_hierarchy: method != Method::FlatScene,
            falls_back: method == Method::MegaViews,
            occlusion,
            texel,
            disc: discs[0],
            shared_disc: discs[1],
            ..self.options.settings()
        };
        let shadows = Shadows::new(&self.tracer, &views, octree.root.edge / f64::from(1u32 << octree.depth));
        if method == Method::Raster {
            let few: Vec<ViewPoint> = shadows.asked().into_iter().map(|view| views[view]).collect();
            let list = ViewList::new(self.gpu, &self.root, &few)?;
            let triangles = stream::triangles(self.scene, &self.pose);
            let mut raster = RasterViews::new(self.gpu, self.root, triangles, settings)?;
            let frames = frames(self.options.rounds, || raster.render(&list))?;
            let wrong =
                shadows.errors(|nth| Ok((raster.maps().read(self.gpu, nth as u32)?, few[nth].position)))?;
            let errors = Errors { wrong, range: None };
            let measured = Measured::of(frames, octree, errors);
            let share = f64::from(count) / few.len() as f64;
            return Ok(Some(if share > 1.0 { measured.scaled(share) } else { measured }));
        }
        let list = ViewList::new(self.gpu, &self.root, &views)?;
        let mut many = match ManyViews::new(self.gpu, Arc::clone(octree), settings) {
            Err(HierarchyError::TooLarge { .. }) => return Ok(None),
            many => many?,
        };
        if occlusion == Occlusion::Known {
            // A traversal knows the maps from its second frame on. The frame after that may fall back.
            match many.render(&list) {
                Err(HierarchyError::TooLarge { .. }) => return Ok(None),
                first => first?,
            };
        }
        let waits = Cell::new(0);
        let render = || {
            let before = self.gpu.waits();
            let frame = many.render(&list);
            waits.set(self.gpu.waits() - before);
            frame
        };
        let frames = match frames(self.options.rounds, render) {
            Err(HierarchyError::TooLarge { .. }) => return Ok(None),
            frames => frames?,
        };
        let maps = many.map_of_views(views.len())?;
        let asked = shadows.asked();
        let middles = many.read_map_centers()?;
        let wrong = shadows.errors(|nth| {
            let map = maps[asked[nth]];
            Ok((many.maps().read(self.gpu, map)?, middles[map as usize]))
        })?;
        let asked: Vec<u32> = asked.into_iter().map(|view| maps[view]).collect();
        let range = texels::range_error(self.gpu, &list, &many, &asked)?;
        let measured = Measured::of(frames, octree, Errors { wrong, range });
        Ok(Some(Measured { frame_waits: Some(waits.get()), ..measured }))
    }
}

/// The light if none is given: the first point or spot light, or a spot light in the upper middle of the bounds.
pub(crate) fn default_light(pose: &Pose, bounds: &Bounds) -> Emitter {
    let of = |light: &Light| match *light {
        Light::Point { position, .. } => Some(Emitter::Point { position }),
        Light::Spot { position, direction, outer_cone, .. } => {
            Some(Emitter::Spot { position, direction, half_angle: outer_cone })
        }
        Light::Directional { .. } => None,
    };
    let above = bounds.center() + DVec3::Y * 0.45 * bounds.size().y;
    let spot = Emitter::Spot { position: above, direction: DVec3::NEG_Y, half_angle: 1.2 };
    pose.lighting.lights.iter().find_map(of).unwrap_or(spot)
}

/// Renders frames after a first one, which finds how to split the frame and how many maps there are.
fn frames(
    rounds: usize,
    mut render: impl FnMut() -> Result<FrameStats, HierarchyError>,
) -> Result<Vec<FrameStats>, HierarchyError> {
    render()?;
    (0..rounds.max(1)).map(|_| render()).collect()
}

/// What is measured for a row.
struct Measured {
    frame_ms: f64,
    stages: Map<String, Value>,
    last: FrameStats,
    octree_bytes: u64,
    errors: Errors,
    /// Number of times that the last frame waited for the device.
    frame_waits: Option<u64>,
    extrapolated: bool,
}

/// Errors of the maps.
#[derive(Clone, Copy)]
struct Errors {
    wrong: Wrong,
    /// Mean relative range error caused by the texel format.
    range: Option<f64>,
}

impl Measured {
    fn of(mut frames: Vec<FrameStats>, octree: &Octree, errors: Errors) -> Self {
        let times: Vec<f64> = frames.iter().map(|frame| frame.frame_ms).collect();
        let last = frames.pop().unwrap_or_default();
        let mut stages = Map::new();
        for stage in &last.stages {
            stages.insert(stage.name.clone(), json!((stage.ms * 1e3).round() / 1e3));
        }
        let octree_bytes = octree.bytes();
        let frame_ms = median(&times);
        Self { frame_ms, stages, last, octree_bytes, errors, frame_waits: None, extrapolated: false }
    }

    /// Scales the figures to `factor` times as many views at the same cost each.
    fn scaled(&self, factor: f64) -> Self {
        let times = |n: u64| (n as f64 * factor) as u64;
        let mut last = self.last.clone();
        for step in &mut last.steps {
            for count in
                [&mut step.tested, &mut step.culled, &mut step.rendered, &mut step.queued, &mut step.sharing]
            {
                *count = times(*count);
            }
        }
        last.map_bytes = times(last.map_bytes);
        last.view_bytes = times(last.view_bytes);
        Self { frame_ms: self.frame_ms * factor, stages: Map::new(), last, extrapolated: true, ..*self }
    }
}

fn row(subject: &Subject<'_>, views: u32, measured: &Measured) -> Map<String, Value> {
    let last = &measured.last;
    let view_levels = (last.view_depth > 0).then_some(last.view_depth);
    // Bytes of the queue if it were not split, of the maps, of the view octree and of the scene octree.
    let bytes = json!({
        "queue": last.peak_queued() * 8,
        "maps": last.map_bytes,
        "views": last.view_bytes,
        "scene": measured.octree_bytes,
    });
    let pairs = [
        ("method", json!(subject.method.name())),
        ("placement", json!(subject.placement.name())),
        ("views", json!(views)),
        ("resolution", json!(subject.resolution)),
        ("levels", json!(subject.octree.depth)),
        ("view_levels", json!(view_levels)),
        ("view_directions", json!(view_levels.map(|_| last.tells_directions))),
        ("frame_ms", json!(measured.frame_ms)),
        ("frame_waits", json!(measured.frame_waits)),
        ("octree_ms", json!(subject.octree.times.total_ms)),
        ("octree_waits", json!(subject.octree_waits)),
        ("occlusion", json!((subject.method != Method::Raster).then_some(subject.occlusion.name()))),
        ("texel", json!(subject.texel.name())),
        ("disc", json!((subject.method != Method::Raster).then_some(subject.discs[0]))),
        ("shared_disc", json!((subject.method != Method::Raster).then_some(subject.discs[1]))),
        ("extrapolated", json!(measured.extrapolated)),
        ("fell_back", json!(last.fell_back)),
        ("pairs_processed", json!(last.processed())),
        ("pairs_rendered", json!(last.rendered())),
        ("pairs_peak", json!(last.peak_queued())),
        ("pairs_peak_untested", json!(last.peak_untested())),
        ("views_per_node", json!(last.views_per_node())),
        ("multipass_level", json!(last.multipass_level)),
        ("maps", json!(last.maps)),
        ("wrong_shadow_fraction", json!(measured.errors.wrong.wrong())),
        ("wrongly_lit_fraction", json!(measured.errors.wrong.lit)),
        ("range_error", json!(measured.errors.range)),
        ("stages_ms", Value::Object(measured.stages.clone())),
        ("bytes", bytes),
    ];
    pairs.into_iter().map(|(key, value)| (key.to_owned(), value)).collect()
}

/// Plots per placement: time against views, against resolution if there are several, and texel errors.
fn plots(rows: &[Map<String, Value>], options: &Options) -> Vec<Plot> {
    let number =
        |row: &Map<String, Value>, key: &str| row.get(key).and_then(Value::as_f64).unwrap_or(f64::NAN);
    let scene = options.scene.rsplit('/').next().unwrap_or_default();
    let draw = |placement: Placement, x: &str, label: &str, fixed: &str, value: f64| {
        let series = options.methods.iter().map(|method| {
            let of = |row: &&Map<String, Value>| {
                row["placement"] == placement.name()
                    && row["method"] == method.name()
                    && (row["occlusion"].is_null() || row["occlusion"] == options.occlusion[0].name())
                    && row["texel"] == options.texels[0].name()
                    && (row["disc"].is_null() || row["disc"] == json!(options.discs[0][0]))
                    && (row["shared_disc"].is_null() || row["shared_disc"] == json!(options.discs[0][1]))
                    && number(row, fixed) == value
            };
            let points =
                rows.iter().filter(of).map(|row| (number(row, x), number(row, "frame_ms"))).collect();
            Series { name: method.name().to_owned(), points, line: true }
        });
        Plot {
            name: format!("{x}-{}", placement.name()),
            title: format!("Maps of many views: {scene}, {}", placement.name()),
            x: Axis::log(label),
            y: Axis::log("time of a frame, ms"),
            series: series.collect(),
            rises: true,
            ..Plot::default()
        }
    };
    let resolution = f64::from(*options.resolutions.first().unwrap_or(&16));
    let views = f64::from(*options.views.last().unwrap_or(&0));
    let placements = || options.placements.iter().copied();
    let against_views = placements().map(|p| draw(p, "views", "views", "resolution", resolution));
    let against_resolution = placements()
        .filter(|_| options.resolutions.len() > 1)
        .map(|p| draw(p, "resolution", "texels of a hemisphere's side", "views", views));
    let against_error = placements()
        .filter(|_| options.texels.len() > 1)
        .map(|p| texels::plot(rows, &options.texels, p, format!("Texels: {scene}, {}", p.name())));
    against_views.chain(against_resolution).chain(against_error).collect()
}
