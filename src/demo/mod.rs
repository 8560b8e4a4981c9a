//! `argus demo`: a local cluster and a crowd of viewers, by default and from triangles.

mod crowd;
mod judge;
mod kind;

mod pictures;
mod rate;
mod table;
mod timeline;

use std::path::PathBuf;
use std::time::Duration;

use anyhow::Context;
use argus_local::{LocalCluster, connect, settle};
use argus_scene::PlanRequest;

use crate::demo::crowd::{Load, Shown};
use crate::demo::rate::Rate;
use crate::demo::table::{Figures, Outcome};
use crate::{args, output, processes};

/// Starts a cluster of processes on this machine and sends it a crowd of viewers. Each viewer walks around its own viewpoint and
/// asks for views over gRPC.
///
/// The crowd asks for three times what the workers carry from triangles, which is measured first. The same load follows with all
/// views from triangles, for a third of the time. A table shows both. The folder gets a plot of latency over time, and a
/// contact sheet of each viewer's last view beside its reference from triangles, of sixteen samples a pixel.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  argus demo
  argus demo --quick
  argus demo --scene model.glb --views 8 --size 320x240 --out pictures
  argus demo --scene mirrors --reflections maps")]
pub(crate) struct Args {
    /// A file (.glb, .gltf, .obj, .ply), `terrain[:TRIANGLES]`, `mirrors[:BALLS]` or `rooms[:WALL_MM]`, and `+balls:N`
    /// after it for mirroring balls
    #[arg(long, value_name = "S", default_value = "terrain")]
    scene: String,
    #[command(flatten)]
    environment: args::Environment,
    /// Number of viewers, each with its own viewpoint [default: 16; with --quick 4]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=256))]
    views: Option<u16>,
    /// Size of a view in pixels [default: 200x150; with --quick 96x72]
    #[arg(long, value_name = "WxH", value_parser = args::size)]
    size: Option<[u32; 2]>,
    /// Seconds for which the crowd asks for views [default: 12; with --quick 2]
    #[arg(long, value_name = "T", value_parser = args::positive)]
    seconds: Option<f64>,
    /// Run a small crowd for a moment, to see that everything works; the figures are noise
    #[arg(long)]
    quick: bool,
    /// Number of worker processes [default: one a core, at least 2 and at most 4]
    #[arg(long, value_name = "P", value_parser = clap::value_parser!(u16).range(1..=256))]
    workers: Option<u16>,
    /// Folder for the images
    #[arg(long, value_name = "DIR", default_value = "out/demo")]
    out: PathBuf,
    /// Print the figures as one JSON object
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    samples: args::PassedOn<args::Samples>,
}

/// Viewers, size of a view in pixels, and seconds: by default, and with `--quick`.
const FULL: (u16, [u32; 2], f64) = (16, [200, 150], 12.0);
const QUICK: (u16, [u32; 2], f64) = (4, [96, 72], 2.0);
/// Seconds of views from triangles, as a share of the crowd's.
const DIRECT_SHARE: f64 = 1.0 / 3.0;
/// Seconds in which it is measured how many of these are carried, as a share of the crowd's.
const BURST_SHARE: f64 = 0.25;
/// Longest wait for samples that are still in work after the crowd.
const SETTLING: Duration = Duration::from_secs(15);

pub(crate) async fn run(args: Args) -> anyhow::Result<()> {
    let defaults = if args.quick { QUICK } else { FULL };
    let viewers = args.views.unwrap_or(defaults.0);
    let size = args.size.unwrap_or(defaults.1);
    let seconds = args.seconds.unwrap_or(defaults.2);
    let workers = args.workers.map_or_else(processes::default_count, usize::from);
    let progress = output::progress();

    progress.set_message(format!("starting a coordinator and {workers} workers"));
    let program = std::env::current_exe().context("cannot find this program's own file")?;
    let scene = args.environment.of(&args.scene);
    let (served, more) = (scene.clone(), args.samples.arguments);
    let starting = move || LocalCluster::start(&program, &served, workers, &more);
    let cluster = tokio::task::spawn_blocking(starting).await??;
    let client = connect(&cluster, workers).await?;
    progress.set_message("measuring how many views from triangles are carried");
    let burst = Duration::try_from_secs_f64(seconds * BURST_SHARE)?;
    let rate = Rate::measure(&client, workers, size, burst).await?;

    progress.set_message(format!("a crowd of {viewers} viewers"));
    let plan = PlanRequest::default();
    let load = Load { viewers, size, per_sec: rate.asked_per_sec, seconds, plan };
    let mut crowd = crowd::run(&client, load, &progress).await?;
    progress.set_message("waiting until samples in work are done");
    settle(&client, workers, SETTLING).await?;
    progress.set_message("the same load from triangles");
    let plan = PlanRequest { direct: true, ..plan };
    let load = Load { seconds: seconds * DIRECT_SHARE, plan, ..load };
    let direct = crowd::run(&client, load, &progress).await?;
    progress.set_message("comparing with references of sixteen samples a pixel");
    settle(&client, workers, SETTLING).await?;
    let last: Vec<Shown> = std::mem::take(&mut crowd.last).into_values().collect();
    let judged = judge::all(&client, last).await?;
    let status = client.status().await?;
    tokio::task::spawn_blocking(move || cluster.stop()).await??;
    progress.finish_and_clear();

    let title = format!("{scene}: {viewers} viewers of {}x{}, {workers} workers", size[0], size[1]);
    pictures::write_images(&args.out, &title, &judged)?;
    pictures::write_curve(&args.out, &title, &crowd, &direct)?;
    let figures = Figures {
        scene,
        workers,
        viewers,
        size,
        rate,
        default: Outcome::of(crowd, seconds, judged.iter().map(|view| view.flip)),
        direct: Outcome::of(direct, load.seconds, judged.iter().map(|view| view.flip_direct)),
        samples: status.workers.iter().map(|worker| worker.samples_rendered).sum(),
        sample_ms: status.sample_ms,
        view_ms: status.view_ms,
        sheet: args.out.join("contact-sheet.png").display().to_string(),
    };
    if args.json {
        return output::json(&figures);
    }
    print!("{figures}");
    println!("\nThe images, the contact sheet and latency.svg are in {}", args.out.display());
    Ok(())
}
