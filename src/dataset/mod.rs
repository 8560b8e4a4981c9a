//! `argus dataset`: renders the images of a data set, from a file of its cameras.

mod bop;
mod bounded;
mod colmap;
mod files;
mod journal;
mod model;
mod read;
mod render;
mod shots;
#[cfg(test)]
mod tests;
mod transforms;

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use argus_client::Client;
use argus_local::LocalCluster;
use argus_scene::{Output, PlanRequest, Specification};
use serde::Serialize;

use self::files::Writer;
use self::journal::{Header, Journal};
use self::render::{Job, Outcome};
use self::shots::{Cameras, Format};
use crate::exit::bad_arguments;
use crate::settings::Sources;
use crate::{args, output, processes};

/// Metres of a step of a depth image of 16 bits, where neither the file nor a flag says so.
const DEPTH_UNIT: f64 = 0.001;

/// Renders the images of a data set, from a file of its cameras: by a service, or with --scene by one that this command starts.
///
/// The folder DIR gets the images and a file of cameras in the format of FILE. transforms.json: colours at file_path, depth/ as PNG of 16
/// bits in steps of a millimetre. COLMAP: images/, sparse/, and stereo/depth_maps/ as floats in metres. BOP: rgb/, and depth/ as PNG
/// of 16 bits in steps of depth_scale. Other outputs are in folders of their names, as of `argus view`. Depth is along the camera's
/// axis, and 0 where nothing is.
///
/// A metre of the scene is a unit of transforms.json and COLMAP, and 1000 of BOP. Axes are the scene's. The centre of the first pixel is
/// (0.5, 0.5) in transforms.json and COLMAP, and (0, 0) in BOP.
///
/// A run that was stopped goes on if it is started again: finished frames are verified by their digests, and not rendered again.
/// argus-dataset.jsonl in DIR has a line a frame, with its digests and what made it.
#[derive(clap::Args)]
#[command(after_help = "\
Camera models: SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV, OPENCV_FISHEYE, FULL_OPENCV.
Examples:
  argus dataset --cameras transforms.json --out set --scene model.glb
  argus dataset --cameras sparse/0 --out set --outputs color,depth,normal,instance
  argus dataset --cameras 000001/scene_camera.json --out set --server http://127.0.0.1:7400 --direct")]
pub(crate) struct Args {
    /// Cameras: a transforms.json of NeRF, a folder of a model of COLMAP (cameras and images, .txt or .bin), or a scene_camera.json
    /// of BOP, with its camera.json in the same folder or one of the two above
    #[arg(long, value_name = "FILE")]
    cameras: PathBuf,
    /// Folder of the data set: empty, or that of a run that was stopped
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Images of each frame, with commas between or by several flags: color, range, mask, source, confidence, radiance, depth,
    /// normal, instance, material, flow (to the next image's camera)
    #[arg(
        long,
        alias = "output",
        value_name = "IMAGE",
        default_value = "color",
        value_delimiter = ',',
        value_parser = args::output()
    )]
    outputs: Vec<Output>,
    /// Size of the images in pixels, where FILE has none
    #[arg(long, value_name = "WxH", value_parser = args::size)]
    size: Option<[u32; 2]>,
    /// Metres of a step of a depth image of 16 bits [default: that of FILE, else 0.001]. 65535 steps are the farthest depth; what
    /// is farther is written as 0 and counted
    #[arg(long, value_name = "METRES", value_parser = args::positive)]
    depth_unit: Option<f64>,
    #[command(flatten)]
    server: args::Server,
    /// Start a service of this scene on this machine for the run: a file (.glb, .gltf, .obj, .ply) or a built-in scene, as of
    /// `argus serve`
    #[arg(long, value_name = "S", conflicts_with_all = ["server", "ca", "token_file"])]
    scene: Option<String>,
    /// Number of worker processes of that service [default: one a core, at least 2 and at most 4]
    #[arg(long, value_name = "P", requires = "scene", value_parser = clap::value_parser!(u16).range(1..=256))]
    workers: Option<u16>,
    /// Give up if no frame comes for this many seconds
    #[arg(long, value_name = "SECONDS", default_value = "600", value_parser = args::positive)]
    timeout: f64,
    /// Print one JSON object: format, frames, rendered, verified (finished by an earlier run), failed, first_error, depth_beyond
    /// (pixels), seconds
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    plan: args::Plan,
    #[command(flatten)]
    rendering: args::PassedOn<args::Rendering>,
}

/// What a run did.
#[derive(Serialize)]
struct Report {
    format: &'static str,
    frames: usize,
    rendered: u64,
    /// Frames of an earlier run, whose files have the digests of then.
    verified: usize,
    failed: u64,
    first_error: Option<String>,
    /// Pixels whose depth 16 bits do not hold.
    depth_beyond: u64,
    seconds: f64,
}

pub(crate) async fn run(args: Args, sources: &Sources) -> anyhow::Result<()> {
    let (path, size) = (args.cameras.clone(), args.size);
    let reading = tokio::task::spawn_blocking(move || read::cameras(&path, size));
    let cameras = reading
        .await?
        .and_then(|cameras| {
            files::check_paths(&cameras, args.outputs.iter().copied().collect()).map(|()| cameras)
        })
        .map_err(|error| bad_arguments(format!("--cameras {}: {error:#}", args.cameras.display())))?;
    if args.scene.is_none() && !args.rendering.arguments.is_empty() {
        let flags = args.rendering.arguments.join(" ");
        return Err(bad_arguments(format!(
            "{flags}: is of a service that is started here, and needs --scene"
        )));
    }
    let progress = output::progress();
    let Some(scene) = &args.scene else {
        let client = args.server.connect(sources, 2).await?;
        return fill(&args, cameras, client, &progress).await;
    };
    let workers = args.workers.map_or_else(processes::default_count, usize::from);
    progress.set_message(format!("starting a coordinator and {workers} workers"));
    let program = std::env::current_exe().context("cannot find this program's own file")?;
    let (scene, more) = (scene.clone(), args.rendering.arguments.clone());
    let starting = tokio::task::spawn_blocking(move || LocalCluster::start(&program, &scene, workers, &more));
    let cluster = starting.await??;
    let client = argus_local::connect(&cluster, workers).await?;
    let filled = fill(&args, cameras, client, &progress).await;
    let stopped = tokio::task::spawn_blocking(move || cluster.stop()).await?;
    filled.and(stopped)
}

/// Fills the folder with what it lacks.
async fn fill(
    args: &Args,
    cameras: Cameras,
    client: Client,
    progress: &indicatif::ProgressBar,
) -> anyhow::Result<()> {
    let began = Instant::now();
    let in_file = cameras.shots.first().and_then(|shot| shot.depth_unit);
    let depth_unit = args.depth_unit.or(in_file).unwrap_or(DEPTH_UNIT);
    if !(depth_unit > 0.0 && depth_unit.is_finite()) {
        return Err(bad_arguments(format!(
            "--cameras {}: its unit of depth must be above 0, not {depth_unit}: or give --depth-unit",
            args.cameras.display()
        )));
    }
    let outputs = args.outputs.iter().copied().collect();
    let requested = args.plan.request();
    // Frames whose plans are left open would differ between runs. A batch fixes them.
    let plan = match args.outputs.contains(&Output::Flow) && requested.leaves_way_open() {
        true => PlanRequest { direct: true, ..requested },
        false => requested,
    };
    let format = cameras.format;
    let job = Job {
        client,
        cameras: Arc::new(cameras),
        outputs,
        plan,
        writer: Arc::new(Writer { format, out: args.out.clone(), outputs, depth_unit }),
        patience: Duration::try_from_secs_f64(args.timeout).unwrap_or(Duration::from_secs(u32::MAX.into())),
    };
    let description = job.client.description();
    for (index, shot) in job.cameras.shots.iter().enumerate() {
        let valid = job.view(index).validate(&description.limits);
        valid.map_err(|at| {
            bad_arguments(format!("--cameras {}: image {}: {at}", args.cameras.display(), shot.name))
        })?;
    }
    let header = Header {
        scene: description.scene_name.clone(),
        scene_hash: description.scene_hash,
        format: format.name().to_owned(),
        outputs,
        plan,
        depth_unit,
    };
    let mut journal = Journal::open(&args.out, &header)?;
    progress.set_length(job.cameras.shots.len() as u64);
    progress.set_message("verifying finished frames");
    let (left, like) = left(&job, &journal, progress);
    let verified = job.cameras.shots.len() - left.len();
    let outcome = job.run(&left, like, &mut journal, progress).await?;
    write_cameras(&job.cameras, &args.outputs, &args.out, depth_unit)?;
    progress.finish_and_clear();
    let Outcome { rendered, failed, first_error, beyond: depth_beyond } = outcome;
    let seconds = began.elapsed().as_secs_f64();
    let frames = job.cameras.shots.len();
    let report = Report {
        format: format.name(),
        frames,
        rendered,
        verified,
        failed,
        first_error,
        depth_beyond,
        seconds,
    };
    if args.json {
        output::json(&report)?;
    } else {
        report.print(&args.out);
    }
    if let Some(error) = report.first_error {
        bail!("{failed} frames failed, the first one {error}: run the same command again to go on");
    }
    Ok(())
}

/// The images that are still to be rendered, and the specification of those that are finished.
fn left(
    job: &Job,
    journal: &Journal,
    progress: &indicatif::ProgressBar,
) -> (Vec<usize>, Option<Specification>) {
    let (mut left, mut like) = (Vec::new(), None);
    for (index, shot) in job.cameras.shots.iter().enumerate() {
        match journal.earlier.get(&shot.name).filter(|entry| job.is_finished(index, entry)) {
            Some(entry) => {
                like = like.or(entry.record.provenance.specification);
                progress.inc(1);
            }
            None => left.push(index),
        }
    }
    (left, like)
}

/// Writes the file of cameras, in its own format.
fn write_cameras(cameras: &Cameras, outputs: &[Output], out: &Path, depth_unit: f64) -> anyhow::Result<()> {
    match cameras.format {
        Format::Transforms => {
            let text = transforms::write(cameras, outputs, depth_unit)?;
            files::save(&out.join("transforms.json"), text.as_bytes())
        }
        Format::ColmapText | Format::ColmapBinary => {
            let files = colmap::write(cameras)?;
            files.iter().try_for_each(|(name, bytes)| files::save(&out.join("sparse").join(name), bytes))
        }
        Format::Bop => {
            let files = bop::write(cameras, depth_unit)?;
            files.iter().try_for_each(|(name, bytes)| files::save(&out.join(name), bytes))
        }
    }
}

impl Report {
    fn print(&self, out: &Path) {
        let Self { format, frames, rendered, verified, failed, seconds, .. } = self;
        println!("{}: {frames} frames, {format}", out.display());
        println!("  {rendered} rendered, {verified} verified, {failed} failed, in {seconds:.1} s");
        if self.depth_beyond > 0 {
            println!(
                "  {} pixels are farther than 65535 steps of depth, and written as 0: give a larger --depth-unit",
                self.depth_beyond
            );
        }
    }
}
