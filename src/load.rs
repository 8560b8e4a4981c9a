//! `argus load`: many clients at once, and the outcome of their views.

use std::collections::HashSet;
use std::time::Duration;

use argus_client::load::{
    self, Ended, IN_FLIGHT, LatencyMs, LoadOptions, LoadReport, Mode, WalkKind, burst, path_views,
};
use argus_client::{Client, RenderOptions};
use argus_scene::FrameDigest;
use serde::Serialize;

use crate::exit::bad_arguments;
use crate::settings::Sources;
use crate::{args, output};

/// Loads a service with many clients, and counts how many views are answered and how late.
///
/// The clients walk through the scene's free space, which range views show beforehand. Views are due at fixed times, and latency counts from
/// the due time, so that a stall of the service shows in full. With --views, a fixed number of views is requested as fast as they
/// are answered.
#[derive(clap::Args)]
#[command(
    allow_negative_numbers = true,
    after_help = "\
Examples:
  argus load --clients 16 --seconds 10
  argus load --clients 4 --seconds 10 --rate 30 --sessions --json
  argus load --clients 4 --seconds 10 --sessions --history     each search begins from the frame before
  argus load --views 290 --size 200x150            all at once: how long does it take?
  argus load --views 290 --size 200x150 --direct   … and without samples?"
)]
pub(crate) struct Args {
    #[command(flatten)]
    server: args::Server,
    /// Number of clients at the same time
    #[arg(long, value_name = "N", required_unless_present = "views", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    clients: Option<u32>,
    /// Seconds for which views are requested
    #[arg(long, value_name = "T", required_unless_present = "views", value_parser = args::positive)]
    seconds: Option<f64>,
    /// Size of a view in pixels
    #[arg(long, value_name = "WxH", default_value = "200x150", value_parser = args::size)]
    size: [u32; 2],
    /// Views a second of each client
    #[arg(long, value_name = "FPS", default_value = "10", value_parser = args::positive)]
    rate: f64,
    /// How the clients move: loop (each about a viewpoint), roam (groups walk through the scene and do not come back the same way),
    /// jumps (each stands for three seconds, then elsewhere) or rest (each stands at a viewpoint)
    #[arg(long, value_name = "WALK", default_value_t = WalkKind::Loop, value_parser = args::walk(), conflicts_with = "views")]
    walk: WalkKind,
    /// Use one session a client: a newer camera supersedes an older one, so that a slow client gets fewer frames
    #[arg(long)]
    sessions: bool,
    /// Start each depth search from the session's previous frame (temporal reprojection). Implies the seeded search. Such
    /// frames depend on history and cannot be reproduced from their provenance
    #[arg(long, requires = "sessions")]
    history: bool,
    /// Request this many views as fast as they are answered, instead of --clients and --rate
    #[arg(long, value_name = "N", conflicts_with_all = ["clients", "seconds", "rate", "sessions", "history"], value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    views: Option<u32>,
    /// Seconds after which a view without an answer counts as failed
    #[arg(long, value_name = "SECONDS", default_value = "30", value_parser = args::positive)]
    timeout: f64,
    /// Print one JSON object: sent, answered, failed, rejected, superseded, from_history,
    /// views_per_sec, latency_ms: {p50, p90, p99, max}, total_secs, distinct_frames, digest (of --views: of the frames' digests in
    /// the order of the views; equal for equal frames, null if a view failed)
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    plan: args::Plan,
}

#[derive(Serialize)]
struct Report {
    #[serde(flatten)]
    load: LoadReport,
    /// Seconds from the first view to the last answer of a burst, or the load's duration.
    total_secs: f64,
    /// Frames that differ from each other in their digests.
    distinct_frames: usize,
    /// The digest of a burst's frames: equal for equal frames in the same order. `None` of other loads, or if a view failed.
    digest: Option<FrameDigest>,
}

pub(crate) async fn run(args: Args, sources: &Sources) -> anyhow::Result<()> {
    let connections = args.clients.unwrap_or(4).clamp(1, 4) as usize;
    let client = args.server.connect(sources, connections).await?;
    let report = match args.views {
        Some(views) => all_at_once(&client, views, &args).await?,
        None => steady(&client, &args).await?,
    };
    if args.json {
        return output::json(&report);
    }
    let Report { load, total_secs, distinct_frames, digest } = report;
    println!(
        "{} views sent: {} answered, {} failed, {} rejected, {} superseded",
        load.sent, load.answered, load.failed, load.rejected, load.superseded
    );
    if args.history {
        println!("  {} answered views started from the session's previous frame", load.from_history);
    }
    print!("  {distinct_frames} distinct frames");
    println!("{}", digest.map(|all| format!(", digest {all}")).unwrap_or_default());
    println!("  {:.1} views/s in {total_secs:.2} s", load.views_per_sec);
    let LatencyMs { p50, p90, p99, max } = load.latency_ms;
    println!("  latency p50 {p50:.1} ms, p90 {p90:.1} ms, p99 {p99:.1} ms, max {max:.1} ms");
    if let Some(error) = &load.first_error {
        println!("  first error: {error}");
    }
    Ok(())
}

/// Runs an open load with a fixed schedule.
async fn steady(client: &Client, args: &Args) -> anyhow::Result<Report> {
    let (Some(clients), Some(seconds)) = (args.clients, args.seconds) else {
        return Err(bad_arguments("--clients and --seconds are required, or --views"));
    };
    let options = LoadOptions {
        clients,
        duration: duration(seconds),
        rate: args.rate,
        size: args.size,
        plan: args.plan.request(),
        mode: if args.sessions { Mode::Sessions } else { Mode::Requests },
        history: args.history,
        deadline: duration(args.timeout),
        ..LoadOptions::default()
    };
    let cameras = load::walk(client, args.walk, options.duration).await?;
    let mut distinct = HashSet::new();
    let seen = |ended: Ended| {
        if let Ok(frame) = &ended.outcome {
            distinct.insert(frame.images.digest());
        }
    };
    let load = load::run_along(client, &options, cameras, seen).await?;
    Ok(Report { load, total_secs: seconds, distinct_frames: distinct.len(), digest: None })
}

/// Requests all views as fast as they are answered.
async fn all_at_once(client: &Client, views: u32, args: &Args) -> anyhow::Result<Report> {
    let views = path_views(client.description(), views, args.size, args.plan.request());
    if let Some(view) = views.first() {
        view.validate(&client.description().limits)?;
    }
    let options = RenderOptions { deadline: duration(args.timeout), ..RenderOptions::default() };
    let mut digests = vec![None; views.len()];
    let outcome =
        burst(client, views, IN_FLIGHT, &options, |i, answer| digests[i] = Some(answer.meta.digest)).await;
    let load = LoadReport {
        sent: outcome.views,
        answered: outcome.views - outcome.failed,
        failed: outcome.failed,
        rejected: 0,
        superseded: 0,
        from_history: 0,
        views_per_sec: outcome.views_per_sec,
        latency_ms: outcome.latency_ms,
        first_error: outcome.first_error,
    };
    let distinct_frames = digests.iter().flatten().collect::<HashSet<_>>().len();
    let digest = digests.into_iter().collect::<Option<Vec<_>>>().map(|all| digest_of(&all));
    Ok(Report { load, total_secs: outcome.total_ms / 1e3, distinct_frames, digest })
}

/// The digest of digests, in their order.
fn digest_of(all: &[FrameDigest]) -> FrameDigest {
    let mut hasher = blake3::Hasher::new();
    for FrameDigest(digest) in all {
        hasher.update(digest);
    }
    FrameDigest(hasher.finalize().into())
}

/// A duration; one too long for a clock becomes about 136 years.
fn duration(seconds: f64) -> Duration {
    Duration::try_from_secs_f64(seconds).unwrap_or(Duration::from_secs(u64::from(u32::MAX)))
}
