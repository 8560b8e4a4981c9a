//! `argus demo`: a local cluster, its clients, and the errors of their views.

mod judge;
mod table;

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::Context;
use argus_client::load::path_views;
use argus_client::{Answer, Client, ClusterStatus};
use argus_scene::{PlanRequest, View};
use argus_studies::LocalCluster;
use argus_studies::burst::{connect, patient};
use futures::future::try_join_all;
use indicatif::{ProgressBar, ProgressStyle};

use crate::demo::judge::Judged;
use crate::demo::table::Figures;
use crate::{args, output, processes, sheet};

/// Starts a cluster of processes on this machine, lets clients request views over gRPC, compares each view with the one
/// rendered from the triangles, and writes images, a contact sheet and a table of costs.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  argus demo
  argus demo --scene model.glb --views 8 --size 320x240 --out pictures
  argus demo --scene mirrors --reflections maps")]
pub(crate) struct Args {
    /// A file (.glb, .gltf, .obj, .ply), `terrain[:TRIANGLES]`, `mirrors[:BALLS]` or `rooms[:WALL_MM]`, and `+balls:N`
    /// after it for mirroring balls
    #[arg(long, value_name = "S", default_value = "terrain")]
    scene: String,
    #[command(flatten)]
    environment: args::Environment,
    /// Number of clients, each with its own viewpoint
    #[arg(long, value_name = "N", default_value = "16", value_parser = clap::value_parser!(u16).range(1..=256))]
    views: u16,
    /// Size of a view in pixels
    #[arg(long, value_name = "WxH", default_value = "200x150", value_parser = args::size)]
    size: [u32; 2],
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

/// Samples a side of a reference's pixel.
const TRUTH_SIDE: u32 = 4;
/// Longer than the interval between workers' reports of their costs.
const REPORTS: Duration = Duration::from_millis(600);

/// The views of all clients with one plan.
struct Round {
    answers: Vec<Answer>,
    /// From the first request to the last frame.
    total: Duration,
    /// The cluster's status afterwards.
    status: ClusterStatus,
}

/// Rounds after the first, which waits for samples and for the driver to compile.
const STEADY_ROUNDS: usize = 4;

pub(crate) async fn run(args: Args) -> anyhow::Result<()> {
    let count = usize::from(args.views);
    let workers = args.workers.map_or_else(processes::default_count, usize::from);
    let progress = progress((3 + STEADY_ROUNDS as u64) * count as u64);

    progress.set_message(format!("starting a coordinator and {workers} workers"));
    let program = std::env::current_exe().context("cannot find this program's own file")?;
    let name = args.environment.of(&args.scene);
    let (scene, more) = (name.clone(), args.samples.arguments);
    let starting = move || LocalCluster::start(&program, &scene, workers, &more);
    let cluster = tokio::task::spawn_blocking(starting).await??;
    let first = connect(&cluster, workers).await?;
    let mut clients = vec![first];
    while clients.len() < count {
        clients.push(Client::connect(cluster.url()).await?);
    }

    let ask = async |message, plan| {
        progress.set_message(message);
        let views = path_views(clients[0].description(), u32::from(args.views), args.size, plan);
        ask_all(&clients, &views, &progress).await
    };
    let direct = PlanRequest { direct: true, ..PlanRequest::default() };
    let warped = ask("views from samples", PlanRequest::from_samples()).await?;
    let mut steady = Vec::new();
    for _ in 0..STEADY_ROUNDS {
        steady.push(ask("the same views, samples at hand", PlanRequest::from_samples()).await?);
    }
    let naive = ask("the same views from triangles", direct).await?;
    let truth = PlanRequest { supersampling: Some(TRUTH_SIDE), ..direct };
    let truth = ask("references of sixteen samples a pixel", truth).await?;
    tokio::task::spawn_blocking(move || cluster.stop()).await??;

    progress.set_message("comparing");
    let judged = judge::all(&warped.answers, &naive.answers, &truth.answers)?;
    progress.finish_and_clear();
    let figures = Figures::of(&name, workers, &warped, &steady, &naive, &judged);
    let title =
        format!("{}: {count} views of {}x{}, {workers} workers", figures.scene, args.size[0], args.size[1]);
    let sheet = write_pictures(&args.out, &title, &judged)?;
    if args.json {
        return output::json(&figures.with_sheet(&sheet));
    }
    print!("{figures}");
    println!("\nThe images and the contact sheet are in {}", sheet.display());
    Ok(())
}

/// All clients request their own view at the same time.
async fn ask_all(clients: &[Client], views: &[View], progress: &ProgressBar) -> anyhow::Result<Round> {
    let options = patient();
    let begin = Instant::now();
    let answers = clients.iter().zip(views).map(async |(client, view)| {
        let answer = client.render(view, &options).await;
        progress.inc(1);
        answer
    });
    let answers = try_join_all(answers).await?;
    let total = begin.elapsed();
    tokio::time::sleep(REPORTS).await;
    let status = clients.first().context("there are no clients")?.status().await?;
    Ok(Round { answers, total, status })
}

/// Writes all images and the contact sheet. Returns the sheet's path.
fn write_pictures(folder: &Path, title: &str, judged: &[Judged]) -> anyhow::Result<PathBuf> {
    let write = |name: String, image: &image::RgbImage| {
        output::write_rgb_png(&folder.join(name), image.width(), image.height(), image)
    };
    for (i, view) in judged.iter().enumerate() {
        write(format!("view-{i:02}.png"), &view.warped)?;
        write(format!("direct-{i:02}.png"), &view.truth)?;
        write(format!("flip-{i:02}.png"), &view.difference)?;
    }
    let entries: Vec<sheet::Entry<'_>> = judged.iter().enumerate().map(|(i, view)| view.entry(i)).collect();
    write("contact-sheet.png".to_owned(), &sheet::draw(title, &entries))?;
    Ok(folder.join("contact-sheet.png"))
}

/// A progress bar on standard error, if that is a terminal.
fn progress(steps: u64) -> ProgressBar {
    let bar = ProgressBar::new(steps);
    if let Ok(style) = ProgressStyle::with_template("{bar:30} {pos:>3}/{len} {msg} ({elapsed})") {
        bar.set_style(style);
    }
    bar.enable_steady_tick(Duration::from_millis(100));
    bar
}
