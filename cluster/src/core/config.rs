//! The core's configuration, with the reason for each default.

use std::time::Duration;

use argus_scene::{Limits, Search, Visibility};
use serde::Serialize;

/// The core's configuration. Durations are on the clock that the shell hands in.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Config {
    /// The unit of demand: S, D and V are counts per tick. 1 s: a tick holds several views of a slow machine, and
    /// roles still follow demand within seconds.
    pub tick: Duration,
    /// Weight of the newest tick in the average of demand, and of the newest report in the average of costs.
    pub smoothing: f64,
    /// A change of all workers' roles must be predicted to shorten the tick by this factor; a change of a share of
    /// them, by that power of it: 1.17 for one of three. A change costs drains and transfers of samples.
    pub margin: f64,
    /// A change of roles that would halve the tick must be predicted for at least this long; smaller gains for longer.
    pub dwell: Duration,
    /// If the predicted work is below this fraction of a tick, roles stay as they are.
    pub idle_fraction: f64,
    /// A worker that has not reported for this long is lost. Twenty reports: a machine with more renderers than cores
    /// may starve one for seconds. A process that dies closes its stream and is noticed at once.
    pub lease: Duration,
    /// A worker is suspected if its render thread has been at one piece of work for this long, and for ten times its
    /// expected time.
    pub stuck_after: Duration,
    /// Replaces [`Config::stuck_after`] until a worker has measured such work: the first sample may wait for shader
    /// compilation.
    pub first_of_its_kind: Duration,
    /// Interval between reports of a worker.
    pub report_interval: Duration,
    /// Most views waiting or in work in the whole cluster; further ones are refused at once.
    pub max_views: usize,
    /// Most views of one client waiting or in work. Three quarters, so that no client fills the cluster alone.
    pub max_views_per_client: usize,
    /// Most open sessions. Each costs a task and two unacknowledged frames.
    pub max_sessions: usize,
    /// Most open sessions of one client: three quarters.
    pub max_sessions_per_client: usize,
    /// Most pixels per second of all clients, with sub-pixels. `None`: limited only by [`Config::max_wait`].
    pub pixels_per_sec: Option<f64>,
    /// Most pixels per second of one client, with sub-pixels. `None`: no limit.
    pub pixels_per_sec_per_client: Option<f64>,
    /// A view is refused at once if its expected wait exceeds this time or its deadline. The wait is predicted by
    /// measured costs of the views in flight.
    pub max_wait: Duration,
    /// Most unanswered views of one worker: two full batches, so that one is ready when the other is done.
    pub max_views_per_worker: usize,
    /// Attempts at a view before its failure is reported.
    pub max_attempts: u32,
    /// Longest time that a view waits for a worker.
    pub patience: Duration,
    /// Longest time of a view, whatever its deadline. Without it, a view whose client reads nothing would keep its
    /// place for ever. Ten minutes: longer than any view takes.
    pub max_view_time: Duration,
    /// Cost of a sample that a compositor must fetch, in queued views.
    pub missing_sample_views: f64,
    /// Whether samplers compose views in spare time, since whole K may leave them idle. `argus-lab study load burst` compares
    /// both: a fifth less time for 290 views on two workers.
    pub samplers_composite: bool,
    /// Share of the samplers' time for samples at refinements of the rig, where views have holes. They add at most
    /// this share of K ticks to a, and at most half of the spare time, but always a tenth of the share. They are
    /// rendered when nothing else waits. 0: only the rig's own cameras.
    pub refining_share: f64,
    /// Bytes of samples at refinements in each worker; the least useful are replaced.
    pub refining_bytes: u64,
    /// Δt of an animated scene: least time between two epochs. The default is about the time of a small scene's
    /// samples on a slow machine. Zero holds the scene still.
    pub epoch: Duration,
    /// Sample cameras are rendered for the next epoch if a view used them within this time.
    pub epoch_interest: Duration,
    /// Longest wait of a prepared epoch for its next sample. Then the epoch is served, and views wait for missing
    /// samples. It is long, since overloaded samplers render what views wait for first, and serving an unready epoch
    /// adds to that.
    pub epoch_patience: Duration,
    /// Least number of views from samples between two epochs; 0: by time alone. The cluster paper samples the scene
    /// anew for every V views, and this reproduces its measurements, also in still scenes.
    pub refresh_views: u64,
    /// Number of samples of a plan, if the request leaves it open.
    pub samples_per_view: u32,
    /// Linear steps, if the request leaves them open. Beyond 64 the cluster paper's search gains little.
    pub linear_steps: u32,
    /// Visibility backend of samples. `None`: the first worker measures all, and the cheapest is chosen.
    pub visibility: Option<Visibility>,
    /// Limits of a view's size.
    pub limits: Limits,
}

impl Config {
    /// Steps of a search, if the request leaves them open.
    pub fn steps_of(&self, search: Search) -> u32 {
        if search == Search::Linear { self.linear_steps } else { search.usual_steps() }
    }

    /// A worker that is silent for this long is *suspected* (Chandra and Toueg), if another healthy worker reports on
    /// time. Its views are retried and it gets no new ones, but it keeps its place until its lease ends. Three
    /// reports by default: views are retried within a second of a hang.
    pub(super) fn doubted_after(&self) -> Duration {
        self.lease * 3 / 20
    }

    /// A worker that is silent for this long is suspected, whatever other workers do and however late its recent
    /// reports were. Six reports by default: a wrong suspicion costs the time of a view, and a hang that is not
    /// noticed costs clients all of it.
    pub(super) fn suspected_after(&self) -> Duration {
        self.lease * 3 / 10
    }
}

impl Default for Config {
    fn default() -> Self {
        Self {
            tick: Duration::from_secs(1),
            smoothing: 0.3,
            margin: 1.6,
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
