//! Arguments of the study.

use super::mode::Mode;
use super::walk::Walk;
use crate::arguments::{count, or_quick, positive, size};

/// Measures the service from its users' side: time to the first view, latency and error under an open load, cold and
/// warm; by default, and with direct or warped views forced
///
/// Each mode has a new cluster. Cold: clients send as soon as there is an address. Warm: the same walk again, after a warm-up
/// walk and time to settle. Each view's due time is fixed beforehand, and its latency counts from then; a view without a frame
/// after 30 s has failed and counts with that time. 24 views of each phase are compared with direct views of 16 samples a
/// pixel. The planner's predictions are compared with the frames: time_predicted is the share of frames within 30% or 5 ms,
/// error_bounded the share of frames from samples whose error is at most the predicted one, planning_us the coordinator's
/// microseconds a view. Takes two or three minutes a run, more if views are late.
#[derive(Debug, Clone, clap::Args)]
#[command(after_help = "\
Examples:
  argus-lab study load service --scene sponza.glb --out figures
  argus-lab study load service --scene sponza.glb --size 640x480 --rate 10 --walk jumps --runs 5
  argus-lab study load service --scene sponza.glb --overload --regret-views 100
  argus-lab study load service --scene room.glb -- --rig cell --cell 0.5")]
pub struct Options {
    /// A file, `terrain[:TRIANGLES]`, `mirrors[:BALLS]` or `rooms[:WALL_MM]`; `+balls:N` after it for mirroring balls,
    /// `?environment=FILE` for another sky
    #[arg(long, value_name = "S", default_value = or_quick("terrain:500000", "terrain:20000"))]
    pub scene: String,
    /// Size of a view in pixels
    #[arg(long, value_name = "WxH", value_parser = size, default_value = or_quick("320x240", "96x72"))]
    pub size: [u32; 2],
    /// Number of clients at the same time, each on its own path
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..), default_value = or_quick("4", "2"))]
    pub clients: u32,
    /// Views per second of each client
    #[arg(long, value_name = "R", value_parser = positive, default_value = "5")]
    pub rate: f64,
    /// How clients move: smoothly, from the recommended viewpoints through the scene or down to it (steady); to another
    /// place each second (jumps); not at all (stand)
    #[arg(long, value_name = "HOW", value_enum, hide_possible_values = true, default_value = "steady")]
    pub walk: Walk,
    /// Seconds of each phase
    #[arg(long, value_name = "T", value_parser = positive, default_value = or_quick("10", "2"))]
    pub seconds: f64,
    /// Number of worker processes
    #[arg(long, value_name = "P", value_parser = count, default_value = "2")]
    pub workers: usize,
    /// Number of repetitions; rows are their medians, and `spread` holds the minima and maxima
    #[arg(long, value_name = "N", value_parser = count, default_value = "1")]
    pub runs: usize,
    /// Views per phase whose error is measured
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64), default_value = or_quick("24", "4"))]
    pub judged: u64,
    /// Longest time in seconds for the service to settle, before the warm-up and again before the warm phase
    #[arg(long, value_name = "SECONDS", value_parser = positive, default_value = or_quick("15", "3"))]
    pub settle_secs: f64,
    /// Start each cluster with empty caches, like a machine that never ran Argus. Drivers then compile every program
    /// anew, which takes the software driver seconds. Otherwise a start that is not measured fills them first
    #[arg(long)]
    pub empty_caches: bool,
    /// Number of views to render one at a time with every method, to measure the planner's regret: the time by
    /// default over that of the best method within the error bound, minus 1. Takes up to 90 s; 0 skips it
    #[arg(long, value_name = "N", default_value = or_quick("24", "4"))]
    pub regret_views: u32,
    /// A way of requesting views; may be given more than once [default: all]
    #[arg(long = "mode", value_name = "MODE", value_enum)]
    pub modes: Vec<Mode>,
    /// Also measure two and four times the capacity for direct views, in every mode: `share_of_peak` is the rate of
    /// answered views over that of the best forced method that is as good. Takes two or three minutes more a run
    #[arg(long)]
    pub overload: bool,
    /// Further arguments of `argus serve`
    #[arg(last = true, value_name = "ARGUMENT")]
    pub serve: Vec<String>,
}
