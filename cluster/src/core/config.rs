//! The knobs of the core, with the reason for each default.

use std::time::Duration;

use argus_scene::{Limits, Search, Visibility};
use serde::Serialize;

/// How the core decides. Every duration is on the clock that the shell hands in.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Config {
    /// The unit of demand: S, D and V are counts per tick. 1 s: long enough that a tick holds several views
    /// of a slow machine, short enough that roles follow demand within seconds.
    pub tick: Duration,
    /// Weight of the newest tick in the moving average of demand, and of the newest report in that of costs.
    pub smoothing: f64,
    /// A change of roles must be predicted to shorten the tick by this factor: noise in measured costs is a
    /// few per cent, and a change costs a drain and a transfer of samples.
    pub margin: f64,
    /// A change of roles must be predicted to pay for this long without a break.
    pub dwell: Duration,
    /// Below this fraction of a tick nobody is short of time, and roles stay as they are.
    pub idle_fraction: f64,
    /// A worker that has not reported for this long is lost. Twenty reports: a machine with more renderers
    /// than cores may starve one for seconds; a process that dies closes its stream and is noticed at once.
    pub lease: Duration,
    /// A worker whose render thread has been at one piece of work for this long, and for ten times as long as that is
    /// expected to take, is suspected as if it were silent.
    pub stuck_after: Duration,
    /// Takes the place of [`Config::stuck_after`] while no worker has measured such work yet: a first sample may wait for machine code.
    pub first_of_its_kind: Duration,
    /// How often workers report.
    pub report_interval: Duration,
    /// Views waiting or in work in the whole cluster; one more is turned away at once.
    pub max_views: usize,
    /// Views of one client waiting or in work: three quarters, so that no client fills the cluster alone.
    pub max_views_per_client: usize,
    /// Sessions that are open at the same time. Each is a task and two frames on their way.
    pub max_sessions: usize,
    /// Sessions of one client that are open at the same time: three quarters.
    pub max_sessions_per_client: usize,
    /// Pixels, sub-pixels counted, that all clients may ask for in a second. `None`: as many as workers manage, which
    /// [`Config::max_wait`] sees to.
    pub pixels_per_sec: Option<f64>,
    /// Pixels, sub-pixels counted, that one client may ask for in a second. `None`: as many as workers manage.
    pub pixels_per_sec_per_client: Option<f64>,
    /// A view that would probably wait longer than this, or than its own deadline, before its turn comes is
    /// turned away at once: by the measured costs of what is in flight before it.
    pub max_wait: Duration,
    /// Views sent to one worker and not yet answered: two full batches, so that one is ready when the other
    /// is done.
    pub max_views_per_worker: usize,
    /// A view is given to this many workers before its failure is passed on.
    pub max_attempts: u32,
    /// How long a view without a deadline waits for a worker.
    pub patience: Duration,
    /// A view is given up after this long at the latest, whatever its deadline: one whose client takes nothing would
    /// keep its place for ever. Ten minutes: longer than any view takes.
    pub max_view_time: Duration,
    /// A sample that a compositor lacks weighs as much as this many views in its queue: what a transfer costs.
    pub missing_sample_views: f64,
    /// Whether a sampler that has nothing to sample also composes views, where the formula's whole K would leave it
    /// idle. `argus study burst` has a row for each: a fifth less time for 290 views on two workers.
    pub samplers_composite: bool,
    /// The share of the samplers' time that may go into samples at refinements of the rig, where views have holes:
    /// what a adds to K_fd is at most this share of K ticks, and no more than half of what is to spare, yet always a tenth of
    /// itself. They are rendered when nothing else waits, so that even a half takes little from others. 0: the rig's own cameras alone.
    pub refining_share: f64,
    /// Bytes of samples at refinements that may exist in a worker at the same time; the least useful give way.
    pub refining_bytes: u64,
    /// Δt of an animated scene: the next epoch is issued no sooner than this. As short as samples of a small scene
    /// take on a slow machine; zero holds the scene still.
    pub epoch: Duration,
    /// Sample cameras are rendered anew for the next epoch for this long after a view used them.
    pub epoch_interest: Duration,
    /// An epoch that is got ready waits this long for its next sample; then it is served, and views wait for what
    /// it lacks. Long, since samplers that do not keep up render what views wait for first: an epoch that is served
    /// before it is ready gives them more of that.
    pub epoch_patience: Duration,
    /// The next epoch is issued no sooner than after so many views from samples; 0: by time alone. The ticks of the
    /// cluster paper, which samples the scene anew for every V views: it serves to measure, also where nothing moves.
    pub refresh_views: u64,
    /// Samples of a plan that a request leaves open.
    pub samples_per_view: u32,
    /// Linear steps where a request leaves them open: beyond 64 the cluster paper's search gains little.
    pub linear_steps: u32,
    /// How triangles are seen. `None`: by whichever way is measured to be cheapest, by the first worker.
    pub visibility: Option<Visibility>,
    /// The largest view that is accepted.
    pub limits: Limits,
}

impl Config {
    /// Steps of a search where a request leaves them open.
    pub fn steps_of(&self, search: Search) -> u32 {
        if search == Search::Linear { self.linear_steps } else { search.usual_steps() }
    }

    /// A worker that has not reported for this long is *suspected* (Chandra and Toueg's word), where another one that could
    /// answer is heard of on time: nothing new goes to it, and its views go to others, while it keeps its place until its
    /// lease is over. Three reports by default: its views are with others within a second of a hang.
    pub(super) fn doubted_after(&self) -> Duration {
        self.lease * 3 / 20
    }

    /// A worker that has not reported for this long is suspected whatever others do, and however late its reports were lately. Six reports by default: wrongly
    /// suspecting one that was merely starved costs a view's time, and waiting for one that hangs costs its clients all
    /// of it.
    pub(super) fn suspected_after(&self) -> Duration {
        self.lease * 3 / 10
    }
}

impl Default for Config {
    fn default() -> Self {
        Self {
            tick: Duration::from_secs(1),
            smoothing: 0.3,
            margin: 1.15,
            dwell: Duration::from_secs(3),
            idle_fraction: 0.01,
            lease: Duration::from_secs(5),
            stuck_after: Duration::from_secs(5),
            first_of_its_kind: Duration::from_secs(60),
            report_interval: Duration::from_millis(250),
            max_views: 2048,
            max_views_per_client: 1536,
            max_sessions: 16384,
            max_sessions_per_client: 12288,
            pixels_per_sec: None,
            pixels_per_sec_per_client: None,
            max_wait: Duration::from_secs(60),
            max_views_per_worker: 128,
            max_attempts: 8,
            patience: Duration::from_secs(30),
            max_view_time: Duration::from_secs(600),
            missing_sample_views: 2.0,
            samplers_composite: false,
            refining_share: 0.5,
            refining_bytes: 1 << 30,
            epoch: Duration::from_millis(100),
            epoch_interest: Duration::from_secs(1),
            epoch_patience: Duration::from_secs(15),
            refresh_views: 0,
            samples_per_view: 4,
            linear_steps: 64,
            visibility: Some(Visibility::default()),
            limits: Limits::default(),
        }
    }
}
