//! `argus view`: renders one view into a file.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use anyhow::Context;
use argus_client::{Answer, RenderOptions};
use argus_proto::Description;
use argus_scene::frame::Decision;
use argus_scene::reference::{DirectLight, Indirect as Paths, Tracer, cache};
use argus_scene::{
    Camera, Frame, Holes, Indirect, LightEffects, LightLevel, Output, Outputs, Plan, PlanRequest, Prediction,
    Provenance, SceneState, Served, Specification, View,
};
use argus_studies::calibration;
use glam::DVec3;
use serde::Serialize;

use crate::exit::bad_arguments;
use crate::settings::Sources;
use crate::{args, output};

/// Paths of the reference's indirect light at each of a pixel's samples, and their reflections.
const LIGHT_PATHS: u32 = 4;
const LIGHT_BOUNCES: u32 = 5;
/// Rays of the reference to each light, at each of a pixel's samples.
const LIGHT_RAYS: u32 = 8;
/// Samples per pixel of the reference, the same as in the calibration.
const REFERENCE_SAMPLES: u32 = 16;

/// Renders one view and writes it to a file.
///
/// The file's format follows from --output. color: sRGB PNG. range: OpenEXR with one 32-bit float channel, Z, in
/// metres from the eye, +inf for the sky. The rest are grey PNG. mask: 255 where no sample saw the pixel's surface.
/// source: the number, from 1, of the plan's sample that served the pixel; 0 for none. confidence: 0 to 127, plus 128
/// if a second sample agrees.
#[derive(clap::Args)]
#[command(
    allow_negative_numbers = true,
    after_help = "\
Examples:
  argus view --eye 60,40,60 --target 0,5,0 --out view.png
  argus view --eye 60,40,60 --target 0,5,0 --direct --out exact.png
  argus view --eye 60,40,60 --target 0,5,0 --max-error 0.05 --verify --out good-enough.png
  argus view --eye -1.5,2,0 --target 0,2,-3 --fov-deg 70 --output range --out range.exr --json
`argus scene S` lists viewpoints that the scene's author recommends."
)]
pub(crate) struct Args {
    #[command(flatten)]
    server: args::Server,
    #[command(flatten)]
    camera: CameraArgs,
    /// Size of the image in pixels
    #[arg(long, value_name = "WxH", default_value = "640x480", value_parser = args::size)]
    size: [u32; 2],
    /// Image to write: color, range, mask, source or confidence
    #[arg(long, value_name = "IMAGE", default_value = "color", value_parser = args::output())]
    output: Output,
    /// File to write
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Show an animated scene at this time, rounded to the nearest epoch, instead of the time that is served now
    #[arg(long, value_name = "SECONDS", requires = "direct", value_parser = args::zero_or_more)]
    time: Option<f64>,
    /// Give up after this many seconds
    #[arg(long, value_name = "SECONDS", default_value = "60", value_parser = args::positive)]
    timeout: f64,
    /// Also render the reference on this machine, which is slow, and report the true error beside the predicted one; needs
    /// the scene's file here
    #[arg(long)]
    verify: bool,
    /// Print one JSON object: width, height, epoch, light, search, samples, decision: {reason, wait_ms, render_ms, excess},
    /// unresolved_fraction, served, worker, predicted: {error, ms}, measured_ms, true_error, stages_ms: {name: ms}, total_ms, …
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    plan: args::Plan,
}

#[derive(clap::Args)]
struct CameraArgs {
    /// Position of the viewer, metres
    #[arg(long, value_name = "X,Y,Z", value_parser = args::point, allow_hyphen_values = true)]
    eye: DVec3,
    /// Point that the viewer looks at, metres
    #[arg(long, value_name = "X,Y,Z", value_parser = args::point, allow_hyphen_values = true)]
    target: DVec3,
    /// Direction that points up in the image
    #[arg(long, value_name = "X,Y,Z", default_value = "0,1,0", value_parser = args::point, allow_hyphen_values = true)]
    up: DVec3,
    /// Vertical field of view, degrees
    #[arg(long, value_name = "DEG", default_value = "45", allow_hyphen_values = true)]
    fov_deg: f64,
}

#[derive(Serialize)]
struct Report {
    width: u32,
    height: u32,
    epoch: u64,
    /// How much of the set's light is shown: direct, coarse or full.
    light: LightLevel,
    /// The search's name, or `direct`.
    search: &'static str,
    /// Samples per pixel of a direct view, sub-pixels per pixel of a reconstructed one.
    samples: Vec<String>,
    /// Samples a pixel of a direct view, sub-pixels a pixel of a reconstructed one.
    samples_per_pixel: u32,
    unresolved_fraction: f64,
    /// Pixels by how they were served; all 0 for a direct view.
    served: Served,
    /// `mark` or `trace`; absent for a direct view.
    holes: Option<Holes>,
    /// Why the service chose the plan, with its prediction; absent if the arguments name the plan.
    decision: Option<Decision>,
    /// The service's prediction: an upper bound of the mean FLIP error, and milliseconds of rendering.
    predicted: Option<Prediction>,
    /// Milliseconds of rendering, including frames that were rejected because they missed the bound.
    measured_ms: f64,
    /// Mean FLIP against the reference, with --verify.
    true_error: Option<f64>,
    worker: String,
    device: String,
    /// How the samples were rendered, or the view itself where it comes from triangles.
    specification: Option<Specification>,
    /// BLAKE3 of the specification, hexadecimal.
    specification_hash: Option<String>,
    stages_ms: BTreeMap<String, f64>,
    /// Milliseconds that the frame spent within the service.
    age_ms: f64,
    /// Milliseconds from the request to the whole frame, measured by this client.
    total_ms: f64,
    attempts: u32,
}

impl Report {
    fn of(answer: &Answer) -> Self {
        let Answer { frame, meta, latency, attempts } = answer;
        let (search, samples, samples_per_pixel) = match &frame.provenance.plan {
            Plan::Direct { samples_per_pixel } => ("direct", Vec::new(), *samples_per_pixel),
            Plan::Warp(warp) => {
                let samples = warp.samples.iter().map(ToString::to_string).collect();
                (warp.search.name(), samples, warp.supersampling.pow(2))
            }
        };
        let holes = match &frame.provenance.plan {
            Plan::Direct { .. } => None,
            Plan::Warp(warp) => Some(warp.holes),
        };
        let mut stages_ms = BTreeMap::new();
        for stage in &frame.stages {
            // The times of a pass that ran more than once are added.
            *stages_ms.entry(stage.name.clone()).or_default() += stage.ms;
        }
        Self {
            width: frame.width,
            height: frame.height,
            epoch: frame.provenance.state.epoch,
            light: frame.provenance.state.light,
            search,
            samples,
            samples_per_pixel,
            unresolved_fraction: frame.unresolved_fraction,
            served: frame.served,
            holes,
            decision: frame.decision,
            predicted: frame.predicted,
            measured_ms: frame.rendering_ms(),
            true_error: None,
            worker: meta.worker.clone(),
            device: frame.provenance.device.clone(),
            specification: frame.provenance.specification,
            specification_hash: frame
                .provenance
                .specification
                .map(|specification| specification.hash().to_string()),
            stages_ms,
            age_ms: meta.age_ms,
            total_ms: latency.as_secs_f64() * 1e3,
            attempts: *attempts,
        }
    }
}

pub(crate) async fn run(args: Args, sources: &Sources) -> anyhow::Result<()> {
    let CameraArgs { eye, target, up, fov_deg } = args.camera;
    let [width, height] = args.size;
    if args.verify && args.output != Output::Color {
        return Err(bad_arguments("--verify compares colours: use it without --output"));
    }
    let camera = Camera { eye, target, up, fov_deg };
    let client = args.server.connect(sources, 1).await?;
    let plan = args.plan.request();
    let pin = args.time.map(|secs| moment(client.description(), &plan, secs)).transpose()?;
    let view = View { camera, width, height, outputs: Outputs::only(args.output), plan, pin };
    let deadline =
        Duration::try_from_secs_f64(args.timeout).unwrap_or(Duration::from_secs(u64::from(u32::MAX)));
    let options = RenderOptions { deadline, ..RenderOptions::default() };
    let answer = client.render(&view, &options).await?;
    write(&args.out, args.output, &answer.frame)?;
    let mut report = Report::of(&answer);
    if args.verify {
        let (description, frame) = (client.description().clone(), answer.frame.clone());
        let judged = tokio::task::spawn_blocking(move || true_error(&description, &camera, &frame));
        report.true_error = Some(judged.await??);
    }
    if args.json {
        return output::json(&report);
    }
    println!("{}: {}x{}, {}", args.out.display(), report.width, report.height, report.search);
    println!("  worker      {}, from {} samples", report.worker, report.samples.len());
    if let Some(decision) = report.decision {
        println!("  because     {}", decision.reason.phrase());
    }
    println!("  unresolved  {:.3}% of the pixels", report.unresolved_fraction * 100.0);
    if let Some(Prediction { error, ms }) = report.predicted {
        println!("  predicted   an error of at most {error:.4}, {ms:.1} ms of rendering");
    }
    if let Some(error) = report.true_error {
        println!("  true error  {error:.4} (mean FLIP against the reference)");
    }
    println!("  rendering   {:.1} ms", report.measured_ms);
    println!("  took        {:.1} ms, {:.1} ms of them within the service", report.total_ms, report.age_ms);
    for (name, ms) in &report.stages_ms {
        println!("    {ms:9.3} ms  {name}");
    }
    Ok(())
}

/// The provenance of a view from triangles at a scene time.
fn moment(description: &Description, plan: &PlanRequest, secs: f64) -> anyhow::Result<Provenance> {
    let epoch_secs = description.epoch_secs;
    anyhow::ensure!(epoch_secs > 0.0 || secs == 0.0, "nothing moves in this scene, so its only time is 0");
    let side = plan.supersampling.unwrap_or(1);
    Ok(Provenance {
        scene: description.scene_hash,
        state: SceneState {
            epoch: if epoch_secs > 0.0 { (secs / epoch_secs).round() as u64 } else { 0 },
            light: description.first_light,
        },
        plan: Plan::Direct { samples_per_pixel: side.saturating_mul(side) },
        specification: None,
        device: String::new(),
        history: false,
    })
}

/// Mean FLIP of a frame against the reference. The reference is traced on this machine and kept for the next call.
fn true_error(description: &Description, camera: &Camera, frame: &Frame) -> anyhow::Result<f64> {
    let scene = argus_scene::open(&description.scene_name)
        .with_context(|| format!("--verify needs the scene {} here", description.scene_name))?;
    anyhow::ensure!(
        scene.hash == description.scene_hash,
        "the scene file of that name on this machine differs from the served scene"
    );
    let specification = frame.provenance.specification;
    let exposure = specification.map_or(scene.lighting.exposure, |set| set.exposure);
    let indirect = specification.map_or(Indirect::Off, |set| set.indirect);
    let has_indirect = frame.provenance.state.light > LightLevel::Direct;
    let indirect = (has_indirect && indirect != Indirect::Off)
        .then_some(Paths { paths: LIGHT_PATHS, bounces: LIGHT_BOUNCES });
    let time_secs = frame.provenance.state.epoch as f64 * description.epoch_secs;
    let effects = specification.map_or(LightEffects::NONE, |set| set.effects);
    let tracer = Tracer::new(Arc::new(scene)).at(time_secs);
    let tracer = tracer.with_direct_light(DirectLight { effects, rays: LIGHT_RAYS });
    let (folder, size) = (cache::directory(), [frame.width, frame.height]);
    let folder = folder.as_deref();
    let reference = cache::render_with(folder, &tracer, camera, size, REFERENCE_SAMPLES, indirect, |_| ());
    calibration::error(frame, &reference.display(exposure))
}

/// Writes the requested image.
fn write(path: &Path, output: Output, frame: &Frame) -> anyhow::Result<()> {
    let (width, height) = (frame.width, frame.height);
    let image = frame.image(output).context("the frame lacks the requested image")?;
    match output {
        Output::Color => output::write_rgb_png(path, width, height, image),
        Output::Range => output::write_range_exr(path, width, height, image),
        Output::Mask | Output::Source | Output::Confidence => {
            output::write_gray_png(path, width, height, image)
        }
    }
}
