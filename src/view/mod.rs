//! `argus view`: renders one view into a file.

mod alone;
pub(crate) mod images;
pub(crate) mod record;
mod report;

use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::Context;
use argus_client::{Answer, RenderOptions};
use argus_cluster::coordinator::Config;
use argus_proto::Description;
use argus_scene::reference::{DirectLight, Indirect as Paths, Tracer, cache};
use argus_scene::{
    Camera, Indirect, LightEffects, LightLevel, Output, Plan, PlanRequest, Provenance, SceneState, View,
    metrics,
};
use glam::DVec3;

use self::alone::AloneArgs;
use self::record::Record;
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
/// The file's format follows from --output. color: sRGB PNG. mask, source and confidence: grey PNG. mask: 255 where no sample saw the
/// pixel's surface. source: the number, from 1, of the plan's sample that served the pixel; 0 for none. confidence: 0 to 127, plus
/// 128 if a second sample agrees. The rest are OpenEXR. radiance: channels R, G, B, linear, before exposure. range: distance from the
/// eye, metres, +inf for the sky. depth: channel Z, the same along the camera's axis. normal: N.X, N.Y, N.Z in world space. instance
/// and material: indices, 4294967295 for the sky. flow: flow.X and flow.Y, pixels right and down to where a camera at --flow-eye
/// shows the same point.
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
  argus view --output color,depth,normal,instance --out images --provenance images.json
  argus view --intrinsics 500,500,320,240 --distortion -0.3,0.1,0,0 --pose pose.txt --out lens.png
`argus scene S` lists viewpoints that the scene's author recommends."
)]
pub(crate) struct Args {
    #[command(flatten)]
    server: args::Server,
    #[command(flatten)]
    alone: AloneArgs,
    #[command(flatten)]
    viewpoint: args::Viewpoint,
    #[command(flatten)]
    lens: args::LensArgs,
    /// Size of the image in pixels
    #[arg(long, value_name = "WxH", default_value = "640x480", value_parser = args::size)]
    size: [u32; 2],
    /// Images to write, with commas between or by several flags: color, range, mask, source, confidence, radiance, depth, normal,
    /// instance, material, flow
    #[arg(long, value_name = "IMAGE", default_value = "color", value_delimiter = ',', value_parser = args::output())]
    output: Vec<Output>,
    /// File to write; with several images, a folder of files that are named for them: color.png, depth.exr, …
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Position of the camera that flow leads to, metres; its up direction and field of view are the view's
    #[arg(long, value_name = "X,Y,Z", value_parser = args::point, allow_hyphen_values = true)]
    flow_eye: Option<DVec3>,
    /// Point that this camera looks at, metres [default: as far from --flow-eye, and in the same direction, as the view's target from its
    /// eye]
    #[arg(long, value_name = "X,Y,Z", requires = "flow_eye", value_parser = args::point, allow_hyphen_values = true)]
    flow_target: Option<DVec3>,
    /// Also write what made the frame as JSON, for `argus replay`; not with --scene
    #[arg(long, value_name = "FILE", conflicts_with = "scene")]
    provenance: Option<PathBuf>,
    /// Show an animated scene at this time, rounded to the nearest epoch, instead of the time that is served now (with --scene:
    /// 0); needs --direct or --scene
    #[arg(long, value_name = "SECONDS", value_parser = args::zero_or_more)]
    time: Option<f64>,
    /// Give up after this many seconds; a view of --scene takes as long as it takes
    #[arg(long, value_name = "SECONDS", default_value = "60", value_parser = args::positive)]
    timeout: f64,
    /// Also render the reference on this machine, which is slow, and report the true error beside the predicted one; needs
    /// the scene's file here
    #[arg(long, conflicts_with = "rays")]
    verify: bool,
    /// Print one JSON object: width, height, camera, epoch, light, search, samples, decision: {reason, wait_ms, render_ms, excess},
    /// unresolved_fraction, served, worker, predicted: {error, ms}, measured_ms, true_error, digest, stages_ms: {name: ms}, total_ms, …
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    plan: args::Plan,
}

impl Args {
    /// The view of these flags in a scene with that default view.
    ///
    /// # Errors
    /// A lens or pose that is malformed.
    fn view(&self, usual: Camera, pin: Option<Provenance>) -> anyhow::Result<View> {
        let [width, height] = self.size;
        let camera = self.lens.camera(self.viewpoint.camera(usual))?;
        let (camera, rays) = self.lens.listed(camera, width)?;
        let (outputs, plan) = (self.output.iter().copied().collect(), self.plan.request());
        let flow_to = self.flow_eye.map(|eye| {
            let target = self.flow_target.unwrap_or(eye + (camera.target - camera.eye));
            Camera { eye, target, ..camera }
        });
        Ok(View { camera, width, height, outputs, plan, pin, flow_to, rays })
    }
}

pub(crate) async fn run(args: Args, sources: &Sources) -> anyhow::Result<()> {
    if args.verify && args.output != [Output::Color] {
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
    let outputs: Vec<Output> = taken.view.outputs.iter().collect();
    for (output, file) in images::files(&args.out, &outputs) {
        images::write(&file, output, &taken.frame)?;
    }
    if let Some(file) = &args.provenance {
        Record::of(&taken.view, &taken.scene.0, &taken.frame).write(file)?;
    }
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
    let view = args.view(usual, pin)?;
    let deadline =
        Duration::try_from_secs_f64(args.timeout).unwrap_or(Duration::from_secs(u64::from(u32::MAX)));
    let options = RenderOptions { deadline, ..RenderOptions::default() };
    let Answer { frame, meta, latency, attempts } = client.render(&view, &options).await?;
    Ok(Taken {
        view,
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
    let view = args.view(scene.default_camera(), None)?;
    let frame = alone.render(&view, light, args.time.unwrap_or(0.0))?;
    Ok(Taken {
        view,
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
    let state = SceneState {
        epoch: epoch_of(secs, description.epoch_secs)?,
        light: description.first_light,
        revision: 0,
    };
    let plan = Plan::Direct { samples_per_pixel, detail, light: None };
    Ok(Provenance::of_plan(description.scene_hash, state, plan))
}

/// Mean FLIP of a view against the reference. The reference is traced on this machine and kept for the next call.
fn true_error(taken: &Taken) -> anyhow::Result<f64> {
    let Taken { view, frame, scene: (name, hash), epoch_secs, .. } = taken;
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
    let reference =
        cache::render_with(folder, &tracer, &view.camera, size, REFERENCE_SAMPLES, indirect, |_| ());
    Ok(metrics::flip_mean(&reference.display(exposure), &output::image_of(frame)?)?)
}
