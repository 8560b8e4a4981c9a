//! A simulated cluster: the coordinator's core and obedient workers.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::Duration;

use argus_proto::Fault;
use argus_scene::{
    Camera, FaceMask, Outputs, Plan, PlanRequest, Prediction, Provenance, SampleId, SampleSetInfo,
    SceneState, View,
};
use glam::DVec3;

use crate::core::tests::set_info;
use crate::core::*;

/// The coordinator's core and obedient workers, on a clock that only tests advance.
pub(super) struct Sim {
    pub(super) core: Core,
    pub(super) now: Uptime,
    pub(super) next: u64,
    pub(super) workers: BTreeMap<WorkerId, SimWorker>,
    /// Views in work.
    pub(super) orders: BTreeMap<ViewId, Order>,
    pub(super) refused: Vec<(ViewId, Fault)>,
    pub(super) answered: BTreeSet<ViewId>,
    /// Predictions of accepted frames.
    pub(super) delivered: BTreeMap<ViewId, Prediction>,
    pub(super) expelled: Vec<WorkerId>,
    /// Costs that workers report.
    pub(super) view_ms: f64,
    pub(super) direct_ms: f64,
}

#[derive(Debug, Clone, Default)]
pub(super) struct SimWorker {
    pub(super) name: String,
    pub(super) report: Report,
    pub(super) assignments: Vec<Assignment>,
    /// Samples that it holds because of its prefetch list.
    pub(super) prefetch: BTreeSet<SampleId>,
    /// Whether it acknowledges at its next report.
    pub(super) obedient: bool,
}

impl Sim {
    pub(super) fn new(config: Config) -> Self {
        Self::with_set(config, set_info())
    }

    pub(super) fn with_set(config: Config, set: SampleSetInfo) -> Self {
        Self {
            core: Core::new(config, Arc::new(set)),
            now: Uptime::default(),
            next: 1,
            workers: BTreeMap::new(),
            orders: BTreeMap::new(),
            refused: Vec::new(),
            answered: BTreeSet::new(),
            delivered: BTreeMap::new(),
            expelled: Vec::new(),
            view_ms: 2.0,
            direct_ms: 80.0,
        }
    }

    /// A simulation with models of the served scene.
    pub(super) fn with_models(models: Vec<quality::Model>) -> Self {
        let sim = Self::new(Config::default());
        Self { core: sim.core.with_models(models), ..sim }
    }

    pub(super) fn with_workers(count: usize) -> Self {
        let mut sim = Self::new(Config::default());
        for i in 0..count {
            sim.join(&format!("w{i}"));
            sim.report_all();
        }
        sim
    }

    pub(super) fn step(&mut self, event: Event) {
        for action in self.core.step(event, self.now) {
            match action {
                Action::Assign { worker, assignment } => {
                    // The worker would drop them, and render them again.
                    let dropped = |source: &&Source| source.id.version < assignment.kept_from;
                    let dropped = assignment.prefetch.iter().find(dropped);
                    assert!(
                        dropped.is_none(),
                        "{dropped:?} is prefetched, kept from {}",
                        assignment.kept_from
                    );
                    if let Some(worker) = self.workers.get_mut(&worker) {
                        worker.assignments.push(assignment);
                    }
                }
                Action::Expel { worker, .. } => {
                    self.workers.remove(&worker);
                    self.orders.retain(|_, order| order.worker != worker);
                    self.expelled.push(worker);
                }
                Action::Dispatch { view_id, order } => {
                    assert!(!self.answered.contains(&view_id), "an answered view was sent again");
                    assert!(self.workers.contains_key(&order.worker), "sent to a worker that is gone");
                    let mixed =
                        order.sources.iter().find(|source| source.id.version != order.sources[0].id.version);
                    assert!(mixed.is_none(), "a frame of {:?} from {mixed:?}", order.state);
                    self.orders.insert(view_id, *order);
                }
                Action::Deliver { view_id, attempt, expected } => {
                    assert_eq!(self.orders[&view_id].attempt, attempt, "another attempt's frame");
                    self.delivered.insert(view_id, expected);
                }
                Action::Refuse { view_id, fault } => {
                    assert!(!self.answered.contains(&view_id), "an answered view was refused");
                    assert!(!self.refused.iter().any(|(t, _)| *t == view_id), "refused twice");
                    self.orders.remove(&view_id);
                    self.refused.push((view_id, fault));
                }
            }
        }
    }

    pub(super) fn join(&mut self, name: &str) -> WorkerId {
        let id = WorkerId(self.next);
        self.next += 1;
        let worker = SimWorker { name: name.to_owned(), obedient: true, ..SimWorker::default() };
        self.workers.insert(id, worker);
        let hello = Hello {
            public_address: None,
            name: name.to_owned(),
            pid: id.0 as u32,
            address: format!("http://{name}"),
            device: "device".to_owned(),
            cores: 1,
        };
        self.step(Event::Joined { worker: id, hello });
        id
    }

    /// Ends a worker's process.
    pub(super) fn leave(&mut self, id: WorkerId) {
        self.workers.remove(&id);
        self.orders.retain(|_, order| order.worker != id);
        self.step(Event::Left { worker: id });
    }

    pub(super) fn report(&mut self, id: WorkerId) {
        let Some(worker) = self.workers.get_mut(&id) else { return };
        if let Some(assignment) = worker.assignments.last().filter(|_| worker.obedient) {
            worker.report.applied = assignment.sequence;
        }
        // It holds its prefetch list at once, and drops refinements that are no longer in it.
        let rig = self.core.set().rig;
        if let Some(assignment) = worker.assignments.last().filter(|_| worker.obedient) {
            let prefetch: BTreeSet<SampleId> = assignment.prefetch.iter().map(|source| source.id).collect();
            let rendered = assignment.prefetch.iter().filter(|source| source.addresses.is_empty());
            let rendered = rendered.filter(|source| !worker.report.held.contains(&source.id)).count();
            worker.report.samples_rendered += rendered as u64;
            let stays = |id: &SampleId| prefetch.contains(id) || rig.level(id.camera) == Some(0);
            worker.report.held.retain(|id| stays(id) || !worker.prefetch.contains(id));
            let report = &mut worker.report;
            for source in &assignment.prefetch {
                let before = match report.held.contains(&source.id) {
                    true => report.faces(source.id),
                    false => FaceMask::NONE,
                };
                let is_new = !worker.prefetch.contains(&source.id) && before.is_empty();
                if is_new || !before.is_empty() {
                    report.partial.retain(|(id, _)| *id != source.id);
                    let faces = before.union(source.faces);
                    report.partial.extend((faces != FaceMask::ALL).then_some((source.id, faces)));
                }
            }
            report.held.extend(prefetch.difference(&worker.prefetch));
            report.held.retain(|id| id.version >= assignment.kept_from);
            worker.prefetch = prefetch;
        }
        worker.report.sample_ms = Some(self.direct_ms);
        worker.report.direct_ms = Some(self.direct_ms);
        worker.report.view_ms = Some(self.view_ms);
        let report = worker.report.clone();
        self.step(Event::Reported { worker: id, report });
    }

    /// Requests a view that is pinned to an epoch and a plan.
    pub(super) fn pin(&mut self, epoch: u64, plan: Plan) -> ViewId {
        let view_id = ViewId(self.next);
        self.next += 1;
        let set = set_info();
        let (scene, device) = (set.scene, String::new());
        let view = Box::new(View {
            camera: Camera::look_at(DVec3::new(3.0, 30.0, 4.0), DVec3::new(2.0, 0.0, 2.0)),
            width: 20,
            height: 15,
            outputs: Outputs::COLOR,
            plan: PlanRequest::from_samples(),
            pin: Some(Provenance {
                scene,
                state: SceneState::of_epoch(epoch),
                plan,
                specification: None,
                device,
                history: false,
            }),
            flow_to: None,
            rays: None,
        });
        let client = "a client".into();
        self.step(Event::Requested { view_id, client, view, deadline: None, last: None });
        view_id
    }

    pub(super) fn report_all(&mut self) {
        for id in self.workers.keys().copied().collect::<Vec<_>>() {
            self.report(id);
        }
    }

    pub(super) fn ask(&mut self, direct: bool) -> ViewId {
        self.ask_with(direct, None)
    }

    pub(super) fn ask_with(&mut self, direct: bool, deadline: Option<Duration>) -> ViewId {
        let plan = match direct {
            true => PlanRequest { direct, ..PlanRequest::default() },
            false => PlanRequest::from_samples(),
        };
        self.ask_by(plan, deadline)
    }

    pub(super) fn ask_for(&mut self, plan: PlanRequest) -> ViewId {
        self.ask_by(plan, None)
    }

    fn ask_by(&mut self, plan: PlanRequest, deadline: Option<Duration>) -> ViewId {
        let camera = Camera::look_at(DVec3::new(3.0, 30.0, 4.0), DVec3::new(2.0, 0.0, 2.0));
        self.ask_from(camera, plan, deadline)
    }

    pub(super) fn ask_from(
        &mut self,
        camera: Camera,
        plan: PlanRequest,
        deadline: Option<Duration>,
    ) -> ViewId {
        let view_id = ViewId(self.next);
        self.next += 1;
        let view = Box::new(View::new(camera, [200, 150], plan));
        let client = "a client".into();
        self.step(Event::Requested { view_id, client, view, deadline, last: None });
        view_id
    }

    pub(super) fn answer(&mut self, view_id: ViewId) {
        self.answer_with(view_id, 0);
    }

    /// Answers a view with a number of uncovered pixels.
    pub(super) fn answer_with(&mut self, view_id: ViewId, uncovered: u64) {
        self.answer_so(view_id, uncovered, 1.0);
    }

    /// Answers a view after a rendering time.
    pub(super) fn answer_taking(&mut self, view_id: ViewId, ms: f64) {
        self.answer_so(view_id, 0, ms);
    }

    fn answer_so(&mut self, view_id: ViewId, uncovered: u64, ms: f64) {
        let Some(order) = self.orders.remove(&view_id) else { return };
        if let Some(worker) = self.workers.get_mut(&order.worker) {
            match &order.plan {
                argus_scene::Plan::Direct { .. } => {
                    worker.report.views_direct += 1;
                    worker.report.sampling_busy_ms += self.direct_ms;
                }
                argus_scene::Plan::Warp(argus_scene::Warp { samples, .. }) => {
                    worker.report.views_composed += 1;
                    worker.report.compositing_busy_ms += self.view_ms;
                    let held: BTreeSet<SampleId> =
                        worker.report.held.iter().chain(samples).copied().collect();
                    worker.report.held = held.into_iter().collect();
                }
            }
        }
        self.answered.insert(view_id);
        self.step(Event::Answered {
            view_id,
            attempt: order.attempt,
            uncovered: Some(uncovered),
            ms: Some(ms),
            fell_short: false,
        });
    }

    pub(super) fn answer_all(&mut self) {
        while let Some(view_id) = self.orders.keys().next().copied() {
            self.answer(view_id);
        }
    }

    /// One second of demand, spread over four reports.
    pub(super) fn second(&mut self, views: usize, direct: usize) {
        for quarter in 0..4 {
            let share = |n: usize| n * (quarter + 1) / 4 - n * quarter / 4;
            (0..share(views)).for_each(|_| _ = self.ask(false));
            (0..share(direct)).for_each(|_| _ = self.ask(true));
            self.answer_all();
            self.now = self.now.after(Duration::from_millis(250));
            self.report_all();
            self.step(Event::Tick);
        }
    }

    /// The first sampler.
    pub(super) fn sampler(&self) -> WorkerId {
        let name = self.core.first_sampler().unwrap();
        *self.workers.iter().find(|(_, w)| w.name == name).map(|(id, _)| id).unwrap()
    }

    pub(super) fn address(&self, id: WorkerId) -> String {
        format!("http://{}", self.workers[&id].name)
    }

    pub(super) fn roles(&self) -> (u32, u32) {
        let status = self.core.status();
        (status.samplers, status.compositors)
    }

    pub(super) fn roles_changed(&self) -> u64 {
        self.core.status().counts().roles_changed
    }
}
