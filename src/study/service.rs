//! Arguments of `argus study service`.

use argus_studies::service::{Options, Walk, run};
use argus_studies::{Effort as _, Report};
use clap::builder::{PossibleValuesParser, TypedValueParser};
use indicatif::ProgressBar;

use super::arguments::{Scene, Size, Workers};
use crate::args;

/// The service as its users meet it: time to the first view, latency and error under an open load, cold and warm; by
/// default, and with views from triangles or from samples forced
///
/// Without --scene: terrain:500000; without --size: 320x240. Each mode has a cluster of its own, started anew. Cold: clients
/// ask as soon as there is an address. Warm: the same walk again, after it was walked once more and the service had time to
/// settle. When a view is due is fixed beforehand, and its latency counts from then; one without a frame after 30 s has
/// failed and counts with that time. Twelve views of a phase are judged, as they came, against direct views of 16 samples a
/// pixel. Predictions of the planner are judged by what frames took and show: time_predicted is the share of frames within 30%
/// or 3 ms, error_bounded the share of frames from samples whose error is at most the predicted one, planning_us the
/// coordinator's microseconds a view. This takes two or three minutes a run, more where views are late.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  argus study service --scene sponza.glb --out figures
  argus study service --scene sponza.glb --size 640x480 --rate 10 --walk jumps --runs 5
  argus study service --scene sponza.glb --overload --regret-views 100
  argus study service --scene room.glb -- --rig cell --cell 0.5")]
pub(super) struct Service {
    #[command(flatten)]
    scene: Scene,
    #[command(flatten)]
    size: Size,
    /// Clients at the same time, each on a way of its own [default: 4]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=10_000))]
    clients: Option<u32>,
    /// Views a second, of each client [default: 5]
    #[arg(long, value_name = "R", value_parser = args::positive)]
    rate: Option<f64>,
    /// How clients move: smoothly, from the recommended viewpoints through the scene or down to it (steady); to another
    /// place each second (jumps); not at all (stand) [default: steady]
    #[arg(long, value_name = "HOW", value_parser = walk())]
    walk: Option<Walk>,
    /// Seconds of a phase [default: 10]
    #[arg(long, value_name = "T", value_parser = args::positive)]
    seconds: Option<f64>,
    #[command(flatten)]
    workers: Workers,
    /// Repeat everything so often: rows are then medians, and the least and the most stand in `spread` [default: 1]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1000))]
    runs: Option<u16>,
    /// Start each cluster with empty caches of the user, as on a machine that never ran Argus: drivers then compile every
    /// program anew, which on the software driver takes seconds. Otherwise a start that is not measured fills them first
    #[arg(long)]
    empty_caches: bool,
    /// Render so many views one at a time in every way, to see what the planner's choices cost: `regret` is the time by default
    /// over that of the best way whose error is within bound, less one. Takes up to 90 s; 0 leaves it out [default: 24]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(0..=10_000))]
    regret_views: Option<u32>,
    /// Measure twice and four times the load that direct views carry, too, in every mode: `share_of_peak` is the rate of
    /// answered views over that of the best forced way that is as good. Takes two or three minutes more a run
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
        options.overload = self.overload;
        options.serve = self.serve;
        run(&std::env::current_exe()?, &options, progress).await
    }
}
