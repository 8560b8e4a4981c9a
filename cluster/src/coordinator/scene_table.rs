//! All scenes of a service: which of them a request concerns, and which a worker belongs to.
//!
//! Each scene has a core of its own. A worker belongs to one scene at a time. When it moves, it finishes its views, its stream is ended,
//! and it joins again as it does after a loss of its coordinator; then it is given to the other scene. What moves when is decided by
//! [`SceneBalance`].

use std::collections::HashMap;
use std::sync::Arc;
use std::time::Duration;

use argus_proto::status::invalid;
use argus_proto::{Fault, SCENE_METADATA, v1};
use argus_scene::{InvalidField, SceneHash};
use parking_lot::Mutex;
use tokio::time::Instant;
use tonic::Status;
use tonic::metadata::MetadataMap;
use tracing::info;

use super::served_scene::ServedScene;
use super::shared_core::{JoinedWorker, SharedCore};
use crate::core::{Event, Hello, SceneBalance, SceneLoad, SceneMove, Uptime, scene_for_newcomer};
use crate::leadership::HeldLease;

/// Time between two looks at the loads of the scenes.
const LOOK: Duration = Duration::from_millis(250);

/// Time in which a worker that left a scene joins the other one. Later it is placed like any other.
const REJOIN_WITHIN: Duration = Duration::from_secs(15);

/// Time in which the workers of an earlier leader return, each to the scene that it has open.
const RETURN_WITHIN: Duration = Duration::from_secs(3);

/// All scenes of a service, and the lease of their coordinator.
pub(super) struct SceneTable {
    /// At least one.
    scenes: Vec<ServedScene>,
    /// The lease, while this coordinator holds it.
    pub(super) lease: Mutex<Option<HeldLease>>,
    began: Instant,
    state: Mutex<State>,
}

struct State {
    balance: SceneBalance,
    /// Workers that go to another scene, by their names.
    on_the_way: HashMap<String, OnTheWay>,
    /// Until when workers of an earlier leader return.
    returning_until: Instant,
    looked: Instant,
}

/// A worker's way from one scene to another.
struct OnTheWay {
    moves: SceneMove,
    /// Until when it is expected to join.
    until: Instant,
}

impl SceneTable {
    /// The table of these scenes, the first of which is that of requests that name none.
    pub(super) fn new(scenes: Vec<ServedScene>) -> Self {
        let now = Instant::now();
        let balance = SceneBalance::new(scenes.len());
        let state = State { balance, on_the_way: HashMap::new(), returning_until: now, looked: now };
        Self { scenes, lease: Mutex::new(None), began: now, state: Mutex::new(state) }
    }

    /// All scenes, at least one.
    pub(super) fn all(&self) -> &[ServedScene] {
        &self.scenes
    }

    /// The scene of requests that name none.
    pub(super) fn first(&self) -> &ServedScene {
        &self.scenes[0]
    }

    /// The scene that a request's metadata name, or else the first one.
    ///
    /// # Errors
    /// The field `scene`, if there is none of that name.
    pub(super) fn of(&self, metadata: &MetadataMap) -> Result<&ServedScene, Status> {
        let Some(value) = metadata.get(SCENE_METADATA) else { return Ok(self.first()) };
        let name = value.to_str().unwrap_or_default();
        self.scenes.iter().find(|scene| scene.name == name).ok_or_else(|| {
            let names: Vec<&str> = self.scenes.iter().map(|scene| scene.name.as_str()).collect();
            let names = names.join(", ");
            let reason =
                format!("this service has no scene {name:?}; name one of {names}, or none for the first");
            invalid(InvalidField::new("scene", reason))
        })
    }

    /// The scene with this hash.
    pub(super) fn by_hash(&self, hash: SceneHash) -> Option<&ServedScene> {
        self.scenes.iter().find(|scene| scene.shared.service.scene.hash == hash)
    }

    /// Adds a worker that joined to the scene that needs it most. `held` is the scene that it has open.
    ///
    /// # Errors
    /// [`Fault::Unavailable`] on standby.
    pub(super) fn join(
        &self,
        hello: Hello,
        held: Option<SceneHash>,
    ) -> Result<(Arc<SharedCore>, JoinedWorker), Fault> {
        let chosen = self.place(&hello.name, held);
        for (_, scene) in self.scenes.iter().enumerate().filter(|(at, _)| *at != chosen) {
            scene.shared.remove_named(&hello.name);
        }
        let shared = self.scenes[chosen].shared.clone();
        let joined = shared.join(hello, held == Some(shared.service.scene.hash))?;
        Ok((shared, joined))
    }

    /// The index of the scene that a worker joins.
    fn place(&self, name: &str, held: Option<SceneHash>) -> usize {
        if self.scenes.len() == 1 {
            return 0;
        }
        let (now, mut state) = (Instant::now(), self.state.lock());
        if let Some(way) = state.on_the_way.remove(name)
            && now < way.until
        {
            return way.moves.to;
        }
        let has_open = |scene: &ServedScene| held == Some(scene.shared.service.scene.hash);
        let held = self.scenes.iter().position(has_open);
        scene_for_newcomer(&self.loads(&mut state, now), held, now < state.returning_until)
    }

    /// The loads of all scenes, with the workers that are on their way.
    fn loads(&self, state: &mut State, now: Instant) -> Vec<SceneLoad> {
        state.on_the_way.retain(|name, way| {
            // Its last views may take long.
            if self.scenes[way.moves.from].shared.is_leaving(name) {
                way.until = now + REJOIN_WITHIN;
            }
            now < way.until
        });
        let coming = |to: usize| state.on_the_way.values().filter(|way| way.moves.to == to).count();
        let load = |(at, scene): (usize, &ServedScene)| {
            let load = scene.shared.load();
            SceneLoad { workers: load.workers + coming(at), ..load }
        };
        self.scenes.iter().enumerate().map(load).collect()
    }

    /// Moves a worker to another scene, if that is due. To be called some times a second.
    pub(super) fn balance(&self) {
        if self.scenes.len() == 1 || !self.leads() {
            return;
        }
        let (now, mut state) = (Instant::now(), self.state.lock());
        if now.saturating_duration_since(state.looked) < LOOK {
            return;
        }
        state.looked = now;
        let loads = self.loads(&mut state, now);
        let uptime = Uptime(now.saturating_duration_since(self.began));
        let Some(moves) = state.balance.step(&loads, uptime) else { return };
        let (from, to) = (&self.scenes[moves.from], &self.scenes[moves.to].name);
        let Some(worker) = from.shared.move_one_out() else { return };
        info!(worker, from = from.name, to, "worker moves to another scene");
        state.on_the_way.insert(worker, OnTheWay { moves, until: now + REJOIN_WITHIN });
    }

    /// The status of a scene, with a row for each scene of the service.
    pub(super) fn status(&self, scene: &ServedScene) -> v1::StatusResponse {
        let rows = self.scenes.iter().map(|scene| scene.shared.scene_status(&scene.name));
        v1::StatusResponse { scenes: rows.collect(), ..scene.shared.status() }
    }

    /// Steps the cores of all scenes.
    pub(super) fn step_all(&self, event: &Event) {
        self.scenes.iter().for_each(|scene| scene.shared.step(event.clone()));
    }

    /// Begins a leadership of all scenes, as [`SharedCore::lead`]. `expected` is the probable number of all workers.
    pub(super) fn lead(&self, term: u64, until: Option<Instant>, expected: usize) {
        self.state.lock().returning_until = Instant::now() + RETURN_WITHIN;
        let each = expected.div_ceil(self.scenes.len());
        self.scenes.iter().for_each(|scene| scene.shared.lead(term, until, each));
    }

    /// Extends the leadership to the end of a renewed lease.
    pub(super) fn lead_until(&self, until: Option<Instant>) {
        self.scenes.iter().for_each(|scene| scene.shared.lead_until(until));
    }

    /// Whether this coordinator leads. A core that steps down by itself ends the leadership of all scenes.
    pub(super) fn leads(&self) -> bool {
        self.scenes.iter().all(|scene| scene.shared.leads())
    }

    /// Ends the leadership of all scenes.
    pub(super) fn step_down(&self, reason: &str) {
        self.scenes.iter().for_each(|scene| scene.shared.step_down(reason));
    }

    /// Sets the leader's address, which refusals name.
    pub(super) fn stand_by(&self, leader: Option<&str>) {
        self.scenes.iter().for_each(|scene| scene.shared.stand_by(leader.map(str::to_owned)));
    }

    /// Names of the workers of all scenes.
    pub(super) fn workers(&self) -> Vec<String> {
        self.scenes.iter().flat_map(|scene| scene.shared.workers()).collect()
    }

    /// Number of views of all scenes that wait or are in work.
    pub(super) fn views_in_flight(&self) -> usize {
        self.scenes.iter().map(|scene| scene.shared.read(|core| core.views_in_flight())).sum()
    }
}
