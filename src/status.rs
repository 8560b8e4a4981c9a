//! `argus status`: the workers, their roles, and what their work costs.

use std::fmt::Write;
use std::time::{Duration, Instant};

use anyhow::Context;
use argus_client::{Client, ClientError, ClusterStatus};
use console::Term;

use crate::settings::Sources;
use crate::{args, effect_table, output};

/// Shows the workers, their roles, and the balance between them.
///
/// Of a service with several scenes, it shows all of them with their workers, and then the one that --scene-name names.
///
/// Per tick, S samples and V views are requested. A sample costs g, a view from samples costs c. Of P processes, K render
/// samples: the whole number that makes a tick shortest. All of these are measured.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  argus status --json
  argus status --effects          what effects of light cost
  argus status --watch            a live table, until Ctrl-C
  argus status --watch 0.2")]
pub(crate) struct Args {
    #[command(flatten)]
    server: args::Server,
    /// Print one JSON object: processes, samplers, compositors, samples_per_tick, sample_ms, views_per_tick,
    /// view_ms, tick_predicted_ms, tick_measured_ms, workers: [{id, pid, role, address, …}], counters, …
    #[arg(long)]
    json: bool,
    /// Show the effect plan instead, with what each effect of light costs as the workers measured it. With --json: rows of effect,
    /// causes, paid, predicted_ms, bound, on, why, measured_ms, saved_ms
    #[arg(long, conflicts_with = "watch")]
    effects: bool,
    /// Refresh the table every SECONDS, and show the views answered per second
    #[arg(long, value_name = "SECONDS", num_args = 0..=1, default_missing_value = "1", value_parser = args::positive, conflicts_with = "json")]
    watch: Option<f64>,
}

pub(crate) async fn run(args: Args, sources: &Sources) -> anyhow::Result<()> {
    let client = args.server.connect(sources, 1).await?;
    if let Some(secs) = args.watch {
        let every = Duration::try_from_secs_f64(secs).context("--watch")?;
        return watch(&client, every).await;
    }
    if args.effects {
        let plan = client.describe().await?.effect_plan;
        if args.json {
            return output::json(&plan);
        }
        effect_table::print(&plan);
        return Ok(());
    }
    let status = client.status().await?;
    if args.json {
        return output::json(&status);
    }
    print!("{}", table(&status)?);
    Ok(())
}

/// Prints the table repeatedly; on a terminal, each one replaces the one before.
async fn watch(client: &Client, every: Duration) -> anyhow::Result<()> {
    let term = Term::stdout();
    let mut lines = 0;
    let mut before: Option<(Instant, u64)> = None;
    let mut interval = tokio::time::interval(every);
    interval.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
    loop {
        tokio::select! {
            _ = interval.tick() => {}
            stopped = tokio::signal::ctrl_c() => return stopped.context("cannot wait for Ctrl-C"),
        }
        let text = match client.status().await {
            Ok(status) => {
                let (now, answered) = (Instant::now(), status.counts().views_answered);
                let mut text = table(&status)?;
                if let Some((then, count)) = before.replace((now, answered)) {
                    // A restarted coordinator counts from zero.
                    let rate = answered.saturating_sub(count) as f64 / (now - then).as_secs_f64();
                    let sessions = status.counts().sessions_open;
                    writeln!(text, "  {rate:.1} views a second, {sessions} sessions")?;
                }
                text
            }
            // Keep watching: the server may come back.
            Err(error @ ClientError::Server { broken: true, .. }) => format!("{error}\n"),
            Err(error) => return Err(error.into()),
        };
        if term.is_term() {
            term.clear_last_lines(lines)?;
            // A line wider than the terminal would take several lines, which would not be cleared.
            let width = usize::from(term.size().1).max(20);
            let narrow = text.lines().map(|line| console::truncate_str(line, width, "…").into_owned());
            let narrow: Vec<String> =
                narrow.take(usize::from(term.size().0).saturating_sub(1).max(4)).collect();
            lines = narrow.len();
            term.write_str(&(narrow.join("\n") + "\n"))?;
        } else {
            term.write_str(&text)?;
        }
        term.flush()?;
    }
}

/// Writes the scenes of a service with their workers.
fn scenes(text: &mut String, status: &ClusterStatus) -> anyhow::Result<()> {
    writeln!(
        text,
        "  {:<20} {:>7} {:>6} {:>8} {:>6}  file, workers",
        "scene", "workers", "asked", "sessions", "views"
    )?;
    for scene in &status.scenes {
        writeln!(
            text,
            "  {:<20} {:>7} {:>6.1} {:>8} {:>6}  {}, {}",
            scene.name,
            scene.workers.len(),
            scene.asked,
            scene.sessions_open,
            scene.views_in_flight,
            scene.scene_name(),
            if scene.workers.is_empty() { "none".to_owned() } else { scene.workers.join(" ") }
        )?;
    }
    writeln!(text)?;
    Ok(())
}

fn table(status: &ClusterStatus) -> anyhow::Result<String> {
    let mut text = String::new();
    if status.scenes.len() > 1 {
        scenes(&mut text, status)?;
    }

    let seen = Some(status.visibility_name()).filter(|name| !name.is_empty()).unwrap_or("to be measured");
    writeln!(
        text,
        "{}, version {}, epoch {}, {} light; triangles by {seen}",
        status.scene_name(),
        status.version,
        status.epoch,
        status.light_name()
    )?;
    writeln!(
        text,
        "  P {} processes = K {} samplers + {} compositors",
        status.processes, status.samplers, status.compositors
    )?;
    writeln!(
        text,
        "  samples      S {:8.1} a tick,  g {:8.2} ms each",
        status.samples_per_tick, status.sample_ms
    )?;
    writeln!(
        text,
        "  views        V {:8.1} a tick,  c {:8.2} ms each",
        status.views_per_tick, status.view_ms
    )?;
    writeln!(
        text,
        "  direct views D {:8.1} a tick,    {:8.2} ms each",
        status.direct_views_per_tick, status.direct_ms
    )?;
    writeln!(
        text,
        "  single rays  R {:8.1} a tick,    {:8.2} µs each",
        status.rays_per_tick,
        status.ray_ms * 1e3
    )?;
    let market = status.priced();
    writeln!(
        text,
        "  price of time  {:8.3} FLIP a second: {:.3} for waiting, {:.3} for what sources would bring (best {:.3})",
        market.price, market.price_of_queue, market.worth, market.best_worth
    )?;
    writeln!(
        text,
        "  views          {:8.2} processes if all were from triangles, {:.2} as they are: {:.1} times as many; wait {:.0} ms",
        market.asked, market.carried, market.speed_up, market.wait_ms
    )?;
    writeln!(
        text,
        "  sources        {} held, {} of them bought; S {:.1} a tick, {} of at most K = {} in work, {} places gain; {} bought so far",
        market.sources,
        market.sources_bought,
        market.purchases_per_tick,
        market.purchases_coming,
        market.most_purchases,
        market.accounts,
        market.purchases
    )?;
    let refinements = status.refined();
    writeln!(
        text,
        "  refinements    {} of {} samples at hand where views have holes, {} more wanted",
        refinements.usable, refinements.placed, refinements.wanted
    )?;
    writeln!(
        text,
        "  tick           {:8.1} ms predicted, {:.1} ms measured",
        status.tick_predicted_ms, status.tick_measured_ms
    )?;
    let planning_us = status.planning_us / status.views_planned.max(1) as f64;
    writeln!(
        text,
        "  planning       {planning_us:8.1} µs a view; {} errors measured by probes",
        market.probes
    )?;
    let counters = status.counts();
    writeln!(
        text,
        "  views          {} answered, {} failed, {} rejected, {} retried; {} roles changed, {} workers lost",
        counters.views_answered,
        counters.views_failed,
        counters.views_rejected,
        counters.views_retried,
        counters.roles_changed,
        counters.workers_lost
    )?;
    writeln!(
        text,
        "  {:<14} {:>8} {:<11} {:<28} {:>7} {:>7} {:>9}  device",
        "worker", "pid", "role", "address", "queued", "held", "rendering"
    )?;
    for worker in &status.workers {
        let rendering = worker.sample_progress.map(|share| format!("{:.0} %", 100.0 * share));
        writeln!(
            text,
            "  {:<14} {:>8} {:<11} {:<28} {:>7} {:>7} {:>9}  {}",
            worker.id,
            worker.pid,
            worker.role_name(),
            worker.address,
            worker.queued_samples + worker.queued_views,
            worker.samples_held,
            rendering.unwrap_or_default(),
            worker.device
        )?;
    }
    for worker in &status.workers {
        let Some(cells) = &worker.light_cells else { continue };
        writeln!(
            text,
            "  light cells    {}: {} pages ({} from others), {} MiB, lit {:.0} % of pixels, {} corners wait, {:.1} s of filling",
            worker.id,
            cells.pages,
            cells.pages_taken,
            cells.bytes >> 20,
            100.0 * cells.lit_share(),
            cells.waiting,
            cells.fill_ms * 1e-3
        )?;
        if cells.pages_kept + cells.pages_touched > 0 {
            writeln!(
                text,
                "                 as things moved: {} pages kept, {} touched, {} show an earlier pose",
                cells.pages_kept, cells.pages_touched, cells.pages_older
            )?;
        }
        if cells.faces_kept + cells.faces_changed > 0 {
            writeln!(
                text,
                "                 of samples: {} faces kept, {} rendered again",
                cells.faces_kept, cells.faces_changed
            )?;
        }
    }
    Ok(text)
}
