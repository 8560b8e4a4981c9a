//! New views: admitted with a plan, or refused.

use std::collections::BTreeSet;
use std::time::Duration;

use argus_proto::Fault;
use argus_scene::{Plan, Preset, SampleId, Version, View};

use super::explicit_plan::plan;
use super::open_view::OpenView;
use super::pending::Pending;
use super::targets::Planned;
use super::{Cluster, Output, Views};
use crate::core::event::{Action, Client, LastView, ViewId};
use crate::core::samples::MOST_SAMPLES;
use crate::core::time::Uptime;
use crate::core::workers::Worker;

/// Longest time that a view whose way is open may wait, unless it is the time of a few views.
///
/// Tuned: 2 s (issue 54, item 1).
const MOST_WAIT: Duration = Duration::from_secs(2);

/// Times its own time that a view may wait, however long that is.
///
/// Tuned: 16 (issue 54, item 1).
const MOST_VIEWS_AHEAD: f64 = 16.0;

/// A new view, and what its client asks of it.
#[derive(Debug)]
pub(in crate::core) struct NewView<'a> {
    pub(in crate::core) view_id: ViewId,
    pub(in crate::core) client: Client,
    pub(in crate::core) view: &'a View,
    /// Time until the answer is worthless; `None`: no deadline.
    pub(in crate::core) deadline: Option<Duration>,
    /// The session's last view, if there is one.
    pub(in crate::core) last: Option<Box<LastView>>,
}

impl Views {
    /// Admits a new view, which then waits for a worker, or is turned away.
    pub(in crate::core) fn submit(
        &mut self,
        new: NewView<'_>,
        cluster: Cluster<'_>,
        now: Uptime,
    ) -> Vec<Output> {
        let view_id = new.view_id;
        match self.admit(&new, cluster, now) {
            Err(fault) => {
                match fault {
                    Fault::Overloaded { .. } => self.counts.rejected += 1,
                    _ => self.counts.failed += 1,
                }
                vec![Output::Act(Action::Refuse { view_id, fault })]
            }
            Ok(planned) => self.enter(new, planned, cluster, now),
        }
    }

    /// Adds an admitted view with its plan.
    fn enter(
        &mut self,
        new: NewView<'_>,
        planned: Planned,
        cluster: Cluster<'_>,
        now: Uptime,
    ) -> Vec<Output> {
        let NewView { view_id, client, view, deadline, last } = new;
        let Planned { plan, expected, target_search } = planned;
        let longest = self.config.max_view_time;
        let deadline = deadline.unwrap_or(longest).min(longest);
        let pixels = u64::from(view.width) * u64::from(view.height);
        self.admission.enter(&client, plan.sub_pixels(pixels), &self.config, now);
        let open = OpenView::of(view, last.as_deref());
        let chooses = open.is_none() && view.pin.is_none() && matches!(plan, Plan::Warp(_));
        let pending = Pending {
            own_level: if chooses { cluster.samples.own_level(&view.camera) } else { 0 },
            client,
            camera: view.camera,
            pixels,
            version: version_of(view, cluster),
            plan,
            open,
            pinned: view.pin.is_some(),
            expected,
            target_search,
            device: view.pin.as_ref().map(|pin| pin.device.clone()).unwrap_or_default(),
            deadline: (now.after(deadline), deadline),
            requested: now,
            due: now,
            attempt: 0,
            worker: None,
            tried: BTreeSet::new(),
        };
        let mut outputs = Vec::new();
        // A view that leaves the way open is counted at dispatch.
        if pending.open.is_none() {
            outputs.push(Output::Demand(pending.kind()));
        }
        if !pending.pinned {
            outputs.push(Output::Used { cameras: pending.cameras() });
        }
        self.in_flight.add(&pending);
        self.views.insert(view_id, pending);
        self.wait(view_id);
        outputs
    }

    /// Checks whether a view may be admitted, and makes its plan.
    fn admit(&self, new: &NewView<'_>, cluster: Cluster<'_>, now: Uptime) -> Result<Planned, Fault> {
        let &NewView { ref client, view, deadline, .. } = new;
        if self.draining {
            return Err(Fault::Unavailable("the coordinator is shutting down".to_owned()));
        }
        let Cluster { samples, workers, .. } = cluster;
        // Limits are checked first, so that refused views cost no planning under overload.
        let open = view.leaves_way_open();
        let (least, most) = match open {
            true => self.expected_wait_anywhere(cluster, now),
            false => {
                let least = self.expected_wait(true, cluster).min(self.expected_wait(false, cluster));
                (least, self.config.max_wait)
            }
        };
        self.check_load(client, deadline, (least, most), now)?;
        let nearest = |count| samples.sample_ids(&view.camera, count, samples.set().version.number);
        let plain = plan(view, samples.set(), nearest, &self.config)?;
        // After scene and specification, which say more of why a pin cannot be repeated.
        samples.check_version(view)?;
        if open {
            return Ok(Planned { plan: plain, expected: None, target_search: None });
        }
        let mut planned = self.planned(view, plain, cluster);
        if planned.target_search.is_none() && view.pin.is_none() {
            widen(view, &mut planned.plan, cluster);
        }
        let direct = matches!(planned.plan, Plan::Direct { .. });
        let expected = (self.expected_wait(direct, cluster), self.config.max_wait);
        self.check_load(client, deadline, expected, now)?;
        if let Some(device) = view.pin.as_ref().map(|pin| &pin.device).filter(|device| !device.is_empty()) {
            let mut ready = workers.members().peekable();
            if ready.peek().is_some() && !ready.any(|w| w.hello().device == *device) {
                return Err(Fault::Pin(format!("no worker has the device {device:?}")));
            }
        }
        Ok(planned)
    }

    /// Checks whether a view with this expected wait, and this longest bearable one, may be admitted.
    fn check_load(
        &self,
        client: &str,
        deadline: Option<Duration>,
        (expected, most): (Duration, Duration),
        now: Uptime,
    ) -> Result<(), Fault> {
        let bearable = deadline.unwrap_or(Duration::MAX).min(most);
        // Half of the views in flight are done by then.
        let retry_after = (expected / 2).clamp(Duration::from_millis(50), Duration::from_secs(5));
        if self.views.len() >= self.config.max_views || expected > bearable {
            let (count, secs) = (self.views.len(), expected.as_secs_f64());
            let what = format!("{count} views are waiting or in work, {secs:.1} s of work before this one");
            return Err(Fault::Overloaded { what, retry_after });
        }
        self.admission.check(client, &self.config, retry_after, now)
    }

    /// Time until the views in flight of one kind are done by the workers of that role, by measured costs. If only
    /// direct views are in flight, all workers will soon render them.
    pub(super) fn expected_wait(&self, direct: bool, cluster: Cluster<'_>) -> Duration {
        let (costs, queues) = (cluster.workers.believed_costs(), cluster.workers.queues());
        let (cost, ahead) = match direct {
            true => (costs.direct_secs, self.in_flight.direct),
            false => (costs.view_secs, self.in_flight.composed),
        };
        let hands = match direct {
            true if self.in_flight.composed == 0 => queues.ready(),
            true => queues.samplers().len(),
            false => queues.compositors().len(),
        };
        Duration::try_from_secs_f64(cost * ahead as f64 / hands.max(1) as f64).unwrap_or(Duration::MAX)
    }

    /// Predicted time until the views that any worker can answer are done, and the longest that another one may wait. Views are
    /// reduced before they wait, so longer queues mean that even the least is more than is carried.
    fn expected_wait_anywhere(&self, cluster: Cluster<'_>, now: Uptime) -> (Duration, Duration) {
        let workers = cluster.workers;
        let queued_ms: f64 = workers.iter().map(|worker| worker.queued_ms(now)).sum();
        let decided: usize = workers.iter().map(Worker::queued).sum();
        let each_ms = if decided > 0 { queued_ms / decided as f64 } else { 0.0 };
        let ahead_ms = queued_ms + each_ms * self.waiting.open.len() as f64;
        let secs = ahead_ms * 1e-3 / workers.queues().ready().max(1) as f64;
        let wait = Duration::try_from_secs_f64(secs).unwrap_or(Duration::MAX);
        let of_views =
            Duration::try_from_secs_f64(MOST_VIEWS_AHEAD * each_ms * 1e-3).unwrap_or(Duration::MAX);
        (wait, MOST_WAIT.max(of_views).min(self.config.max_wait))
    }
}

/// The version of a view: the served one, or its pin's.
fn version_of(view: &View, cluster: Cluster<'_>) -> Version {
    let served = cluster.samples.set().version;
    let Some(pin) = &view.pin else { return served };
    let number = match &pin.plan {
        Plan::Warp(warp) => warp.samples.first().map_or(served.number, |id| id.version),
        Plan::Direct { .. } => served.number,
    };
    Version { number, state: pin.state }
}

/// Adds samples to a plan whose request leaves their number open, if most compositors hold them. Another camera may
/// have seen what the first ones did not, and a new sample costs more.
fn widen(view: &View, plan: &mut Plan, cluster: Cluster<'_>) {
    let open = view.plan.samples.is_none() && matches!(view.plan.preset, None | Some(Preset::Balanced));
    let (true, Plan::Warp(warp)) = (open, plan) else { return };
    let samples = cluster.samples;
    let readers = cluster.workers.queues().compositors().len();
    let at_hand = |id: &SampleId| readers > 0 && 2 * samples.locations().count(*id) >= readers;
    let all = samples.sample_ids(&view.camera, MOST_SAMPLES, samples.set().version.number).into_iter();
    let further: Vec<SampleId> =
        all.filter(|id| !id.is_reflection_probe() && !warp.samples.contains(id) && at_hand(id)).collect();
    // Reflection maps come last.
    let own = warp.samples.iter().filter(|id| !id.is_reflection_probe()).count();
    warp.samples.splice(own..own, further.into_iter().take(MOST_SAMPLES.saturating_sub(own)));
}
