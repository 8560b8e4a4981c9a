//! `argus reference`: a view by the reference ray tracer.

use std::path::PathBuf;
use std::sync::Arc;

use argus_cluster::SceneSource;
use argus_scene::mitsuba::matt;
use argus_scene::reference::{DirectLight, Indirect, ReferenceImage, SurfaceImage, Tracer};
use argus_scene::{Camera, Effects, Exposure, LightRequest, Metering, Scene};
use glam::DVec2;
use serde::Serialize;

use crate::wiring::OpenScene;
use crate::{args, output};

/// Renders a view on this machine by the CPU ray tracer that every image is judged against.
///
/// Writes an OpenEXR file with 32-bit floats. R, G, B: linear radiance, before exposure. range: distance from the eye on the ray
/// through the pixel's centre, metres, +inf for the sky. Z: the same along the camera's axis. albedo.R, albedo.G, albedo.B and normal.X, normal.Y, normal.Z: the
/// surface on that ray, 0 for the sky.
#[derive(clap::Args)]
#[command(
    allow_negative_numbers = true,
    after_help = "\
Examples:
  argus reference rooms --out rooms.exr
  argus reference model.glb --eye 3,2,5 --target 0,1,0 --size 640x480 --paths 16 --out model.exr"
)]
pub(crate) struct Args {
    /// A file (.glb, .gltf, .obj, .ply), `terrain[:TRIANGLES]`, `mirrors[:BALLS]` or `rooms[:WALL_MM]`, and `+balls:N`
    /// after it for mirroring balls
    #[arg(value_name = "S")]
    scene: String,
    #[command(flatten)]
    environment: args::Environment,
    #[command(flatten)]
    picture: args::Picture,
    /// Rays per pixel, rounded up to a square number; the time grows in proportion
    #[arg(long, value_name = "N", default_value = "16", value_parser = clap::value_parser!(u32).range(1..=4096))]
    samples_per_pixel: u32,
    /// Effects of direct light: all, none (light passes through surfaces), or some of shadows, soft-shadows, sky-visibility,
    /// emitters, with commas between
    #[arg(long, value_name = "LIST", default_value = "all", value_parser = args::effects)]
    effects: Effects,
    /// Rays to each light at each of a pixel's samples, and ten times as many to the sky and to emitters
    #[arg(long, value_name = "N", default_value = "1", value_parser = clap::value_parser!(u32).range(1..=4096))]
    light_rays: u32,
    /// Paths of indirect light per ray; the noise falls with the root of their number. 0: no indirect light
    #[arg(long, value_name = "N", default_value = "0", value_parser = clap::value_parser!(u32).range(0..=65536))]
    paths: u32,
    /// Greatest number of reflections between a light and a visible surface, for --paths
    #[arg(long, value_name = "N", default_value = "8", value_parser = clap::value_parser!(u32).range(0..=64))]
    bounces: u32,
    /// Light of the scene, as of `argus serve`: auto, file, sky or interior. Its own light may be made stronger or weaker by
    /// whole stops; `argus scene S --plan` shows it
    #[arg(long, value_name = "LIGHT", default_value = "auto", value_parser = args::light)]
    light: LightRequest,
    /// Time of an animated scene, seconds
    #[arg(long, value_name = "SECONDS", default_value = "0", value_parser = args::zero_or_more)]
    time: f64,
    /// Leave out gloss, metal and transmission
    #[arg(long)]
    matt: bool,
    /// OpenEXR file to write
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Print one JSON object: width, height, mean_radiance [r, g, b], seconds
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct Report {
    width: u32,
    height: u32,
    mean_radiance: [f64; 3],
    seconds: f64,
}

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    let metering = Metering { effects: args.effects.most(), indirect: args.paths > 0 };
    let opened = OpenScene::open(&args.environment.of(&args.scene), args.light, metering)?;
    let exposure = Exposure::Auto.factor(opened.scene().lighting.exposure, opened.metered(metering));
    let mut scene = Scene::clone(opened.scene());
    drop(opened);
    // Unlit surfaces have their colour at an exposure.
    scene.lighting.exposure = exposure;
    let scene = if args.matt { matt(scene) } else { scene };
    let camera = args.picture.camera(&scene)?;
    let [width, height] = args.picture.size;
    // Whatever the scene has no cause for adds nothing.
    let light = DirectLight { effects: args.effects.most(), rays: args.light_rays };
    let tracer = Tracer::new(Arc::new(scene)).at(args.time).with_direct_light(light);
    let indirect = (args.paths > 0).then_some(Indirect { paths: args.paths, bounces: args.bounces });
    let start = std::time::Instant::now();
    let image = tracer.render_with(&camera, [width, height], args.samples_per_pixel, indirect, |_| ());
    let seconds = start.elapsed().as_secs_f64();
    let surfaces = tracer.surfaces(&camera, width, height);
    output::write_channels_exr(&args.out, width, height, channels(&image, &surfaces, &camera))?;
    let pixels = image.radiance.len().max(1) as f64;
    let mean = image.radiance.iter().map(|radiance| radiance.as_dvec3()).sum::<glam::DVec3>() / pixels;
    let report = Report { width, height, mean_radiance: mean.to_array(), seconds };
    if args.json {
        return output::json(&report);
    }
    println!("{}: {width}x{height}, {seconds:.1} s", args.out.display());
    println!("  mean radiance  {:.5} {:.5} {:.5}", mean.x, mean.y, mean.z);
    Ok(())
}

/// The channels of the file.
fn channels(
    image: &ReferenceImage,
    surfaces: &SurfaceImage,
    camera: &Camera,
) -> Vec<(&'static str, Vec<f32>)> {
    let layers = [
        (["R", "G", "B"], &image.radiance),
        (["albedo.R", "albedo.G", "albedo.B"], &surfaces.albedo),
        (["normal.X", "normal.Y", "normal.Z"], &surfaces.normal),
    ];
    let mut channels = vec![("range", image.range.clone()), ("Z", depth(image, camera))];
    for (names, values) in layers {
        for (axis, name) in names.into_iter().enumerate() {
            channels.push((name, values.iter().map(|value| value[axis]).collect()));
        }
    }
    channels
}

/// Distances along the camera's axis, metres.
fn depth(image: &ReferenceImage, camera: &Camera) -> Vec<f32> {
    let ([width, height], axis) = ([image.width, image.height], (camera.target - camera.eye).normalize());
    let centre = |i: u32| DVec2::new((i % width).into(), (i / width).into()) + 0.5;
    let along = |i: u32| camera.direction(centre(i), width, height).dot(axis);
    (0..).zip(&image.range).map(|(i, range)| (f64::from(*range) * along(i)) as f32).collect()
}
