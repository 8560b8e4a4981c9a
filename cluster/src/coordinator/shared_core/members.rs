//! The workers of a scene: how they join, report and leave, and which of them goes to another scene.

use std::sync::Arc;

use argus_proto::{Fault, v1};
use argus_scene::revisions::MOST_REVISIONS;
use tokio::sync::mpsc::{Receiver, channel};
use tokio_util::sync::CancellationToken;
use tonic::Status;
use tracing::info;

use super::{MOST_ASSIGNMENTS, RedirectTarget, SharedCore, WorkerStream, stands_by};
use crate::core::{Event, Hello, Report, SceneLoad, WorkerId};
use crate::sealed::SealKey;
use crate::wire;

/// A worker that joined: its id, its assignments, and the token that ends its stream.
pub(in crate::coordinator) struct JoinedWorker {
    pub(in crate::coordinator) worker: WorkerId,
    pub(in crate::coordinator) assignments: Receiver<Result<v1::Assignment, Status>>,
    pub(in crate::coordinator) expelled: CancellationToken,
}

impl SharedCore {
    /// Names of the workers that have joined.
    pub(in crate::coordinator) fn workers(&self) -> Vec<String> {
        self.state.lock().streams.values().map(|stream| stream.hello.name.clone()).collect()
    }

    /// Adds a worker that joined. `has_it_open`: it has this scene open, so that its costs and samples are of this scene.
    ///
    /// # Errors
    /// [`Fault::Unavailable`] on standby.
    pub(in crate::coordinator) fn join(
        &self,
        hello: Hello,
        has_it_open: bool,
    ) -> Result<JoinedWorker, Fault> {
        let (assignments, receiver) = channel(MOST_ASSIGNMENTS + MOST_REVISIONS);
        let expelled = self.closing.child_token();
        let mut state = self.state.lock();
        if state.leading.is_none() {
            return Err(stands_by(state.leader.as_deref()));
        }
        let worker = WorkerId(state.next_id);
        state.next_id += 1;
        info!(worker = hello.name, address = hello.address, device = hello.device, "worker joined");
        // Without a key, no client is redirected there, and frames are relayed.
        let key = hello.public_address.is_some().then(SealKey::drawn).flatten();
        let new_target =
            |key| RedirectTarget { key, serial: 0, in_flight: Arc::default(), alive: Arc::default() };
        let redirect_target = key.map(new_target);
        // Before its first order.
        for transforms in state.movers.kept() {
            let _ = assignments.try_send(Ok(wire::moved(&transforms, state.leading.map_or(0, |l| l.term))));
        }
        let stream = WorkerStream {
            hello: hello.clone(),
            redirect_target,
            assignments,
            expelled: expelled.clone(),
            had_it_open: has_it_open,
            moves_out: false,
        };
        state.streams.insert(worker, stream);
        self.step_locked(&mut state, Event::Joined { worker, hello });
        Ok(JoinedWorker { worker, assignments: receiver, expelled })
    }

    /// Removes a worker whose stream ended.
    pub(in crate::coordinator) fn leave(&self, worker: WorkerId) {
        let mut state = self.state.lock();
        if let Some(stream) = state.streams.remove(&worker) {
            info!(worker = stream.hello.name, "worker left");
            self.channels.forget(&stream.hello.address);
        }
        self.step_locked(&mut state, Event::Left { worker });
    }

    /// Processes a worker's report. Returns whether it has to leave now, since it goes to another scene and has finished its views.
    pub(in crate::coordinator) fn report(&self, worker: WorkerId, report: Report) -> bool {
        let mut state = self.state.lock();
        let stream = state.streams.get(&worker);
        let moves_out = stream.is_some_and(|stream| stream.moves_out);
        // Until its first assignment here is in effect, a worker reports what it knows of another scene.
        let is_of_this_scene = report.applied > 0 || stream.is_none_or(|stream| stream.had_it_open);
        let report = if is_of_this_scene { report } else { report.of_process() };
        let leaving = report.leaving || moves_out;
        self.step_locked(&mut state, Event::Reported { worker, report: Report { leaving, ..report } });
        // However long they take: in a scene without another worker they would begin anew at its next turn. All views end in time.
        moves_out && state.core.views_at(worker) == 0
    }

    /// Lets one worker finish its views and leave: the one that is least busy, and of these the last that came. Returns its name.
    pub(in crate::coordinator) fn move_one_out(&self) -> Option<String> {
        let mut state = self.state.lock();
        let stay = state.streams.iter().filter(|(_, stream)| !stream.moves_out);
        let busy = |id: WorkerId| (state.core.views_at(id), std::cmp::Reverse(id));
        let worker = stay.map(|(id, _)| *id).min_by_key(|id| busy(*id))?;
        state.moved += 1;
        let stream = state.streams.get_mut(&worker)?;
        stream.moves_out = true;
        let name = stream.hello.name.clone();
        // At once, and not with its next report, so that it gets no further view.
        if let Some(report) = state.core.last_report(worker).cloned() {
            let report = Report { leaving: true, ..report };
            self.step_locked(&mut state, Event::Reported { worker, report });
        }
        Some(name)
    }

    /// Whether the worker with this name finishes its views here, to go to another scene.
    pub(in crate::coordinator) fn is_leaving(&self, name: &str) -> bool {
        self.state.lock().streams.values().any(|stream| stream.moves_out && stream.hello.name == name)
    }

    /// Removes a worker that has joined another scene while its stream here has not ended.
    pub(in crate::coordinator) fn remove_named(&self, name: &str) {
        let mut state = self.state.lock();
        let found = state.streams.iter().find(|(_, stream)| stream.hello.name == name);
        let Some(worker) = found.map(|(worker, _)| *worker) else { return };
        if let Some(stream) = state.streams.remove(&worker) {
            stream.expelled.cancel();
        }
        self.step_locked(&mut state, Event::Left { worker });
    }

    /// What is asked of the scene since the last call, and who does it.
    pub(in crate::coordinator) fn load(&self) -> SceneLoad {
        let mut state = self.state.lock();
        let [requested, before] = state.requested;
        state.requested[1] = requested;
        SceneLoad {
            workers: state.streams.values().filter(|stream| !stream.moves_out).count(),
            answers: state.core.can_answer(),
            asked: state.core.asked(),
            is_viewed: requested != before || state.core.views_in_flight() > 0,
            answered: state.core.views_answered(),
        }
    }

    /// The scene's row in the status of its service.
    pub(in crate::coordinator) fn scene_status(&self, name: &str) -> v1::SceneStatus {
        let state = self.state.lock();
        let mut workers: Vec<_> = state.streams.iter().collect();
        workers.sort_by_key(|(id, _)| **id);
        v1::SceneStatus {
            name: name.to_owned(),
            scene: Some(wire::scene_ref(&self.service.scene)),
            workers: workers.into_iter().map(|(_, stream)| stream.hello.name.clone()).collect(),
            answering: state.core.answering() as u32,
            asked: state.core.asked(),
            views_in_flight: state.core.views_in_flight() as u64,
            sessions_open: state.core.sessions_open() as u64,
            workers_moved: state.moved,
        }
    }
}
