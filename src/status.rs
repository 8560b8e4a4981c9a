//! `argus status`: who does what, and what it costs.

use argus_client::{Client, ClusterStatus};

use crate::{args, output};

/// Workers, their roles, and the balance between them.
///
/// S samples and V views are asked for per tick; a sample costs g, a view from samples c. Of P processes, K
/// sample: the whole number that makes a tick shortest. All of it is measured.
#[derive(clap::Args)]
#[command(after_help = "Example:\n  argus status --json")]
pub(crate) struct Args {
    #[command(flatten)]
    server: args::Server,
    /// Print one JSON object: processes, samplers, compositors, samples_per_tick, sample_ms, views_per_tick,
    /// view_ms, tick_predicted_ms, tick_measured_ms, workers: [{id, pid, role, address, …}], counters, …
    #[arg(long)]
    json: bool,
}

pub(crate) async fn run(args: Args) -> anyhow::Result<()> {
    let status = Client::connect(&args.server.server).await?.status().await?;
    if args.json {
        return output::json(&status);
    }
    print(&status);
    Ok(())
}

fn print(status: &ClusterStatus) {
    let seen = if status.visibility.is_empty() { "to be measured" } else { &status.visibility };
    println!(
        "{}, generation {}, epoch {}; triangles by {seen}",
        status.scene, status.generation, status.epoch
    );
    println!(
        "  P {} processes = K {} samplers + {} compositors",
        status.processes, status.samplers, status.compositors
    );
    println!("  samples      S {:8.1} a tick,  g {:8.2} ms each", status.samples_per_tick, status.sample_ms);
    println!("  views        V {:8.1} a tick,  c {:8.2} ms each", status.views_per_tick, status.view_ms);
    println!(
        "  direct views D {:8.1} a tick,    {:8.2} ms each",
        status.direct_views_per_tick, status.direct_ms
    );
    println!("  single rays  R {:8.1} a tick,    {:8.2} µs each", status.rays_per_tick, status.ray_ms * 1e3);
    let refinements = status.refinements;
    println!(
        "  refinements    {} of {} samples at hand where views have holes, {} more wanted",
        refinements.usable, refinements.placed, refinements.wanted
    );
    println!(
        "  tick           {:8.1} ms predicted, {:.1} ms measured",
        status.tick_predicted_ms, status.tick_measured_ms
    );
    let counters = &status.counters;
    println!(
        "  views          {} answered, {} failed, {} rejected, {} retried; {} roles changed, {} workers lost",
        counters.views_answered,
        counters.views_failed,
        counters.views_rejected,
        counters.views_retried,
        counters.roles_changed,
        counters.workers_lost
    );
    println!(
        "  {:<14} {:>8} {:<11} {:<28} {:>7} {:>7}  device",
        "worker", "pid", "role", "address", "queued", "held"
    );
    for worker in &status.workers {
        println!(
            "  {:<14} {:>8} {:<11} {:<28} {:>7} {:>7}  {}",
            worker.id,
            worker.pid,
            worker.role,
            worker.address,
            worker.queued_samples + worker.queued_views,
            worker.samples_held,
            worker.device
        );
    }
}
