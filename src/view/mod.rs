//! `argus view`: renders one view into a file.

mod alone;
mod report;

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::Context;
use argus_client::{Answer, RenderOptions};
use argus_cluster::coordinator::Config;
use argus_proto::Description;
use argus_scene::reference::{DirectLight, Indirect as Paths, Tracer, cache};
use argus_scene::{
    Camera, Frame, Indirect, LightEffects, LightLevel, Output, Outputs, Plan, PlanRequest, Provenance,
    SceneState, View, metrics,
};

use self::alone::AloneArgs;
use self::report::{Report, Taken};
use crate::exit::bad_arguments;
use crate::settings::Sources;
use crate::wiring::{Alone, epoch_of};
use crate::{args, output};

/// Paths of the reference's indirect light at each of a pixel's samples, and their reflections.
const LIGHT_PATHS: u32 = 4;
const LIGHT_BOUNCES: u32 = 5;
/// Rays of the reference to each light, at each of a pixel's samples.
const LIGHT_RAYS: u32 = 8;
/// Samples per pixel of the reference, the same as in the calibration.
const REFERENCE_SAMPLES: u32 = 16;

/// Renders one view and writes it to a file: by a service, or with --scene in this process.
///
/// The file's format follows from --output. color: sRGB PNG. range: OpenEXR with one 32-bit float channel, Z, in
/// metres from the eye, +inf for the sky. The rest are grey PNG. mask: 255 where no sample saw the pixel's surface.
/// source: the number, from 1, of the plan's sample that served the pixel; 0 for none. confidence: 0 to 127, plus 128
/// if a second sample agrees.
#[derive(clap::Args, Clone)]
#[command(
    allow_negative_numbers = true,
    after_help = "\
Examples:
  argus view --out view.png
  argus view --scene model.glb --out model.png
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
    alone: AloneArgs,
    #[command(flatten)]
    viewpoint: args::Viewpoint,
    /// Size of the image in pixels
    #[arg(long, value_name = "WxH", default_value = "640x480", value_parser = args::size)]
    size: [u32; 2],
    /// Image to write: color, range, mask, source or confidence
    #[arg(long, value_name = "IMAGE", default_value = "color", value_parser = args::output())]
    output: Output,
    /// File to write
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Show an animated scene at this time, rounded to the nearest epoch, instead of the time that is served now (with --scene:
    /// 0); needs --direct or --scene
    #[arg(long, value_name = "SECONDS", value_parser = args::zero_or_more)]
    time: Option<f64>,
    /// Give up after this many seconds; a view of --scene takes as long as it takes
    #[arg(long, value_name = "SECONDS", default_value = "60", value_parser = args::positive)]
    timeout: f64,
    /// Also render the reference on this machine, which is slow, and report the true error beside the predicted one; needs
    /// the scene's file here
    #[arg(long)]
    verify: bool,
    /// Print one JSON object: width, height, camera, epoch, light, search, samples, decision: {reason, wait_ms, render_ms, excess},
    /// unresolved_fraction, served, worker, predicted: {error, ms}, measured_ms, true_error, stages_ms: {name: ms}, total_ms, …
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    plan: args::Plan,
}

impl Args {
    /// The view of these flags in a scene with that default view.
    fn view(&self, usual: Camera, pin: Option<Provenance>) -> View {
        let [width, height] = self.size;
        let (camera, outputs) = (self.viewpoint.camera(usual), Outputs::only(self.output));
        View { camera, width, height, outputs, plan: self.plan.request(), pin }
    }
}

pub(crate) async fn run(args: Args, sources: &Sources) -> anyhow::Result<()> {
    if args.verify && args.output != Output::Color {
        return Err(bad_arguments("--verify compares colours: use it without --output"));
    }
    if args.time.is_some() && !args.plan.direct && args.alone.scene.is_none() {
        return Err(bad_arguments("--time needs --direct: samples show the time that is served now"));
    }
    let taken = match &args.alone.scene {
        Some(_) => {
            let config = args.alone.config(sources)?;
            let args = args.clone();
            tokio::task::spawn_blocking(move || alone(&args, &config)).await??
        }
        None => served(&args, sources).await?,
    };
    write(&args.out, args.output, &taken.frame)?;
    let mut report = Report::of(&taken);
    if args.verify {
        let judged = tokio::task::spawn_blocking(move || true_error(&taken));
        report.true_error = Some(judged.await??);
    }
    if args.json {
        return output::json(&report);
    }
    report.print(&args.out, args.plan.max_error);
    Ok(())
}

/// Asks a service for the view.
async fn served(args: &Args, sources: &Sources) -> anyhow::Result<Taken> {
    let client = args.server.connect(sources, 1).await?;
    let description = client.description();
    let plan = args.plan.request();
    let pin = args.time.map(|secs| moment(description, &plan, secs)).transpose()?;
    let usual = description.cameras.first().context("the service names no camera")?.camera;
    let view = args.view(usual, pin);
    let deadline =
        Duration::try_from_secs_f64(args.timeout).unwrap_or(Duration::from_secs(u64::from(u32::MAX)));
    let options = RenderOptions { deadline, ..RenderOptions::default() };
    let Answer { frame, meta, latency, attempts } = client.render(&view, &options).await?;
    Ok(Taken {
        camera: view.camera,
        frame,
        scene: (description.scene_name.clone(), description.scene_hash),
        epoch_secs: description.epoch_secs,
        worker: meta.worker,
        start: Vec::new(),
        age_ms: meta.age_ms,
        total_ms: latency.as_secs_f64() * 1e3,
        attempts,
    })
}

/// Renders the view in this process, in all the light that a service would give it.
fn alone(args: &Args, config: &Config) -> anyhow::Result<Taken> {
    let began = Instant::now();
    let mut alone = Alone::open(&args.alone.spec(), config)?;
    let (scene, light) = (alone.scene().clone(), alone.full_light());
    let view = args.view(scene.default_camera(), None);
    let frame = alone.render(&view, light, args.time.unwrap_or(0.0))?;
    Ok(Taken {
        camera: view.camera,
        frame,
        scene: (scene.name.clone(), scene.hash),
        epoch_secs: alone.prepared().set.epoch_secs,
        worker: String::new(),
        start: alone.start,
        age_ms: 0.0,
        total_ms: began.elapsed().as_secs_f64() * 1e3,
        attempts: 1,
    })
}

/// The provenance of a view from triangles at a scene time.
fn moment(description: &Description, plan: &PlanRequest, secs: f64) -> anyhow::Result<Provenance> {
    let side = plan.supersampling.unwrap_or(1);
    let (samples_per_pixel, detail) = (side.saturating_mul(side), plan.detail.unwrap_or_default());
    let state = SceneState { epoch: epoch_of(secs, description.epoch_secs)?, light: description.first_light };
    let plan = Plan::Direct { samples_per_pixel, detail, light: None };
    Ok(Provenance::of_plan(description.scene_hash, state, plan))
}

/// Mean FLIP of a view against the reference. The reference is traced on this machine and kept for the next call.
fn true_error(taken: &Taken) -> anyhow::Result<f64> {
    let Taken { camera, frame, scene: (name, hash), epoch_secs, .. } = taken;
    let scene = argus_scene::open(name).with_context(|| format!("--verify needs the scene {name} here"))?;
    let mut scene = scene
        .in_light_of(*hash)
        .context("the scene file of that name on this machine differs from the served scene")?;
    let specification = frame.provenance.specification;
    let exposure = specification.map_or(scene.lighting.exposure, |set| set.exposure);
    scene.lighting.exposure = exposure;
    let indirect = specification.map_or(Indirect::Off, |set| set.indirect);
    let has_indirect = frame.provenance.state.light > LightLevel::Direct;
    let indirect = (has_indirect && indirect != Indirect::Off)
        .then_some(Paths { paths: LIGHT_PATHS, bounces: LIGHT_BOUNCES });
    let time_secs = frame.provenance.state.epoch as f64 * epoch_secs;
    let effects = specification.map_or(LightEffects::NONE, |set| set.effects);
    let tracer = Tracer::new(Arc::new(scene)).at(time_secs);
    let tracer = tracer.with_direct_light(DirectLight { effects, rays: LIGHT_RAYS });
    let (folder, size) = (cache::directory(), [frame.width, frame.height]);
    let folder = folder.as_deref();
    let reference = cache::render_with(folder, &tracer, camera, size, REFERENCE_SAMPLES, indirect, |_| ());
    Ok(metrics::flip_mean(&reference.display(exposure), &output::image_of(frame)?)?)
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
