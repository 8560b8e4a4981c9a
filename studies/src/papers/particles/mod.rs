//! Particles: time and error of the maps of thousands of moving lights (MegaViews, figure 17).
//!
//! A view is lit by some of the particles, the same ones in all rows, with shadows by rays and by each kind of map. Times
//! are of whole frames in which every particle has moved and gets a new map.

mod lit;

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context as _, Result};
use argus_gpu::{Gpu, GpuOptions};
use argus_manylods::{CutMethod, CutSettings, CutTree, ManyLods};
use argus_megaviews::hierarchy::{HierarchyError, Octree, OctreeBuilder, RootCube, stream};
use argus_megaviews::many_views::{ManyViews, MapSet, RasterViews, Settings, ViewList, ViewPoint};
use argus_plot::{Axis, Plot, Series};
use argus_scene::metrics::compare;
use argus_scene::particles::{Particle, glowing};
use argus_scene::reference::Tracer;
use argus_scene::{Bounds, Scene};
use glam::DVec3;
use image::RgbImage;
use indicatif::ProgressBar;
use serde_json::{Map, Value, json};

use self::lit::{Lit, ParticleMap, Visible, exposure};
use crate::arguments::{Viewer, count, or_quick, size};
use crate::median::median;
use crate::{Machine, Report, report};

/// Measures glowing particles that drift through a scene: the time of their maps by MegaViews, ManyLoDs and exact
/// maps, and the error of the shadows and of a view that they light
#[derive(Debug, Clone, clap::Args)]
#[command(after_help = "\
Examples:
  argus-lab study method particles --scene sponza.glb --eye=-11,3,0 --target 0,4,0 --out figures --images pictures
  argus-lab study method particles --scene sponza.glb --particles 1024,4096 --levels 7 --json")]
pub struct Options {
    /// A file, `terrain[:TRIANGLES]`, `mirrors[:BALLS]` or `rooms[:WALL_MM]`; `+balls:N` after it for mirroring balls,
    /// `?environment=FILE` for another sky
    #[arg(long, value_name = "S", default_value = or_quick("terrain:50000", "terrain:20000"))]
    pub scene: String,
    /// Numbers of particles
    #[arg(long, value_name = "N", value_delimiter = ',', value_parser = clap::value_parser!(u32).range(1..=1 << 20), default_value = or_quick("4096,65536", "256,1024"))]
    pub particles: Vec<u32>,
    /// Side of a hemisphere's map in texels
    #[arg(long, value_name = "TEXELS", value_parser = clap::value_parser!(u32).range(8..=256), default_value = "16")]
    pub resolution: u32,
    /// Levels of the scene's octree below its root
    #[arg(long, value_name = "L", value_parser = clap::value_parser!(u32).range(1..=10), default_value = or_quick("8", "5"))]
    pub levels: u32,
    /// Levels of the octree over the particles [default: few enough that each particle lies within one or two cells
    /// of the scene's octree of the point from which its map is rendered]
    #[arg(long, value_name = "L", value_parser = clap::value_parser!(u32).range(1..=10))]
    pub view_levels: Option<u32>,
    /// Number of measured frames, after one that is not counted; times are their median
    #[arg(long, value_name = "N", value_parser = count, default_value = or_quick("3", "1"))]
    pub rounds: usize,
    /// Number of particles that light the judged view
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=65_536), default_value = or_quick("256", "64"))]
    pub lights: u32,
    #[command(flatten)]
    viewer: Viewer,
    /// Size of a view in pixels
    #[arg(long, value_name = "WxH", value_parser = size, default_value = or_quick("192x144", "64x48"))]
    pub size: [u32; 2],
    /// Folder for the images of all rows
    #[arg(long, value_name = "DIR")]
    pub images: Option<PathBuf>,
}

/// Seconds of scene time between frames.
const FRAME_SECS: f64 = 1.0 / 60.0;

/// How the particles' maps are rendered.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Method {
    MegaViews,
    ManyLods,
    Incremental,
    Exact,
    Unshadowed,
}

impl Method {
    const ALL: [Self; 5] =
        [Self::MegaViews, Self::ManyLods, Self::Incremental, Self::Exact, Self::Unshadowed];

    fn name(self) -> &'static str {
        match self {
            Self::MegaViews => "megaviews",
            Self::ManyLods => "manylods",
            Self::Incremental => "manylods, incremental",
            Self::Exact => "exact maps",
            Self::Unshadowed => "no shadows",
        }
    }
}

/// Runs the study; `progress` counts rows.
///
/// # Errors
/// A scene that cannot be opened, no GPU, or a frame that fails.
pub fn run(options: &Options, progress: &ProgressBar) -> Result<Report> {
    let gpu = Gpu::new(&GpuOptions::default())?;
    let scene = Arc::new(argus_scene::open(&options.scene)?);
    progress.set_length((options.particles.len() * Method::ALL.len()) as u64);
    let stage = Stage::new(&gpu, &scene, options)?;
    let mut rows = Vec::new();
    for &count in &options.particles {
        rows.extend(stage.rows(count, progress)?);
    }
    let plot = plot(&rows, options);
    let mut report = Report::new(options.scene.clone(), Machine::here(gpu.kind()), rows);
    report.plots = vec![plot];
    report.notes = vec![
        format!(
            "The view has {}×{} pixels and is lit by {} of the particles, each with its share of the light. \
            wrong_shadow_fraction: share of wrong tests of such a particle against a pixel that faces it. flip, psnr_db: \
            the view against shadows by rays. fell_back: views per node were too few, so megaviews traversed each particle \
            alone.",
            options.size[0],
            options.size[1],
            options.lights.min(options.particles.iter().copied().max().unwrap_or(0)),
        ),
        "Exact maps are rendered only for the view's particles, and their time is scaled to all particles. Rows without a \
        time did not fit into this device's memory."
            .to_owned(),
    ];
    Ok(report)
}

/// One scene, ready to be measured.
struct Stage<'a> {
    gpu: &'a Arc<Gpu>,
    scene: &'a Arc<Scene>,
    options: &'a Options,
    bounds: Bounds,
    octree: Arc<Octree>,
    tracer: Tracer,
    lit: Lit,
}

/// A method's time and figures, and the maps of the view's particles.
#[derive(Default)]
struct Made {
    frame_ms: Option<f64>,
    views_per_node: Option<f64>,
    fell_back: bool,
    pairs: Option<u64>,
    map_bytes: Option<u64>,
    maps: Vec<ParticleMap>,
}

impl<'a> Stage<'a> {
    fn new(gpu: &'a Arc<Gpu>, scene: &'a Arc<Scene>, options: &'a Options) -> Result<Self> {
        let pose = scene.at(0.0);
        let bounds = stream::bounds(stream::triangles(scene, &pose));
        let root = RootCube::around(&bounds);
        let octree = OctreeBuilder::new(gpu).build(root, options.levels, stream::triangles(scene, &pose))?;
        let tracer = Tracer::new(Arc::clone(scene));
        let camera = options.viewer.camera(scene)?;
        let lit = Lit::new(&tracer, &camera, options.size, bounds.size().length());
        Ok(Self { gpu, scene, options, bounds, octree: Arc::new(octree), tracer, lit })
    }

    fn rows(&self, count: u32, progress: &ProgressBar) -> Result<Vec<Map<String, Value>>> {
        let last = self.options.rounds as f64 * FRAME_SECS;
        let all = glowing(&self.bounds, count, 1, last);
        let asked: Vec<usize> = {
            let lights = self.options.lights.min(count);
            (0..lights).map(|i| (u64::from(i) * u64::from(count) / u64::from(lights)) as usize).collect()
        };
        let lights: Vec<Particle> = asked.iter().map(|&i| all[i]).collect();
        let share = f64::from(count) / lights.len() as f64;
        progress.set_message(format!("shadows of {count} by rays"));
        let truth = self.lit.by_rays(&lights, &self.tracer);
        let radiance = self.lit.shade(&lights, &truth, share);
        let exposure = exposure(&radiance);
        let true_image = self.lit.image(&radiance, exposure);
        self.save(&true_image, &format!("{count}-rays"))?;
        let cell = self.octree.root.edge / f64::from(1u32 << self.octree.depth);
        let mut rows = Vec::new();
        for method in Method::ALL {
            progress.set_message(format!("{count} by {}", method.name()));
            let made = self.make(method, count, &asked, &lights)?;
            let slack = if method == Method::Exact { 0.0 } else { 1.5 * cell };
            let visible: Option<Visible> = match method {
                Method::Unshadowed => Some(self.lit.everything(&lights)),
                _ if made.maps.is_empty() => None,
                _ => Some(self.lit.by_maps(&lights, &made.maps, slack)),
            };
            let compared = match &visible {
                Some(visible) => {
                    let image = self.lit.image(&self.lit.shade(&lights, visible, share), exposure);
                    self.save(&image, &format!("{count}-{}", method.name().replace([' ', ','], "-")))?;
                    Some(compare(&true_image, &image)?)
                }
                None => None,
            };
            let wrong = visible.as_ref().map(|visible| self.lit.wrong(&lights, &truth, visible));
            rows.push(report::row(json!({
                "particles": count,
                "method": method.name(),
                "resolution": self.options.resolution,
                "levels": self.options.levels,
                "frame_ms": made.frame_ms,
                "fell_back": made.fell_back,
                "views_per_node": made.views_per_node,
                "pairs_processed": made.pairs,
                "map_bytes": made.map_bytes,
                "wrong_shadow_fraction": wrong,
                "flip": compared.as_ref().map(|c| c.flip_mean),
                "psnr_db": compared.as_ref().map(|c| c.psnr_db).filter(|db| db.is_finite()),
                "ssim": compared.as_ref().map(|c| c.ssim),
            })));
            progress.inc(1);
        }
        Ok(rows)
    }

    fn save(&self, image: &RgbImage, name: &str) -> Result<()> {
        if let Some(folder) = &self.options.images {
            std::fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
            image.save(folder.join(format!("particles-{name}.png")))?;
        }
        Ok(())
    }

    /// The particles as views at a frame.
    fn views(&self, count: u32, frame: usize) -> Result<ViewList> {
        let particles = glowing(&self.bounds, count, 1, frame as f64 * FRAME_SECS);
        let views: Vec<ViewPoint> = particles.iter().map(|p| ViewPoint::everywhere(p.position)).collect();
        Ok(ViewList::new(self.gpu, &self.octree.root, &views)?)
    }

    /// Renders a method's frames; empty if they do not fit into memory.
    fn make(&self, method: Method, count: u32, asked: &[usize], lights: &[Particle]) -> Result<Made> {
        let made = match method {
            Method::MegaViews | Method::ManyLods => self.traversed(method, count, asked),
            Method::Incremental => self.cut(count, asked, lights),
            Method::Exact => self.rastered(count, lights),
            Method::Unshadowed => Ok(Made::default()),
        };
        match made {
            Err(error) if is_too_large(&error) => Ok(Made::default()),
            made => made,
        }
    }

    fn traversed(&self, method: Method, count: u32, asked: &[usize]) -> Result<Made> {
        let settings = Settings {
            side: self.options.resolution,
            sharing: method == Method::MegaViews,
            view_depth: self.options.view_levels,
            ..Settings::default()
        };
        let mut many = ManyViews::new(self.gpu, Arc::clone(&self.octree), settings)?;
        let mut last = None;
        let frame_ms = self.times(count, |list| {
            last = Some(many.render(list)?);
            Ok(())
        })?;
        let stats = last.context("no frame was rendered")?;
        let (map_of_view, middles) = (many.map_of_views(count as usize)?, many.read_map_centers()?);
        let map = |&view: &usize| {
            let map = map_of_view[view];
            Ok(ParticleMap { texels: many.maps().read(self.gpu, map)?, middle: middles[map as usize] })
        };
        Ok(Made {
            frame_ms: Some(frame_ms),
            views_per_node: Some(stats.views_per_node()),
            fell_back: stats.fell_back,
            pairs: Some(stats.processed()),
            map_bytes: Some(stats.map_bytes),
            maps: asked.iter().map(map).collect::<Result<_>>()?,
        })
    }

    fn cut(&self, count: u32, asked: &[usize], lights: &[Particle]) -> Result<Made> {
        let settings = CutSettings {
            method: CutMethod::Incremental,
            side: self.options.resolution,
            ..CutSettings::default()
        };
        let mut cuts = ManyLods::new(self.gpu, CutTree::of_octree(self.gpu, &self.octree)?, settings)?;
        let mut last = None;
        let frame_ms = self.times(count, |list| {
            last = Some(cuts.render(list)?);
            Ok(())
        })?;
        let stats = last.context("no frame was rendered")?;
        let maps = cuts.maps().context("no maps were drawn")?;
        let indices: Vec<u32> = asked.iter().map(|&view| view as u32).collect();
        Ok(Made {
            frame_ms: Some(frame_ms),
            views_per_node: Some(1.0),
            pairs: Some(stats.visits),
            map_bytes: Some(stats.map_bytes),
            maps: self.own(maps, &indices, lights)?,
            ..Made::default()
        })
    }

    fn rastered(&self, count: u32, lights: &[Particle]) -> Result<Made> {
        let settings = Settings { side: self.options.resolution, ..Settings::default() };
        let pose = self.scene.at(0.0);
        let triangles = stream::triangles(self.scene, &pose);
        let mut raster = RasterViews::new(self.gpu, self.octree.root, triangles, settings)?;
        let views: Vec<ViewPoint> = lights.iter().map(|p| ViewPoint::everywhere(p.position)).collect();
        let list = ViewList::new(self.gpu, &self.octree.root, &views)?;
        raster.render(&list)?;
        let frame_ms = raster.render(&list)?.frame_ms;
        let share = f64::from(count) / lights.len() as f64;
        let indices: Vec<u32> = (0..lights.len() as u32).collect();
        Ok(Made {
            frame_ms: Some(frame_ms * share),
            views_per_node: Some(1.0),
            map_bytes: Some((raster.maps().bytes() as f64 * share) as u64),
            maps: self.own(raster.maps(), &indices, lights)?,
            ..Made::default()
        })
    }

    /// Reads maps that are rendered from their own particle's position.
    fn own(&self, maps: &MapSet, indices: &[u32], lights: &[Particle]) -> Result<Vec<ParticleMap>> {
        let map = |(&index, light): (&u32, &Particle)| {
            let middle: DVec3 = light.position;
            Ok(ParticleMap { texels: maps.read(self.gpu, index)?, middle })
        };
        indices.iter().zip(lights).map(map).collect()
    }

    /// Median milliseconds of frames with moving particles, without the first frame.
    fn times(&self, count: u32, mut render: impl FnMut(&ViewList) -> Result<()>) -> Result<f64> {
        let mut times = Vec::new();
        for frame in 0..=self.options.rounds {
            let begin = Instant::now();
            render(&self.views(count, frame)?)?;
            times.push(begin.elapsed().as_secs_f64() * 1e3);
        }
        Ok(median(&times[1..]))
    }
}

/// Whether an error means that something did not fit into memory.
fn is_too_large(error: &anyhow::Error) -> bool {
    matches!(error.downcast_ref(), Some(HierarchyError::TooLarge { .. }))
}

fn plot(rows: &[Map<String, Value>], options: &Options) -> Plot {
    let number = |row: &Map<String, Value>, key: &str| row.get(key).and_then(Value::as_f64);
    let series = |method: &Method| {
        let of = rows.iter().filter(|row| row["method"] == method.name());
        let points = of.filter_map(|row| Some((number(row, "particles")?, number(row, "frame_ms")?)));
        Series { name: method.name().to_owned(), points: points.collect(), line: true }
    };
    Plot {
        name: "time".to_owned(),
        title: format!("Maps of moving particles: {}", options.scene.rsplit('/').next().unwrap_or_default()),
        x: Axis::log("particles"),
        y: Axis::log("time of a frame, ms"),
        series: Method::ALL[..4].iter().map(series).collect(),
        rises: true,
        ..Plot::default()
    }
}
