//! How simulated workers handle messages, like `argus_cluster::worker`.

use std::collections::{BTreeSet, HashMap};

use argus_cluster::core::{Assignment, Event, Order, ViewId};
use argus_cluster::worker::policy::{self, ANNOUNCED, Need, PAUSE, Seek, Serve};
use argus_proto::v1;
use argus_scene::SampleId;

use super::event_queue::SimEvent;
use super::{WORKERS, World};
use crate::load::simulate::work::{Attempt, Message, Task};
use crate::load::simulate::worker::{Busy, Fetch, Rendering, Waiting};
use crate::load::simulate::{Parameters, nanos};

impl World {
    pub(super) fn report(&mut self, slot: usize) {
        let worker = &mut self.workers[slot];
        let Some(id) = worker.id.filter(|_| worker.alive && worker.assignment.is_some()) else { return };
        let report = worker.report();
        let done = worker.leaving
            && worker.busy.is_none()
            && worker.sending == 0
            && worker.views.is_empty()
            && worker.direct.is_empty()
            && worker.waiting.is_empty();
        let latency = self.latency();
        self.after(latency, SimEvent::ToCoordinator(Box::new(Event::Reported { worker: id, report })));
        // It ends once the coordinator knows, so that no order is on its way to it.
        let name = &self.workers[slot].name;
        if done && self.core.status().workers.iter().any(|w| w.id == *name && w.role() == v1::Role::Idle) {
            self.kill(slot);
        }
    }

    pub(super) fn receive(&mut self, slot: usize, message: Message) {
        match message {
            Message::Order(view_id, order) => self.order(slot, view_id, *order),
            Message::Assignment(assignment) => self.assigned(slot, assignment),
            Message::Subscribe { id, from, prefetch } => self.subscribed(slot, id, from, prefetch),
            Message::Sample { id } => {
                if self.workers[slot].fetches.contains_key(&id) {
                    let (life, ms) = (self.workers[slot].life, self.parameters.unpack_ms);
                    self.begin_beside(slot, ms, Task::Unpack { slot, life, id });
                }
            }
            Message::NoSample { id, from } => self.sample_missing(slot, id, from),
        }
    }

    fn order(&mut self, slot: usize, view_id: ViewId, order: Order) {
        let view = Attempt { view_id, attempt: order.attempt };
        if order.sources.is_empty() {
            self.workers[slot].direct.push_back(view);
            return self.kick(slot);
        }
        let mut missing = BTreeSet::new();
        for source in &order.sources {
            let id = source.id;
            let worker = &mut self.workers[slot];
            if worker.held.contains(&id) {
                continue;
            }
            missing.insert(id);
            if worker.fetches.get(&id).is_some_and(|fetch| fetch.urgent) {
                continue;
            }
            // A fetch for later views may wait for another worker; this one is requested now.
            self.fetch(slot, id, &source.addresses, true);
        }
        let samples: Vec<SampleId> = order.sources.iter().map(|source| source.id).collect();
        self.tally.waited_for_samples += u64::from(!missing.is_empty());
        let worker = &mut self.workers[slot];
        if missing.is_empty() {
            worker.views.push_back((view, samples));
        } else {
            worker.waiting.insert(view.view_id, Waiting { view, samples, missing });
        }
        self.kick(slot);
    }

    fn assigned(&mut self, slot: usize, assignment: Assignment) {
        let rig = self.core.set().rig;
        let worker = &mut self.workers[slot];
        let wanted: HashMap<SampleId, &Vec<String>> =
            assignment.prefetch.iter().map(|source| (source.id, &source.addresses)).collect();
        let before = worker.assignment.take().map(|before| before.prefetch).unwrap_or_default();
        let gone = before.iter().map(|source| source.id).filter(|id| !wanted.contains_key(id));
        for id in gone.filter(|id| rig.level(id.camera) != Some(0)) {
            worker.held.remove(&id);
        }
        worker.held.retain(|id| id.version >= assignment.kept_from);
        worker.taken_up.retain(|id| worker.held.contains(id));
        worker.packed.retain(|id| worker.held.contains(id));
        let fetched = worker.fetches.extract_if(|id, fetch| !fetch.urgent && !wanted.contains_key(id));
        let mut dropped: Vec<SampleId> = fetched.map(|(id, _)| id).collect();
        dropped.extend(worker.prefetches.iter().filter(|id| !wanted.contains_key(id)));
        worker.prefetches.retain(|id| wanted.contains_key(id));
        let mut to_fetch = Vec::new();
        for source in &assignment.prefetch {
            let id = source.id;
            if let Some(fetch) = worker.fetches.get_mut(&id).filter(|fetch| !fetch.urgent) {
                fetch.then = others(slot, &source.addresses);
            }
            if worker.held.contains(&id) || worker.fetches.contains_key(&id) || worker.renders(id, true) {
                continue;
            }
            match source.addresses.is_empty() {
                true => worker.prefetches.push_back(id),
                false => to_fetch.push((id, source.addresses.clone())),
            }
        }
        let hangs = |source: &usize| assignment.suspected.contains(&format!("http://w{source}"));
        let awaited = worker.fetches.iter().filter_map(|(id, fetch)| Some((*id, fetch.source()?)));
        let in_vain: Vec<(SampleId, usize)> = awaited.filter(|(_, source)| hangs(source)).collect();
        worker.assignment = Some(assignment);
        for (id, source) in in_vain {
            self.sample_missing(slot, id, source);
        }
        for (id, addresses) in to_fetch {
            self.fetch(slot, id, &addresses, false);
        }
        for id in dropped {
            self.unless_it_comes(slot, id);
        }
        // Reports the applied assignment at once.
        self.report(slot);
        self.kick(slot);
    }

    fn fetch(&mut self, slot: usize, id: SampleId, addresses: &[String], urgent: bool) {
        let sources = others(slot, addresses);
        let fetch = Fetch { then: sources.clone(), sources, asked: 0, urgent };
        self.workers[slot].fetches.insert(id, fetch);
        self.seek(slot, id);
    }

    /// Requests a sample where [`policy::seek`] says.
    pub(super) fn seek(&mut self, slot: usize, id: SampleId) {
        let worker = &mut self.workers[slot];
        let (life, feeds_others) = (worker.life, worker.samples());
        let Some(fetch) = worker.fetches.get(&id) else { return };
        let need = match fetch.urgent {
            true => Need::View { dispensable: false },
            false => Need::Prefetch { feeds_others },
        };
        match policy::seek(need, fetch.asked, fetch.sources.len()) {
            Seek::Ask(next) => {
                let (source, prefetch) = (fetch.sources[next], !fetch.urgent);
                match self.workers[source].alive {
                    true => self.tell(source, Message::Subscribe { id, from: slot, prefetch }),
                    false => self.tell(slot, Message::NoSample { id, from: source }),
                }
            }
            Seek::Render { prefetch } => {
                worker.fetches.remove(&id);
                worker.render(id, prefetch);
                self.kick(slot);
            }
            Seek::AskAgain => self.after(nanos(PAUSE), SimEvent::AskAgain { slot, life, id }),
            Seek::GiveUp => {}
        }
    }

    fn sample_missing(&mut self, slot: usize, id: SampleId, from: usize) {
        let Some(fetch) = self.workers[slot].fetches.get_mut(&id) else { return };
        if fetch.source() == Some(from) {
            fetch.asked += 1;
            self.seek(slot, id);
        }
    }

    fn subscribed(&mut self, slot: usize, id: SampleId, from: usize, prefetch: bool) {
        let worker = &mut self.workers[slot];
        if worker.held.contains(&id) {
            return self.pack(slot, id, from);
        }
        worker.children.entry(id).or_default().push(from);
        if policy::serve(worker.samples(), prefetch, false) == Serve::Render {
            worker.render(id, false);
            return self.kick(slot);
        }
        if worker.fetches.contains_key(&id) || worker.renders(id, prefetch) {
            return;
        }
        let life = worker.life;
        self.after(nanos(ANNOUNCED), SimEvent::Announced { slot, life, id });
    }

    /// Called some time after a sample was requested here: by now it should be on its way.
    pub(super) fn announced(&mut self, slot: usize, id: SampleId) {
        let worker = &mut self.workers[slot];
        let comes = worker.held.contains(&id) || worker.fetches.contains_key(&id) || worker.renders(id, true);
        if !comes
            && worker.children.contains_key(&id)
            && policy::serve(worker.samples(), true, true) == Serve::Render
        {
            worker.render(id, false);
            return self.kick(slot);
        }
        self.unless_it_comes(slot, id);
    }

    /// Tells the workers that wait here for a sample if it is not on its way.
    pub(super) fn unless_it_comes(&mut self, slot: usize, id: SampleId) {
        let worker = &mut self.workers[slot];
        if worker.held.contains(&id) || worker.fetches.contains_key(&id) || worker.renders(id, true) {
            return;
        }
        for child in worker.children.remove(&id).unwrap_or_default() {
            self.tell(child, Message::NoSample { id, from: slot });
        }
    }

    /// Sends a sample to another worker, packing it first if needed.
    fn pack(&mut self, slot: usize, id: SampleId, to: usize) {
        let worker = &mut self.workers[slot];
        if worker.packed.contains(&id) {
            return self.pass_on(slot, id, to);
        }
        let receivers = worker.packing.entry(id).or_default();
        receivers.push(to);
        if receivers.len() == 1 {
            let (life, ms) = (worker.life, self.parameters.pack_ms);
            self.begin_beside(slot, ms, Task::Pack { slot, life, id });
        }
    }

    /// Sends a packed sample.
    pub(super) fn pass_on(&mut self, slot: usize, id: SampleId, to: usize) {
        self.tally.samples_sent += 1;
        let bytes = self.parameters.sample_bytes;
        let at = self.send(WORKERS + slot, WORKERS + to, bytes);
        let life = self.workers[to].life;
        self.at(at, SimEvent::ToWorker { slot: to, life, message: Message::Sample { id } });
    }

    /// Adds a sample to a worker, and gives it to the views and workers that wait for it.
    pub(super) fn gained(&mut self, slot: usize, id: SampleId) {
        let worker = &mut self.workers[slot];
        worker.fetches.remove(&id);
        worker.held.insert(id);
        let children = worker.children.remove(&id).unwrap_or_default();
        let mut ready = Vec::new();
        for waiting in worker.waiting.values_mut().filter(|waiting| waiting.samples.contains(&id)) {
            waiting.missing.remove(&id);
            if waiting.missing.is_empty() {
                ready.push(waiting.view.view_id);
            }
        }
        for view_id in ready {
            if let Some(waiting) = worker.waiting.remove(&view_id) {
                worker.views.push_back((waiting.view, waiting.samples));
            }
        }
        for child in children {
            self.pack(slot, id, child);
        }
        self.report(slot);
        self.kick(slot);
    }

    /// Starts the render thread's next work if it is idle.
    pub(super) fn kick(&mut self, slot: usize) {
        let worker = &mut self.workers[slot];
        if worker.busy.is_some() {
            return;
        }
        let Parameters { sample_ms, view_ms, direct_ms, hold_ms, sample_pooled, direct_pooled, .. } =
            self.parameters;
        let Some((rendering, fresh)) = worker.next() else { return };
        let (cost_ms, pooled) = match &rendering {
            Rendering::Sample(_) => (sample_ms, sample_pooled),
            Rendering::Direct(views) => (direct_ms * views.len() as f64, direct_pooled),
            Rendering::Views(views) => (view_ms * views.len() as f64, 0.0),
        };
        let ms = cost_ms + hold_ms * fresh as f64;
        let (life, slowness) = (worker.life, worker.slowness);
        // One thread also does the part that is not pooled, so the total time stays the same.
        let threads = if pooled > 0.0 { self.parameters.machines.cores() } else { 1 };
        let each_ms = cost_ms * pooled / f64::from(threads);
        worker.busy = Some(Busy { rendering, since: self.now, cost_share: cost_ms / ms, threads });
        for thread in 0..threads {
            let ms = if thread == 0 { ms - cost_ms * pooled + each_ms } else { each_ms };
            self.begin(WORKERS + slot, ms * slowness, Task::Render { slot, life });
        }
    }

    /// Ends one thread's part of the rendering, and the rendering after the last one.
    pub(super) fn rendered(&mut self, slot: usize) {
        if let Some(busy) = &mut self.workers[slot].busy
            && busy.threads > 1
        {
            busy.threads -= 1;
            return;
        }
        let Some(Busy { rendering, since, cost_share, .. }) = self.workers[slot].busy.take() else { return };
        let ms = (self.now - since) as f64 * 1e-6;
        self.workers[slot].measure(&rendering, ms, ms * cost_share);
        let life = self.workers[slot].life;
        match rendering {
            Rendering::Sample(id) => self.gained(slot, id),
            Rendering::Views(views) | Rendering::Direct(views) => {
                let ms = self.parameters.encode_ms;
                self.workers[slot].sending += views.len();
                for view in views {
                    self.begin_beside(slot, ms, Task::Encode { slot, life, view });
                }
            }
        }
        self.kick(slot);
    }
}

/// The slots of the other workers at these addresses.
fn others(slot: usize, addresses: &[String]) -> Vec<usize> {
    let slots = addresses.iter().filter_map(|address| address.strip_prefix("http://w")?.parse().ok());
    slots.filter(|other| *other != slot).collect()
}
