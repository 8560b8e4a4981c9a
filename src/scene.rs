//! `argus scene`: the contents of a scene.

use std::path::{Path, PathBuf};

use anyhow::Context;
use argus_cluster::SceneSource;
use argus_cluster::coordinator::Config;
use argus_scene::effects::{EffectCost, EffectRow};
use argus_scene::mitsuba::{self, Settings, SkyLight};
use argus_scene::{
    Bounds, Camera, Effect, EffectPlan, EffectRequest, Effects, Exposure, LightRequest, Outputs, PlanRequest,
    RigKind, Scene, View,
};
use serde::Serialize;

use crate::wiring::{Alone, OpenScene};
use crate::{args, effect_table, output};

/// Pixels of the view by which `--costs` measures effects.
const MEASURED_SIZE: [u32; 2] = [160, 120];

/// Describes a scene: triangles, bounds, materials, lights, cameras, and the effects that it calls for.
#[derive(clap::Args)]
#[command(
    allow_negative_numbers = true,
    after_help = "\
Examples:
  argus scene model.glb
  argus scene terrain:2000000 --json
  argus scene model.glb --plan --effects all
  argus scene model.glb --mitsuba exported --eye 3,2,5 --target 0,1,0 --fov-deg 45 --size 640x480"
)]
pub(crate) struct Args {
    /// A file (.glb, .gltf, .obj, .ply), `terrain[:TRIANGLES]`, `mirrors[:BALLS]` or `rooms[:WALL_MM]`, and `+balls:N`
    /// after it for mirroring balls
    #[arg(value_name = "S")]
    scene: String,
    #[command(flatten)]
    environment: args::Environment,
    /// Show the effect plan instead: for each effect of light its cause, how often it is paid, the largest change of a
    /// pixel, and whether and why `argus serve` computes it. Renders nothing, unless --costs is given
    #[arg(long)]
    plan: bool,
    /// Also measure what the effects that are on cost, by two small views: with indirect light this takes seconds. What effects that
    /// are off would cost, a service measures: see `argus status --effects`
    #[arg(long, requires = "plan")]
    costs: bool,
    /// Plan for these effects, as of `argus serve`
    #[arg(long, value_name = "LIST", default_value = "auto", value_parser = args::effects, requires = "plan")]
    effects: Effects,
    /// Plan for, or export, the scene in this light, as of `argus serve`: auto, file, sky or interior
    #[arg(long, value_name = "LIGHT", default_value = "auto", value_parser = args::light)]
    light: LightRequest,
    /// Print one JSON object: name, hash, triangles, instances, materials, textures, lights, cameras,
    /// default_camera, animations, bounds {min, max} (null if the scene is empty), extent (what viewers look at), rig, effects,
    /// warnings. With --plan: name, hash, light,
    /// light_effects, indirect, exposure, and rows of effect, causes, paid, predicted_ms, bound, on, why, measured_ms,
    /// saved_ms. With --mitsuba: shapes, triangles, materials, bitmaps, emitters, differences
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    export: Export,
}

/// A view of the scene as files for Mitsuba 3. Instead of the scene's contents, the number of files and what Mitsuba shows
/// otherwise are printed.
#[derive(clap::Args)]
#[command(next_help_heading = "Export for Mitsuba 3 (docs/mitsuba.md)")]
struct Export {
    /// Write scene.xml, meshes and bitmaps to this folder
    #[arg(long, value_name = "FOLDER")]
    mitsuba: Option<PathBuf>,
    #[command(flatten)]
    picture: args::Picture,
    /// Time of an animated scene, seconds
    #[arg(long, value_name = "SECONDS", default_value = "0", value_parser = args::zero_or_more)]
    time: f64,
    /// Leave out gloss, metal and transmission
    #[arg(long)]
    matt: bool,
    /// Replace the sky by one that lights unoccluded matt surfaces exactly as Argus approximates it
    #[arg(long)]
    ambient_sky: bool,
}

#[derive(Serialize)]
struct Report<'a> {
    name: &'a str,
    hash: String,
    triangles: usize,
    instances: usize,
    materials: usize,
    textures: usize,
    lights: usize,
    cameras: usize,
    /// The view of clients that name no camera.
    default_camera: Camera,
    animations: usize,
    bounds: Corners,
    /// The box of what viewers look at.
    extent: Corners,
    rig: RigKind,
    effects: Vec<Effect>,
    warnings: &'a [String],
}

#[derive(Serialize)]
struct Corners {
    min: Option<[f64; 3]>,
    max: Option<[f64; 3]>,
}

impl Corners {
    fn of(bounds: Bounds) -> Self {
        if bounds.is_empty() {
            return Self { min: None, max: None };
        }
        Self { min: Some(bounds.min.to_array()), max: Some(bounds.max.to_array()) }
    }
}

impl<'a> Report<'a> {
    fn of(scene: &'a Scene) -> Self {
        Self {
            name: &scene.name,
            hash: scene.hash.to_string(),
            triangles: scene.triangles(),
            instances: scene.instances.len(),
            materials: scene.materials.len(),
            textures: scene.textures.len(),
            lights: scene.lighting.lights.len(),
            cameras: scene.cameras.len(),
            default_camera: scene.default_camera(),
            animations: scene.animations.len(),
            bounds: Corners::of(scene.bounds()),
            extent: Corners::of(scene.extent()),
            rig: scene.rig,
            effects: scene.effects(),
            warnings: &scene.warnings,
        }
    }
}

/// Exports a view, and prints what was written.
fn export(scene: Scene, args: &Export, folder: &Path, json: bool) -> anyhow::Result<()> {
    let scene = if args.matt { mitsuba::matt(scene) } else { scene };
    let settings = Settings {
        camera: args.picture.camera(&scene)?,
        size: args.picture.size,
        time_secs: args.time,
        sky: if args.ambient_sky { SkyLight::Ambient } else { SkyLight::Seen },
    };
    let exported = mitsuba::write(&scene, &settings, folder)
        .with_context(|| format!("cannot export to {}", folder.display()))?;
    if json {
        return output::json(&exported);
    }
    println!("{}", folder.join("scene.xml").display());
    println!("  shapes      {}, triangles {}", exported.shapes, exported.triangles);
    println!("  materials   {}, bitmaps {}", exported.materials, exported.bitmaps);
    println!("  emitters    {}", exported.emitters);
    for difference in &exported.differences {
        println!("  difference  {difference}");
    }
    Ok(())
}

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    if args.plan {
        return plan(args);
    }
    let spec = args.environment.of(&args.scene);
    if let Some(folder) = &args.export.mitsuba {
        let opened = OpenScene::open(&spec, args.light, EffectRequest::default().metering())?;
        let scene = Scene::clone(opened.scene());
        return export(scene, &args.export, folder, args.json);
    }
    let scene = argus_scene::open(&spec)?;
    let report = Report::of(&scene);
    if args.json {
        return output::json(&report);
    }
    println!("{}", report.name);
    println!("  triangles   {} in {} instances", report.triangles, report.instances);
    match (report.bounds.min, report.bounds.max) {
        (Some(min), Some(max)) => println!("  bounds      {} to {} m", point(min), point(max)),
        _ => println!("  bounds      empty"),
    }
    if let (Some(min), Some(max)) = (report.extent.min, report.extent.max) {
        println!("  extent      {} to {} m, what viewers look at", point(min), point(max));
    }
    println!("  materials   {}, textures {}", report.materials, report.textures);
    println!("  lights      {}, animations {}", report.lights, report.animations);
    let names = report.effects.iter().map(name_of).collect::<Vec<_>>();
    println!("  effects     {}", if names.is_empty() { "none".to_owned() } else { names.join(", ") });
    println!("  rig         {}", name_of(&report.rig));
    println!("  hash        {}", report.hash);
    println!("  cameras     {}", report.cameras);
    for named in &scene.cameras {
        println!("    {:<20} {}", named.name, args::flags_of(&named.camera));
    }
    println!("  default     {}", args::flags_of(&report.default_camera));
    for warning in report.warnings {
        println!("  warning     {warning}");
    }
    Ok(())
}

#[derive(Serialize)]
struct PlanReport<'a> {
    name: &'a str,
    hash: String,
    light: &'a str,
    light_effects: String,
    indirect: String,
    exposure: f32,
    rows: &'a [EffectRow],
}

/// Prints the effect plan.
fn plan(args: &Args) -> anyhow::Result<()> {
    let mut request = EffectRequest { effects: args.effects, ..EffectRequest::default() };
    let opened = OpenScene::open(&args.environment.of(&args.scene), args.light, request.metering())?;
    let (scene, light) = (opened.scene(), opened.light());
    let metered = opened.metered(request.metering());
    let exposure = Exposure::Auto.factor(scene.lighting.exposure, metered);
    request.exposure = Some(exposure);
    let costs = if args.costs { costs(args)? } else { Vec::new() };
    let plan = EffectPlan::of(scene, &request, None).with_costs(&costs);
    let (hash, light_effects) = (scene.hash.to_string(), plan.light_effects().to_string());
    let indirect = plan.indirect(scene, &request).to_string();
    if args.json {
        let (name, rows) = (scene.name.as_str(), &plan.rows);
        return output::json(&PlanReport { name, hash, light, light_effects, indirect, exposure, rows });
    }
    println!("{}: effects {} give {light_effects}; indirect light {indirect}", scene.name, args.effects);
    println!("light {light}");
    println!("exposure {exposure:.4}, by the light at visible surfaces");
    effect_table::print(&plan);
    Ok(())
}

/// What effects cost in a view that this process renders, in all the light that a service would give it. The first view is not
/// counted: it compiles programs, and makes what all views share.
fn costs(args: &Args) -> anyhow::Result<Vec<EffectCost>> {
    let EffectRequest { indirect, reflections, .. } = EffectRequest::default();
    let config =
        Config { effects: args.effects, light: args.light, indirect, reflections, ..Config::default() };
    let mut alone = Alone::open(&args.environment.of(&args.scene), &config)?;
    let (camera, [width, height]) = (alone.scene().default_camera(), MEASURED_SIZE);
    let (outputs, plan) = (Outputs::COLOR, PlanRequest { direct: true, ..PlanRequest::default() });
    let view = View { camera, width, height, outputs, plan, pin: None, flow_to: None, rays: None };
    alone.render(&view, alone.full_light(), 0.0)?;
    let frame = alone.render(&view, alone.full_light(), 0.0)?;
    Ok(EffectCost::predicted(&frame.stages, u64::from(width * height)))
}

/// A point in the format of `--eye`.
fn point(p: [f64; 3]) -> String {
    format!("{:.4},{:.4},{:.4}", p[0], p[1], p[2])
}

/// The name of a value in JSON.
fn name_of(value: &impl Serialize) -> String {
    serde_json::to_value(value).ok().and_then(|v| v.as_str().map(str::to_owned)).unwrap_or_default()
}
