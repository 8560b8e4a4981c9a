//! `argus study`: the experiments behind the figures.

use std::path::PathBuf;

use anyhow::Context as _;
use argus_studies::{
    Report, baseline, bounds, break_even, burst, cells, hard_cases, radiosity, visibility, walk, warp,
};
use glam::DVec3;
use indicatif::{ProgressBar, ProgressStyle};

use crate::{args, output};

/// Measures what approximations cost and what they are worth, on this machine.
///
/// Each study prints a Markdown table; with --out it also writes Markdown, CSV and JSON. On the software
/// driver, LP_NUM_THREADS=1 keeps samplers and compositors comparable: only its fragment work uses threads.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  LP_NUM_THREADS=1 argus study baseline --out figures
  argus study baseline --scene model.glb --quick
  LP_NUM_THREADS=1 argus study warp --scene terrain:500000 --out figures
  argus study burst --scene terrain:500000 --views 290
  argus study walk --scene sponza.glb --laps 8")]
pub(crate) struct Args {
    #[command(subcommand)]
    study: Study,
}

#[derive(clap::Subcommand)]
enum Study {
    Baseline(Baseline),
    Burst(Burst),
    Warp(Warp),
    Bounds(Bounds),
    Walk(Walk),
    Visibility(VisibilityArgs),
    Cells(Cells),
    BreakEven(BreakEven),
    HardCases(HardCases),
    Radiosity(Radiosity),
}

/// Indirect light by virtual point lights: error and time over their number, their maps, samples a pixel and filter
#[derive(clap::Args)]
struct Radiosity {
    /// A file or `terrain[:TRIANGLES]` [default: terrain:50000]
    #[arg(long, value_name = "S")]
    scene: Option<String>,
    /// One light in place of the scene's lights and sky: point:X,Y,Z or spot:X,Y,Z:DX,DY,DZ:HALF_DEG
    #[arg(long, value_name = "LIGHT", allow_hyphen_values = true)]
    light: Option<radiosity::LightSpec>,
    /// Where the viewer stands, metres; the scene's first camera otherwise
    #[arg(long, value_name = "X,Y,Z", value_parser = args::point, allow_hyphen_values = true, requires = "target")]
    eye: Option<DVec3>,
    /// What the viewer looks at
    #[arg(long, value_name = "X,Y,Z", value_parser = args::point, allow_hyphen_values = true, requires = "eye")]
    target: Option<DVec3>,
    /// Pixels of the view [default: 192x144]
    #[arg(long, value_name = "WxH", value_parser = args::size)]
    size: Option<[u32; 2]>,
    /// Reflections between the light and what is seen, at most [default: 1]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=4))]
    bounces: Option<u32>,
    /// Folder for the images of all rows
    #[arg(long, value_name = "DIR")]
    images: Option<PathBuf>,
    #[command(flatten)]
    form: Form,
}

/// What direct views, samples and both searches cost, and how close they come to the reference
#[derive(clap::Args)]
struct Baseline {
    /// A file or `terrain[:TRIANGLES]`; may be given more than once [default: terrain of 50000, 500000 and
    /// 2000000 triangles]
    #[arg(long, value_name = "S")]
    scene: Vec<String>,
    /// Pixels of a view; may be given more than once [default: 200x150 and 640x480]
    #[arg(long, value_name = "WxH", value_parser = args::size)]
    size: Vec<[u32; 2]>,
    #[command(flatten)]
    form: Form,
}

/// Many views at once, by gRPC, from a cluster that has no samples yet, against all of them rendered directly
#[derive(clap::Args)]
struct Burst {
    /// A file or `terrain[:TRIANGLES]` [default: terrain:500000]
    #[arg(long, value_name = "S")]
    scene: Option<String>,
    /// Views [default: 290]
    #[arg(long, value_name = "N")]
    views: Option<u32>,
    /// Worker processes [default: 2]
    #[arg(long, value_name = "P", value_parser = clap::value_parser!(u16).range(1..=256))]
    workers: Option<u16>,
    #[command(flatten)]
    form: Form,
}

/// What accuracy costs in time: every search × its steps × samples × supersampling, over a walk past what hides
/// other things
#[derive(clap::Args)]
struct Warp {
    /// A file or `terrain[:TRIANGLES]` [default: terrain:500000]
    #[arg(long, value_name = "S")]
    scene: Option<String>,
    /// Pixels of a view [default: 200x150]
    #[arg(long, value_name = "WxH", value_parser = args::size)]
    size: Option<[u32; 2]>,
    /// Views of the walk [default: 12]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=256))]
    views: Option<u16>,
    #[command(flatten)]
    rig: args::Rig,
    #[command(flatten)]
    form: Form,
}

/// Bounds on the error: how often they hold in random views, and what they cost against the cheapest setting
/// that keeps them. The model that it calibrates is kept, and services choose by it from then on.
#[derive(clap::Args)]
struct Bounds {
    /// A file or `terrain[:TRIANGLES]`; may be given more than once [default: terrain:500000]
    #[arg(long, value_name = "S")]
    scene: Vec<String>,
    /// Random views that bounds are tried on [default: 100]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=10_000))]
    views: Option<u16>,
    /// Other random views that the model is calibrated on [default: 100]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(8..=10_000))]
    calibration: Option<u16>,
    /// Pixels of a view [default: 200x150]
    #[arg(long, value_name = "WxH", value_parser = args::size)]
    size: Option<[u32; 2]>,
    #[command(flatten)]
    form: Form,
}

/// A walk through a scene, lap after lap: pixels that no sample saw, and how they vanish as samples are placed
/// where views have holes
#[derive(clap::Args)]
struct Walk {
    /// A file or `terrain[:TRIANGLES]` [default: terrain:50000]
    #[arg(long, value_name = "S")]
    scene: Option<String>,
    /// Viewpoints of a lap [default: 48]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=10_000))]
    views: Option<u16>,
    /// Laps [default: 6]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1000))]
    laps: Option<u16>,
    /// At most so many seconds between two laps, for samples to be placed [default: 60]
    #[arg(long, value_name = "SECONDS", value_parser = args::positive)]
    pause: Option<f64>,
    /// Pixels of a view [default: 200x150]
    #[arg(long, value_name = "WxH", value_parser = args::size)]
    size: Option<[u32; 2]>,
    /// Worker processes [default: 2]
    #[arg(long, value_name = "P", value_parser = clap::value_parser!(u16).range(1..=256))]
    workers: Option<u16>,
    #[command(flatten)]
    rig: args::Rig,
    #[command(flatten)]
    form: Form,
}

/// What each way of seeing triangles costs, for whole views, for single pixels and for samples, and how far the
/// ways agree
#[derive(clap::Args)]
struct VisibilityArgs {
    /// A file or `terrain[:TRIANGLES]`; may be given more than once [default: terrain of 500000 and 2000000
    /// triangles]
    #[arg(long, value_name = "S")]
    scene: Vec<String>,
    /// Pixels of a view; may be given more than once [default: 200x150 and 640x480]
    #[arg(long, value_name = "WxH", value_parser = args::size)]
    size: Vec<[u32; 2]>,
    #[command(flatten)]
    form: Form,
}

/// How far a view may be from its samples: error and unresolved pixels against the distance from the sample
/// cameras, for several spacings of them
#[derive(clap::Args)]
struct Cells {
    /// A file or `terrain[:TRIANGLES]` [default: terrain:500000]
    #[arg(long, value_name = "S")]
    scene: Option<String>,
    /// Pixels of a view [default: 200x150]
    #[arg(long, value_name = "WxH", value_parser = args::size)]
    size: Option<[u32; 2]>,
    /// Views of the walk [default: 6]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=256))]
    views: Option<u16>,
    #[command(flatten)]
    rig: args::Rig,
    #[command(flatten)]
    form: Form,
}

/// From how many views on it pays to take samples, against direct views by each way to see triangles
#[derive(clap::Args)]
struct BreakEven {
    /// A file or `terrain[:TRIANGLES]`; may be given more than once [default: terrain:2000000]
    #[arg(long, value_name = "S")]
    scene: Vec<String>,
    /// Pixels of a view [default: 200x150]
    #[arg(long, value_name = "WxH", value_parser = args::size)]
    size: Option<[u32; 2]>,
    #[command(flatten)]
    rig: args::Rig,
    #[command(flatten)]
    form: Form,
}

/// What makes a reconstruction go wrong, case by case: oracle error and tolerance of every search. Fails if one
/// is out of bounds
#[derive(clap::Args)]
struct HardCases {
    /// Also write the table as a page of the documentation
    #[arg(long, value_name = "FILE")]
    page: Option<PathBuf>,
    #[command(flatten)]
    form: Form,
}

/// How long a study may take, and what becomes of its figures.
#[derive(clap::Args)]
struct Form {
    /// A few seconds, to see that everything works; the figures are noise
    #[arg(long)]
    quick: bool,
    /// Print one JSON object: scene, machine, rows (one object a table row)
    #[arg(long)]
    json: bool,
    /// Folder for the figures as Markdown, CSV and JSON
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

pub(crate) async fn run(args: Args) -> anyhow::Result<()> {
    let progress = ProgressBar::no_length();
    if let Ok(style) = ProgressStyle::with_template("{bar:30} {pos:>3}/{len} {msg} ({elapsed})") {
        progress.set_style(style);
    }
    let (name, form, report) = match args.study {
        Study::Baseline(Baseline { scene, size, form }) => {
            let mut options =
                if form.quick { baseline::Options::quick() } else { baseline::Options::default() };
            if !scene.is_empty() {
                options.scenes = scene;
            }
            if !size.is_empty() {
                options.sizes = size;
            }
            let bar = progress.clone();
            let report = tokio::task::spawn_blocking(move || baseline::run(&options, &bar)).await??;
            ("baseline", form, report)
        }
        Study::Burst(Burst { scene, views, workers, form }) => {
            let mut options = if form.quick { burst::Options::quick() } else { burst::Options::default() };
            options.scene = scene.unwrap_or(options.scene);
            options.views = views.unwrap_or(options.views);
            options.workers = workers.map_or(options.workers, usize::from);
            let report = burst::run(&std::env::current_exe()?, &options, &progress).await?;
            ("burst", form, report)
        }
        Study::Warp(Warp { scene, size, views, rig, form }) => {
            let mut options = if form.quick { warp::Options::quick() } else { warp::Options::default() };
            options.scene = scene.unwrap_or(options.scene);
            options.size = size.unwrap_or(options.size);
            options.views = views.map_or(options.views, usize::from);
            options.rig = rig.knobs();
            if let Some(samples) = rig.samples {
                options.samples = vec![samples as usize];
            }
            let bar = progress.clone();
            let report = tokio::task::spawn_blocking(move || warp::run(&options, &bar)).await??;
            ("warp", form, report)
        }
        Study::Bounds(Bounds { scene, views, calibration, size, form }) => {
            let mut options = if form.quick { bounds::Options::quick() } else { bounds::Options::default() };
            if !scene.is_empty() {
                options.scenes = scene;
            }
            options.views = views.map_or(options.views, usize::from);
            options.calibration = calibration.map_or(options.calibration, usize::from);
            options.size = size.unwrap_or(options.size);
            let bar = progress.clone();
            let report = tokio::task::spawn_blocking(move || bounds::run(&options, &bar)).await??;
            ("bounds", form, report)
        }
        Study::Walk(Walk { scene, views, laps, pause, size, workers, rig, form }) => {
            let mut options = if form.quick { walk::Options::quick() } else { walk::Options::default() };
            options.scene = scene.unwrap_or(options.scene);
            options.views = views.map_or(options.views, usize::from);
            options.laps = laps.map_or(options.laps, usize::from);
            options.pause_secs = pause.unwrap_or(options.pause_secs);
            options.size = size.unwrap_or(options.size);
            options.workers = workers.map_or(options.workers, usize::from);
            options.serve = rig.to_arguments();
            let report = walk::run(&std::env::current_exe()?, &options, &progress).await?;
            ("walk", form, report)
        }
        Study::Visibility(VisibilityArgs { scene, size, form }) => {
            let mut options =
                if form.quick { visibility::Options::quick() } else { visibility::Options::default() };
            if !scene.is_empty() {
                options.scenes = scene;
            }
            if !size.is_empty() {
                options.sizes = size;
            }
            let bar = progress.clone();
            let report = tokio::task::spawn_blocking(move || visibility::run(&options, &bar)).await??;
            ("visibility", form, report)
        }
        Study::Cells(Cells { scene, size, views, rig, form }) => {
            let mut options = if form.quick { cells::Options::quick() } else { cells::Options::default() };
            options.scene = scene.unwrap_or(options.scene);
            options.size = size.unwrap_or(options.size);
            options.views = views.map_or(options.views, usize::from);
            options.rig = rig.knobs();
            options.samples = rig.samples.map_or(options.samples, |n| n as usize);
            let bar = progress.clone();
            let report = tokio::task::spawn_blocking(move || cells::run(&options, &bar)).await??;
            ("cells", form, report)
        }
        Study::BreakEven(BreakEven { scene, size, rig, form }) => {
            let mut options =
                if form.quick { break_even::Options::quick() } else { break_even::Options::default() };
            if !scene.is_empty() {
                options.scenes = scene;
            }
            options.size = size.unwrap_or(options.size);
            options.rig = rig.knobs();
            options.samples = rig.samples.map_or(options.samples, |n| n as usize);
            let bar = progress.clone();
            let report = tokio::task::spawn_blocking(move || break_even::run(&options, &bar)).await??;
            ("break-even", form, report)
        }
        Study::Radiosity(Radiosity { scene, light, eye, target, size, bounces, images, form }) => {
            let mut options =
                if form.quick { radiosity::Options::quick() } else { radiosity::Options::default() };
            options.scene = scene.unwrap_or(options.scene);
            options.light = light.or(options.light);
            if let (Some(eye), Some(target)) = (eye, target) {
                let camera =
                    argus_scene::Camera { fov_deg: 60.0, ..argus_scene::Camera::look_at(eye, target) };
                camera.validate()?;
                options.camera = Some(camera);
            }
            options.size = size.unwrap_or(options.size);
            options.base.bounces = bounces.unwrap_or(options.base.bounces);
            options.images = images;
            let bar = progress.clone();
            let report = tokio::task::spawn_blocking(move || radiosity::run(&options, &bar)).await??;
            ("radiosity", form, report)
        }
        Study::HardCases(HardCases { page, form }) => {
            let bar = progress.clone();
            let report = tokio::task::spawn_blocking(move || hard_cases::run(&bar)).await??;
            if let Some(path) = page {
                let text = hard_cases::page(&report);
                std::fs::write(&path, text).with_context(|| format!("cannot write {}", path.display()))?;
            }
            ("hard-cases", form, report)
        }
    };
    progress.finish_and_clear();
    publish(name, &form, &report)?;
    let failed = report.rows.iter().filter(|row| row.get("passed") == Some(&false.into())).count();
    anyhow::ensure!(failed == 0, "{failed} of {} cases are out of bounds", report.rows.len());
    Ok(())
}

fn publish(name: &str, form: &Form, report: &Report) -> anyhow::Result<()> {
    if let Some(folder) = &form.out {
        for path in report.write(folder, name)? {
            eprintln!("written: {}", path.display());
        }
    }
    if form.json {
        return output::json(report);
    }
    let machine = &report.machine;
    println!(
        "{} ({} cores), {}, LP_NUM_THREADS={}\n",
        machine.cpu, machine.cores, machine.gpu, machine.driver_threads
    );
    print!("{}", report.markdown());
    Ok(())
}
