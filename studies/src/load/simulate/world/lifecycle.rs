//! Workers start, die, pause and leave.

use argus_cluster::core::{Event, Hello, WorkerId};
use rand::Rng;

use super::World;
use super::event_queue::SimEvent;
use crate::load::simulate::work::Message;

impl World {
    /// Starts a worker's process, which joins.
    pub(in crate::load::simulate) fn start(&mut self, slot: usize) {
        self.workers[slot].alive = true;
        self.join(slot);
        let phase = self.rng.random_range(0..self.report_every.max(1));
        let life = self.workers[slot].life;
        self.after(phase, SimEvent::Report { slot, life });
    }

    pub(super) fn join(&mut self, slot: usize) {
        let id = WorkerId(self.next_id);
        self.next_id += 1;
        let worker = &mut self.workers[slot];
        (worker.id, worker.assignment, worker.applied) = (Some(id), None, 0);
        self.slots.insert(id, slot);
        let hello = Hello {
            public_address: None,
            name: worker.name.clone(),
            pid: slot as u32,
            address: format!("http://w{slot}"),
            device: "simulated".to_owned(),
            cores: 1,
        };
        let latency = self.latency();
        self.after(latency, SimEvent::ToCoordinator(Box::new(Event::Joined { worker: id, hello })));
    }

    /// Kills a worker's process; its connections break.
    pub(in crate::load::simulate) fn kill(&mut self, slot: usize) {
        let id = self.workers[slot].id.take();
        self.workers[slot].end();
        self.while_paused.remove(&slot);
        let latency = self.latency();
        if let Some(worker) = id {
            self.slots.remove(&worker);
            self.after(latency, SimEvent::ToCoordinator(Box::new(Event::Left { worker })));
        }
        for child in 0..self.workers.len() {
            let fetches = self.workers[child].fetches.iter();
            let broken = fetches.filter(|(_, fetch)| fetch.source() == Some(slot));
            for id in broken.map(|(id, _)| *id).collect::<Vec<_>>() {
                self.tell(child, Message::NoSample { id, from: slot });
            }
        }
    }

    /// Pauses a worker, as SIGSTOP does.
    #[cfg(test)]
    pub(in crate::load::simulate) fn pause(&mut self, slot: usize) {
        self.workers[slot].paused = true;
    }

    /// Resumes a paused worker.
    #[cfg(test)]
    pub(in crate::load::simulate) fn resume(&mut self, slot: usize) {
        self.workers[slot].paused = false;
        let (messages, tasks) = self.while_paused.remove(&slot).unwrap_or_default();
        messages.into_iter().for_each(|message| self.receive(slot, message));
        tasks.into_iter().for_each(|task| self.done(task));
        if self.workers[slot].alive && self.workers[slot].id.is_none() {
            self.join(slot);
        }
    }

    /// A worker announces that it leaves, and ends after its work is done.
    #[cfg(test)]
    pub(in crate::load::simulate) fn leave(&mut self, slot: usize) {
        self.workers[slot].leaving = true;
        self.report(slot);
    }
}
