//! `argus demo`: a local cluster and a crowd of viewers, which asks for more than triangles carry.

mod crowd;
mod judge;
mod kind;
mod phase;
mod pictures;
mod rate;
mod references;
mod table;
mod timeline;

use std::path::PathBuf;
use std::time::Duration;

use anyhow::Context;
use argus_client::Client;
use argus_client::load::{Mode, WalkKind, walk};
use argus_local::{LocalCluster, connect, settle};
use argus_scene::PlanRequest;

use crate::demo::crowd::{Crowd, Load};
use crate::demo::judge::{Judged, Row};
use crate::demo::phase::{Outcome, Phase, samples_rendered};
use crate::demo::rate::{Asked, Rate};
use crate::demo::references::References;
use crate::demo::table::Figures;
use crate::{args, output, processes};

/// Starts a cluster of processes on this machine and sends it a crowd of viewers. They walk through the scene and ask for views over
/// gRPC.
///
/// First it is measured how many views a second the workers carry from triangles. The crowd asks for three times, then for ten times
/// as many. Views of all seconds are judged against references from triangles of sixteen samples a pixel. At last the first load
/// comes again with all views from triangles, for a third of the time. Tables show each phase by the second. The folder gets a plot
/// of latency and error over time, and a contact sheet: a source, the view made of it, the reference, the error.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  argus demo
  argus demo --quick
  argus demo --walk roam --times 6
  argus demo --scene model.glb --views 8 --size 320x240 --out pictures
  argus demo --scene mirrors --reflections maps
  argus demo --rate 40,600 --references out/references    twice: the second run finds its references")]
pub(crate) struct Args {
    /// A file (.glb, .gltf, .obj, .ply), `terrain[:TRIANGLES]`, `mirrors[:BALLS]` or `rooms[:WALL_MM]`, and `+balls:N`
    /// after it for mirroring balls
    #[arg(long, value_name = "S", default_value = "terrain")]
    scene: String,
    #[command(flatten)]
    environment: args::Environment,
    /// Number of viewers [default: 16; with --quick 4]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=256))]
    views: Option<u16>,
    /// Size of a view in pixels [default: 200x150; with --quick 96x72]
    #[arg(long, value_name = "WxH", value_parser = args::size)]
    size: Option<[u32; 2]>,
    /// Seconds of each phase, in which the crowd asks for views [default: 20; with --quick 2]
    #[arg(long, value_name = "T", value_parser = args::positive)]
    seconds: Option<f64>,
    /// How many times the views a second that are carried from triangles the crowd asks for: one phase for each number, without a
    /// pause [default: 3,10; with --quick 3]
    #[arg(long, value_name = "N[,N]", value_delimiter = ',', value_parser = args::positive, conflicts_with = "rate")]
    times: Vec<f64>,
    /// Views a second that all viewers together ask for, instead of --times
    #[arg(long, value_name = "R[,R]", value_delimiter = ',', value_parser = args::positive)]
    rate: Vec<f64>,
    /// How the viewers move: loop (each about a viewpoint), roam (groups walk through the scene and do not come back the same way),
    /// jumps (each stands for three seconds, then elsewhere) or rest (each stands at a viewpoint)
    #[arg(long, value_name = "WALK", default_value_t = WalkKind::Loop, value_parser = args::walk())]
    walk: WalkKind,
    /// Use one session a viewer: a newer view supersedes an older one, so that a slow viewer gets fewer frames
    #[arg(long)]
    sessions: bool,
    /// Number of judged views of each phase; each needs a reference of sixteen samples a pixel [default: 128; with --quick 8]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=10_000))]
    judged: Option<u32>,
    /// Folder that keeps references; a second run with the same views finds them. Only --rate repeats the same views
    #[arg(long, value_name = "DIR")]
    references: Option<PathBuf>,
    /// Leave out the crowd whose views are all from triangles
    #[arg(long)]
    no_direct: bool,
    /// Run a small crowd for a moment, to see that everything works; the figures are noise
    #[arg(long)]
    quick: bool,
    /// Number of worker processes [default: one a core, at least 2 and at most 4]
    #[arg(long, value_name = "P", value_parser = clap::value_parser!(u16).range(1..=256))]
    workers: Option<u16>,
    /// Program that serves, to compare builds of Argus by the same crowd [default: this program]
    #[arg(long, value_name = "FILE")]
    service: Option<PathBuf>,
    /// Folder for the images
    #[arg(long, value_name = "DIR", default_value = "out/demo")]
    out: PathBuf,
    /// Print the figures as one JSON object
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    samples: args::PassedOn<args::Samples>,
}

/// What the crowd is like, unless it is said.
struct Defaults {
    viewers: u16,
    size: [u32; 2],
    seconds: f64,
    times: &'static [f64],
    judged: u32,
}

const FULL: Defaults =
    Defaults { viewers: 16, size: [200, 150], seconds: 20.0, times: &[3.0, 10.0], judged: 128 };
/// With `--quick`.
const QUICK: Defaults = Defaults { viewers: 4, size: [96, 72], seconds: 2.0, times: &[3.0], judged: 8 };
/// Seconds of views from triangles, as a share of a phase.
const DIRECT_SHARE: f64 = 1.0 / 3.0;
/// Seconds in which it is measured how many of these are carried, as a share of a phase, and at most.
const BURST_SHARE: f64 = 0.25;
const LONGEST_BURST: Duration = Duration::from_secs(4);
/// Longest wait for samples that are still in work after the crowd.
const SETTLING: Duration = Duration::from_secs(15);
/// Rows of all phases together on the contact sheet, which has two columns at least.
const ROWS: usize = 16;

pub(crate) async fn run(args: Args) -> anyhow::Result<()> {
    let defaults = if args.quick { QUICK } else { FULL };
    let viewers = args.views.unwrap_or(defaults.viewers);
    let size = args.size.unwrap_or(defaults.size);
    let seconds = args.seconds.unwrap_or(defaults.seconds);
    let workers = args.workers.map_or_else(processes::default_count, usize::from);
    let asked = asked(&args.times, &args.rate, defaults.times);
    let progress = output::progress();

    progress.set_message(format!("starting a coordinator and {workers} workers"));
    let program = match args.service {
        Some(program) => program,
        None => std::env::current_exe().context("cannot find this program's own file")?,
    };
    let scene = args.environment.of(&args.scene);
    let (served, more) = (scene.clone(), args.samples.arguments);
    let starting = move || LocalCluster::start(&program, &served, workers, &more);
    let cluster = tokio::task::spawn_blocking(starting).await??;
    let client = connect(&cluster, workers).await?;
    progress.set_message("looking where there is room to walk");
    let lasts = Duration::try_from_secs_f64(seconds * asked.len() as f64)?;
    let cameras = walk(&client, args.walk, lasts).await?;
    progress.set_message("measuring how many views from triangles are carried");
    let burst = Duration::try_from_secs_f64(seconds * BURST_SHARE)?.min(LONGEST_BURST);
    let carried = Rate::measure(&client, workers, size, burst).await?;

    let mode = if args.sessions { Mode::Sessions } else { Mode::Requests };
    let judged = args.judged.unwrap_or(defaults.judged) as usize;
    let load = Load {
        viewers,
        size,
        per_sec: 0.0,
        seconds,
        cameras,
        walked_secs: 0.0,
        plan: PlanRequest::default(),
        mode,
        judged,
    };
    let mut crowds: Vec<(Rate, Crowd, u64)> = Vec::new();
    for (i, asked) in asked.into_iter().enumerate() {
        let rate = Rate::of(asked, carried);
        progress
            .set_message(format!("a crowd of {viewers} viewers, {:.0} views a second", rate.asked_per_sec));
        let walked_secs = i as f64 * seconds;
        let before = samples_rendered(&client.status().await?);
        let crowd = crowd::run(
            &client,
            &Load { per_sec: rate.asked_per_sec, walked_secs, ..load.clone() },
            &progress,
        )
        .await?;
        let samples = samples_rendered(&client.status().await?).saturating_sub(before);
        crowds.push((rate, crowd, samples));
    }
    progress.set_message("waiting until samples in work are done");
    settle(&client, workers, SETTLING).await?;
    let first = crowds.first().map(|(rate, ..)| rate.asked_per_sec).context("there is no phase")?;
    let direct = match args.no_direct {
        true => None,
        false => {
            progress.set_message("the first load from triangles");
            let plan = PlanRequest { direct: true, ..load.plan };
            let load = Load { per_sec: first, seconds: seconds * DIRECT_SHARE, plan, judged: 0, ..load };
            let crowd = crowd::run(&client, &load, &progress).await?;
            settle(&client, workers, SETTLING).await?;
            Some((crowd, load.seconds))
        }
    };
    progress.set_message("comparing with references of sixteen samples a pixel");
    let references = References::new(args.references);
    let (mut phases, mut sheet) = (Vec::new(), Vec::new());
    let rows = ROWS / crowds.len().clamp(1, ROWS);
    for (rate, mut crowd, samples) in crowds {
        let judged = judge::all(&client, &references, std::mem::take(&mut crowd.judged)).await?;
        judged.iter().for_each(|view| crowd.timeline.second(view.due_secs).judge(view.excess()));
        sheet.push(rows_of(&client, &references, &judged, rows, rate).await?);
        phases.push(Phase::of(crowd, seconds, rate, &judged, samples));
    }
    let status = client.status().await?;
    tokio::task::spawn_blocking(move || cluster.stop()).await??;
    progress.finish_and_clear();

    let named = scene.rsplit(['/', std::path::MAIN_SEPARATOR]).next().unwrap_or(&scene);
    let title = format!(
        "{named}: {viewers} viewers of {}x{}, walk {}, {workers} workers",
        size[0], size[1], args.walk
    );
    pictures::write_images(&args.out, &title, &sheet)?;
    let default = phases.remove(0);
    let figures = Figures {
        scene,
        walk: args.walk,
        workers,
        viewers,
        size,
        rate: default.rate,
        direct: direct.map(|(crowd, seconds)| Outcome::of(crowd, seconds, default.flip_direct)),
        default,
        more: phases,
        samples: samples_rendered(&status),
        sample_ms: status.sample_ms,
        view_ms: status.view_ms,
        sheet: args.out.join("contact-sheet.png").display().to_string(),
    };
    pictures::write_curves(&args.out, &title, figures.phases(), figures.direct.as_ref())?;
    if args.json {
        return output::json(&figures);
    }
    print!("{figures}");
    println!("\nThe images, the contact sheet and latency.svg are in {}\n", args.out.display());
    figures.phases().for_each(|phase| println!("{}", phase.closing_line()));
    Ok(())
}

/// What the phases ask for: rates, multiples, or the usual multiples.
fn asked(times: &[f64], rates: &[f64], usual: &[f64]) -> Vec<Asked> {
    let times = if times.is_empty() { usual } else { times };
    match rates {
        [] => times.iter().copied().map(Asked::Times).collect(),
        rates => rates.iter().copied().map(Asked::PerSec).collect(),
    }
}

/// A phase's column of the contact sheet.
async fn rows_of(
    client: &Client,
    references: &References,
    judged: &[Judged],
    count: usize,
    rate: Rate,
) -> anyhow::Result<(String, Vec<Row>)> {
    let heading = format!("{:.1} times what triangles carry", rate.times());
    Ok((heading, judge::rows(client, references, judged, count).await?))
}
