//! Arguments of `argus-lab study service`.

use argus::args;
use argus_studies::service::{Mode, Options, Walk, run};
use argus_studies::{Effort as _, Report};
use clap::builder::{PossibleValuesParser, TypedValueParser};
use indicatif::ProgressBar;

use super::arguments::{Scene, Size, Workers};

/// Measures the service from its users' side: time to the first view, latency and error under an open load, cold and
/// warm; by default, and with direct or warped views forced
///
/// Without --scene: terrain:500000; without --size: 320x240. Each mode has a new cluster. Cold: clients send as soon
/// as there is an address. Warm: the same walk again, after a warm-up walk and time to settle. Each view's due time
/// is fixed beforehand, and its latency counts from then; a view without a frame after 30 s has failed and counts
/// with that time. 24 views of each phase are compared with direct views of 16 samples a pixel. The planner's
/// predictions are compared with the frames: time_predicted is the share of frames within 30% or 5 ms, error_bounded
/// the share of frames from samples whose error is at most the predicted one, planning_us the coordinator's
/// microseconds a view. Takes two or three minutes a run, more if views are late.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  argus-lab study service --scene sponza.glb --out figures
  argus-lab study service --scene sponza.glb --size 640x480 --rate 10 --walk jumps --runs 5
  argus-lab study service --scene sponza.glb --overload --regret-views 100
  argus-lab study service --scene room.glb -- --rig cell --cell 0.5")]
pub(super) struct Service {
    #[command(flatten)]
    scene: Scene,
    #[command(flatten)]
    size: Size,
    /// Number of clients at the same time, each on its own path [default: 4]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=10_000))]
    clients: Option<u32>,
    /// Views per second of each client [default: 5]
    #[arg(long, value_name = "R", value_parser = args::positive)]
    rate: Option<f64>,
    /// How clients move: smoothly, from the recommended viewpoints through the scene or down to it (steady); to another
    /// place each second (jumps); not at all (stand) [default: steady]
    #[arg(long, value_name = "HOW", value_parser = walk())]
    walk: Option<Walk>,
    /// Seconds of each phase [default: 10]
    #[arg(long, value_name = "T", value_parser = args::positive)]
    seconds: Option<f64>,
    #[command(flatten)]
    workers: Workers,
    /// Number of repetitions; rows are their medians, and `spread` holds the minima and maxima [default: 1]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1000))]
    runs: Option<u16>,
    /// Start each cluster with empty caches, like a machine that never ran Argus. Drivers then compile every program
    /// anew, which takes the software driver seconds. Otherwise a start that is not measured fills them first
    #[arg(long)]
    empty_caches: bool,
    /// Number of views to render one at a time with every method, to measure the planner's regret: the time by
    /// default over that of the best method within the error bound, minus 1. Takes up to 90 s; 0 skips it [default:
    /// 24]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(0..=10_000))]
    regret_views: Option<u32>,
    /// A way of requesting views; may be given more than once [default: all]
    #[arg(long, value_name = "MODE", value_parser = mode())]
    mode: Vec<Mode>,
    /// Also measure two and four times the capacity for direct views, in every mode: `share_of_peak` is the rate of
    /// answered views over that of the best forced method that is as good. Takes two or three minutes more a run
    #[arg(long)]
    overload: bool,
    /// Further arguments of `argus serve`
    #[arg(last = true, value_name = "ARGUMENT")]
    serve: Vec<String>,
}

fn walk() -> impl TypedValueParser<Value = Walk> {
    PossibleValuesParser::new(Walk::ALL.map(Walk::name))
        .map(|name| Walk::ALL.into_iter().find(|walk| walk.name() == name).unwrap_or(Walk::Steady))
}

fn mode() -> impl TypedValueParser<Value = Mode> {
    PossibleValuesParser::new(Mode::ALL.map(Mode::name))
        .map(|name| Mode::ALL.into_iter().find(|mode| mode.name() == name).unwrap_or(Mode::Default))
}

impl Service {
    pub(super) async fn run(self, quick: bool, progress: &ProgressBar) -> anyhow::Result<Report> {
        let mut options = Options::of(quick);
        self.scene.replace(&mut options.scene);
        self.size.replace(&mut options.size);
        self.workers.replace(&mut options.workers);
        options.clients = self.clients.unwrap_or(options.clients);
        options.rate = self.rate.unwrap_or(options.rate);
        options.walk = self.walk.unwrap_or(options.walk);
        options.seconds = self.seconds.unwrap_or(options.seconds);
        options.runs = self.runs.map_or(options.runs, usize::from);
        options.empty_caches = self.empty_caches;
        options.regret_views = self.regret_views.unwrap_or(options.regret_views);
        options.modes = self.mode;
        options.overload = self.overload;
        options.serve = self.serve;
        run(&std::env::current_exe()?, &options, progress).await
    }
}
