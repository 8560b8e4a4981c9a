//! Cluster: the cluster paper's measurements (section 5, figures 5 to 8, table 1).
//!
//! Real local clusters of separate processes talk over the loopback interface; larger clusters are simulated.
//!
//! - *Naive* is a fair baseline: all P workers render every view directly, with the cheapest visibility backend.
//! - *Proposed* renders S new samples each tick, as in the paper.
//! - *Helping* also lets samplers compose in their spare time.
//! - *Still* is *proposed* in a scene that does not move, so samples are rendered once.

mod measure;
mod method;
mod row;

use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::{Context as _, Result};
use argus_client::load::patient;
use argus_local::{LocalCluster, connect};
use argus_scene::metrics::compare;
use argus_scene::{Output, PlanRequest};
use image::RgbImage;
use indicatif::ProgressBar;

use self::measure::{Measured, Run, measure};
pub use self::method::Method;
use self::method::PLAIN;
use self::row::{Beside, Row};
use crate::arguments::{count, is_quick, or_quick, positive, seconds, size};
use crate::load::simulate::efficiency::{self, Case, SETTLED_SECS};
use crate::load::simulate::{Machines, Parameters, trouble};
use crate::{Machine, Report};

/// Measures or simulates the cluster paper's figures: the time of a tick against views and against processes
///
/// Real clusters are separate processes on this machine. Each tick renders the samples anew, as in the paper.
/// Variants let samplers also compose in their spare time, keep the scene still, or render all views directly. With
/// --simulate the real coordinator core drives any number of simulated workers.
#[derive(Debug, Clone, clap::Args)]
#[command(after_help = "\
Examples:
  argus-lab study load cluster --out figures
  argus-lab study load cluster --simulate --out figures
  argus-lab study load cluster --simulate --processes 64 --sample-ms 9 --view-ms 1 --link-gbit 1")]
pub struct Options {
    /// A file, `terrain[:TRIANGLES]`, `mirrors[:BALLS]` or `rooms[:WALL_MM]`; `+balls:N` after it for mirroring balls,
    /// `?environment=FILE` for another sky
    #[arg(long, value_name = "S", default_value = or_quick("terrain:500000", "terrain:20000"))]
    pub scene: String,
    /// Number of processes: real clusters of 1 to P [default: 3], or one simulated cluster of P [default: 2 to 4096]
    #[arg(long, value_name = "P", value_parser = clap::value_parser!(u32).range(1..=8192))]
    processes: Option<u32>,
    /// Views per tick of real clusters. The largest number is used for efficiency against processes
    #[arg(long, value_name = "N", value_delimiter = ',', default_value = or_quick("10,50,100,290,500,1000", "24"))]
    pub views: Vec<u32>,
    /// Size of a view in pixels
    #[arg(long, value_name = "WxH", value_parser = size, default_value = or_quick("200x150", "96x72"))]
    pub size: [u32; 2],
    /// Smallest number of measured ticks
    #[arg(long, value_name = "N", value_parser = count, default_value = or_quick("3", "2"))]
    pub ticks: usize,
    /// Smallest number of measured views; small ticks are repeated to reach it
    #[arg(long, value_name = "N", value_parser = count, default_value = or_quick("1500", "48"))]
    pub measured_views: usize,
    /// Seconds without role changes before measuring starts
    #[arg(long, value_name = "SECONDS", value_parser = seconds, default_value = or_quick("5", "0.5"))]
    pub settle: Duration,
    /// Simulated views of each case with a trouble
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64), default_value = or_quick("200000", "2000"))]
    pub troubled_views: u64,
    /// Simulate the cluster instead of measuring real processes
    #[arg(long)]
    pub simulate: bool,
    #[command(flatten)]
    costs: Costs,
    /// Whether the agreement of simulation and measurement is judged. Very short ticks are noise.
    #[arg(skip = !is_quick())]
    pub judged: bool,
}

/// Costs of work in a simulation.
#[derive(Debug, Clone, clap::Args)]
#[command(next_help_heading = "Costs of a simulation")]
pub struct Costs {
    /// JSON file of costs, as this study prints them after a real run [default: round numbers of that order]
    #[arg(long, value_name = "FILE")]
    costs: Option<PathBuf>,
    /// g: milliseconds for a sample
    #[arg(long, value_name = "MS", value_parser = positive)]
    sample_ms: Option<f64>,
    /// c: milliseconds for a view from samples
    #[arg(long, value_name = "MS", value_parser = positive)]
    view_ms: Option<f64>,
    /// Milliseconds for a view from the triangles
    #[arg(long, value_name = "MS", value_parser = positive)]
    direct_ms: Option<f64>,
    /// Speed of each machine's network link
    #[arg(long, value_name = "GBIT/S", value_parser = positive)]
    link_gbit: Option<f64>,
    /// One-way latency between two machines
    #[arg(long, value_name = "MS", value_parser = positive)]
    latency_ms: Option<f64>,
}

impl Costs {
    fn parameters(&self) -> anyhow::Result<Parameters> {
        let mut parameters = match &self.costs {
            None => Parameters::default(),
            Some(path) => {
                let text = std::fs::read(path).with_context(|| format!("cannot read {}", path.display()))?;
                serde_json::from_slice(&text)
                    .with_context(|| format!("{} is not a JSON file of costs", path.display()))?
            }
        };
        let Parameters { sample_ms, view_ms, direct_ms, latency_ms, .. } = &mut parameters;
        for (given, cost) in [
            (self.sample_ms, sample_ms),
            (self.view_ms, view_ms),
            (self.direct_ms, direct_ms),
            (self.latency_ms, latency_ms),
        ] {
            *cost = given.unwrap_or(*cost);
        }
        if let Some(gbit) = self.link_gbit {
            parameters.link_bytes_per_sec = gbit * 1.25e8;
        }
        Ok(parameters)
    }
}

impl Options {
    /// Processes for time against views. Efficiency is measured with 1 to this many.
    fn processes(&self) -> u32 {
        self.processes.unwrap_or(if is_quick() { 2 } else { 3 })
    }

    /// Numbers of simulated processes.
    fn simulated(&self) -> Vec<u32> {
        match self.processes {
            Some(processes) => vec![processes.max(2)],
            None if is_quick() => vec![2, 11],
            None => vec![2, 5, 6, 7, 8, 9, 10, 11, 64, 256, 1024, 4096],
        }
    }
}

/// The most ticks measured to reach [`Options::measured_views`].
const MOST_TICKS: usize = 60;

/// Simulated views per process and tick beyond the paper's eleven processes.
const VIEWS_EACH: u64 = 100;

/// Ticks with more views than this are simulated fewer times: they take minutes and vary little.
const MANY_VIEWS: u64 = 100_000;

/// Runs the study with clusters of the program `argus`.
///
/// # Errors
/// A cluster that does not start, or a view that is not answered.
pub async fn run(argus: &Path, options: &Options, progress: &ProgressBar) -> Result<Report> {
    match options.simulate {
        true => simulated(options, options.costs.parameters()?, progress).await,
        false => measured(argus, options, progress).await,
    }
}

async fn measured(argus: &Path, options: &Options, progress: &ProgressBar) -> Result<Report> {
    let most = options.views.iter().copied().max().unwrap_or(1);
    let mut cases: Vec<(usize, u32, Method)> = Vec::new();
    let p = options.processes().max(2) as usize;
    cases.extend(options.views.iter().flat_map(|v| Method::ALL.map(|method| (p, *v, method))));
    cases
        .extend((1..=options.processes() as usize).flat_map(|q| Method::ALL.map(|method| (q, most, method))));
    let mut unique: Vec<(usize, u32, Method)> = Vec::new();
    for case in cases {
        // One process cannot have samplers beside compositors.
        if !(unique.contains(&case) || (case.0 == 1 && case.2 == Method::Helping)) {
            unique.push(case);
        }
    }
    progress.set_length(unique.len() as u64 + 1);
    let mut runs: Vec<(usize, u32, Method, Measured)> = Vec::new();
    for (processes, views, method) in unique {
        progress.set_message(format!("P = {processes}, V = {views}, {}", method.name()));
        // Views are answered in batches: enough views that one batch more or less does not matter.
        let ticks = options.ticks.max((options.measured_views / views as usize).min(MOST_TICKS));
        let Options { scene, size, settle, .. } = options;
        let run = Run { argus, scene, processes, views, size: *size, method, ticks, settle: *settle };
        runs.push((processes, views, method, measure(&run).await?));
        progress.inc(1);
    }
    progress.set_message("quality");
    let (flip, psnr_db) = quality(argus, options).await?;
    progress.inc(1);
    let parameters = parameters_of(&runs, options);
    let mut rows = Vec::new();
    for (processes, views, method, measured) in &runs {
        let simulation =
            simulate_one(*processes as u32, u64::from(*views), *method, &parameters, options.ticks);
        let of = |processes: usize, method: Method| {
            let found = runs.iter().find(|run| (run.0, run.1, run.2) == (processes, *views, method));
            found.map(|run| &run.3)
        };
        let beside = Beside {
            proposed: of(*processes, Method::Proposed).unwrap_or(measured),
            // One process has no helping samplers.
            alone_secs: of(1, if *method == Method::Helping { Method::Proposed } else { *method })
                .map(|m| m.tick_secs),
            simulated_secs: simulation.tick_secs,
            calibrates: (*processes, *views) == (p, most)
                && matches!(method, Method::Proposed | Method::Naive),
            judged: options.judged,
        };
        rows.push(Row::measured(*processes as u32, *views, *method, measured, &beside));
    }
    let device = runs.first().map(|run| run.3.device.clone()).unwrap_or_default();
    let mut report = Report::new(options.scene.clone(), Machine::here(&device), row::table(&rows));
    report.plots = row::plots_of_measured(&rows, p as u32, most);
    report.notes.push(format!(
        "Image difference of warped and direct views, mean of {JUDGED}: FLIP {flip:.4}, PSNR {psnr_db:.1} dB."
    ));
    if report.machine.driver_threads.is_empty() {
        report.machine.driver_threads = "1".to_owned();
    }
    let cores = report.machine.cores;
    if options.processes() as usize + 2 > cores {
        report.notes.push(format!(
            "{} workers, the coordinator and the client share {cores} cores: the measured and the simulated processes have \
             less than one core each.",
            options.processes()
        ));
    }
    report.notes.extend(row::notes_of_measured(&rows, p as u32, most));
    report.notes.push(format!("Costs, for --costs: {}", serde_json::to_string(&parameters)?));
    Ok(report)
}

/// Views compared for image quality.
const JUDGED: usize = 4;

/// Mean FLIP and PSNR (dB) of warped views against direct ones.
async fn quality(argus: &Path, options: &Options) -> Result<(f64, f64)> {
    let arguments = ["--refining-share=0".to_owned(), PLAIN.to_owned()];
    let cluster = LocalCluster::of_single_threads(argus, &options.scene, 1, &arguments)?;
    let client = connect(&cluster, 1).await?;
    let (mut flip, mut psnr) = (0.0, 0.0);
    let plans = [PlanRequest::from_samples(), PlanRequest { direct: true, ..PlanRequest::default() }];
    let [warped, direct] = plans
        .map(|plan| argus_client::load::path_views(client.description(), JUDGED as u32, options.size, plan));
    for views in warped.iter().zip(&direct) {
        let mut images = Vec::new();
        for view in [views.0, views.1] {
            let frame = client.render(view, &patient()).await?.frame;
            let color = frame.images[Output::Color].clone().map(|color| color.to_vec()).unwrap_or_default();
            images.extend(RgbImage::from_raw(frame.width, frame.height, color));
        }
        let [warped, direct] = images.as_slice() else { anyhow::bail!("a frame without colour") };
        let comparison = compare(direct, warped)?;
        flip += comparison.flip_mean / JUDGED as f64;
        psnr += comparison.psnr_db / JUDGED as f64;
    }
    drop(client);
    cluster.stop()?;
    Ok((flip, psnr))
}

/// The simulation's costs, from the runs' CPU times: they exclude waiting between processes that share cores.
fn parameters_of(runs: &[(usize, u32, Method, Measured)], options: &Options) -> Parameters {
    let cores = std::thread::available_parallelism().map_or(1, |n| n.get() as u32);
    let most = options.views.iter().copied().max().unwrap_or(1);
    let p = options.processes().max(2) as usize;
    let of = |method| runs.iter().find(|run| (run.0, run.1, run.2) == (p, most, method)).map(|run| &run.3);
    let mut parameters =
        Parameters { machines: Machines::Shared { cores }, latency_ms: 0.1, ..Parameters::default() };
    parameters.link_bytes_per_sec = 2e9;
    let views = f64::from(most);
    if let Some(measured) = of(Method::Proposed) {
        let [sampling, compositing, coordinator, client] = measured.cpu.map(|secs| secs * 1e3);
        // Packing runs beside rendering. The rest of a compositor's CPU time is its render thread's.
        let encode = (measured.parts.encode * 1e3 / views).min(0.9 * compositing / views);
        parameters.encode_ms = encode;
        let received = measured.received.max(1.0);
        parameters.hold_ms = measured.holding * 1e3 / received;
        parameters.unpack_ms = measured.unpacking * 1e3 / received;
        let taking_up = (measured.holding + measured.unpacking) * 1e3;
        parameters.view_ms = ((compositing - taking_up) / views - encode).max(0.01);
        let samples = measured.samples.max(1.0);
        parameters.sample_ms = (measured.sample_secs * 1e3).min(sampling / samples);
        parameters.sample_pooled = measured.sampling_shares.unwrap_or_default().pooled;
        parameters.pack_ms = (sampling / samples - parameters.sample_ms).max(0.0);
        parameters.relay_ms = coordinator / views;
        parameters.client_ms = client / views;
    }
    if let Some(measured) = of(Method::Naive) {
        let workers = (measured.cpu[0] + measured.cpu[1]) * 1e3;
        parameters.direct_ms = (workers / views - parameters.encode_ms).max(0.01);
        parameters.direct_pooled = measured.parts.pooled_share(p, cores);
    }
    parameters
}

fn simulate_one(
    processes: u32,
    views: u64,
    method: Method,
    parameters: &Parameters,
    ticks: usize,
) -> efficiency::Outcome {
    let case = Case {
        processes,
        views,
        refreshed: matches!(method, Method::Proposed | Method::Helping),
        direct: method == Method::Naive,
        helping: method == Method::Helping,
        // Short ticks depend on chance: on the batch in work when the next samples become due. So they are repeated.
        ticks: ticks.max((40_000 / views as usize).min(40)),
        settled_secs: or_quick(SETTLED_SECS, 10.0),
    };
    efficiency::run(&case, parameters)
}

/// One simulated tick.
struct Tick {
    processes: u32,
    views: u64,
    method: Method,
    relayed: bool,
    cores: Option<u32>,
}

/// All simulated ticks: those of the paper's figures, and larger clusters.
fn ticks(simulated: &[u32]) -> Vec<Tick> {
    let mut ticks = Vec::new();
    let mut add = |processes, views, method, relayed, cores| {
        ticks.push(Tick { processes, views, method, relayed, cores });
    };
    for &p in simulated {
        let views = if p <= 11 { 1000 } else { VIEWS_EACH * u64::from(p) };
        for method in Method::ALL {
            // Beyond 1024 processes only the methods that render samples anew: each further method adds millions of
            // views.
            if p <= 1024 || matches!(method, Method::Proposed | Method::Helping) {
                add(p, views, method, p <= 11, None);
            }
        }
        // One coordinator cannot relay for hundreds of workers, so clients then connect to workers.
        if p > 11 && p <= 256 {
            add(p, views, Method::Proposed, true, None);
        }
        // The paper's processes have no second core that packs frames and samples.
        if [5, 11, 1024].contains(&p) {
            add(p, views, Method::Proposed, p <= 11, Some(1));
            add(p, views, Method::Helping, p <= 11, Some(1));
        }
    }
    // Time against views.
    let most = simulated.iter().copied().max().unwrap_or(2);
    for views in [10, 100, 10_000, 100_000, 1_000_000] {
        for p in [5, 1024] {
            if p <= most && views <= 2000 * u64::from(p) {
                add(p, views, Method::Proposed, p <= 11, None);
            }
        }
    }
    ticks
}

/// Simulated clusters with a trouble.
fn troubles(options: &Options) -> Vec<trouble::Case> {
    let mut cases = Vec::new();
    let sizes = [(2, 10), (11, 1000), (64, 10_000), (256, 100_000), (1024, 1_000_000), (4096, 1_000_000)];
    for (processes, clients) in sizes.into_iter().filter(|(p, _)| options.simulated().contains(p)) {
        for trouble in trouble::Trouble::ALL {
            cases.push(trouble::Case { processes, clients, trouble, views: options.troubled_views });
        }
    }
    cases
}

async fn simulated(options: &Options, parameters: Parameters, progress: &ProgressBar) -> Result<Report> {
    let (ticks, troubles) = (ticks(&options.simulated()), troubles(options));
    progress.set_length((ticks.len() + troubles.len()) as u64);
    let mut rows = Vec::new();
    for Tick { processes, views, method, relayed, cores } in ticks {
        progress.set_message(format!("P = {processes}, V = {views}, {}", method.name()));
        let machines = cores.map_or(parameters.machines, |cores| Machines::Each { cores });
        let parameters = Parameters { relayed, machines, ..parameters.clone() };
        let work = {
            let parameters = parameters.clone();
            let ticks = if views > MANY_VIEWS { 2 } else { 4 };
            tokio::task::spawn_blocking(move || simulate_one(processes, views, method, &parameters, ticks))
        };
        rows.push(Row::simulated(processes, views, method, &parameters, &work.await?));
        progress.inc(1);
    }
    for case in troubles {
        progress.set_message(format!("P = {}, {}", case.processes, case.trouble.name()));
        let parameters = Parameters { relayed: case.processes <= 11, ..parameters.clone() };
        let costs = trouble::costs(&case, &parameters);
        let work = {
            let costs = costs.clone();
            tokio::task::spawn_blocking(move || trouble::run(&case, &costs))
        };
        rows.push(Row::troubled(&costs, &work.await?));
        progress.inc(1);
    }
    let mut report = Report::new("simulated", Machine::here("none"), row::table(&rows));
    report.plots = row::plots_of_simulated(&rows);
    report.notes = row::notes(&rows);
    report.notes.push(format!(
        "Rows with a trouble: random requests for ten seconds at six tenths of the cluster's capacity, in a still scene. \
         stragglers: one process of eight at half the speed; losses: one of sixteen killed, one after the other; waves: \
         demand that rises and falls by half. Beyond {} views, a simulated view stands for several: its cost (view_ms) and \
         its latencies grow by that factor. The load of each process stays the same, the coordinator's work per second falls, \
         and some clients request nothing. Left out: troubles while samples are rendered anew each tick, and several troubles \
         at once; the naive method and still scenes beyond 1024 processes; the relaying coordinator beyond 256.",
        options.troubled_views
    ));
    report.notes.push(format!("Costs: {}", serde_json::to_string(&parameters)?));
    Ok(report)
}
