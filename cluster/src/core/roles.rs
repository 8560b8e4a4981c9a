//! Who plays which role: the split the formula wants, carried out with the fewest changes.

use super::balance::{self, Load, Split};
use super::event::{Action, Role, WorkerId};
use super::machine::Core;
use super::time::Uptime;
use super::worker::Worker;

impl Core {
    /// Workers that are ready and stay.
    pub(super) fn members(&self) -> impl Iterator<Item = &Worker> {
        self.workers.values().filter(|w| w.is_ready())
    }

    fn processes(&self) -> u32 {
        u32::try_from(self.lines.ready()).unwrap_or(u32::MAX)
    }

    fn wanted(&self, processes: u32) -> Split {
        let (demand, costs) = (self.demand(), self.believed_costs());
        match balance::split(&demand, &costs, processes) {
            Split::Divided(_) if self.config.samplers_composite => {
                Split::Divided(balance::helping_samplers(Load::of(&demand, &costs), processes))
            }
            split => split,
        }
    }

    /// Seconds that a tick's work is predicted to take under a split.
    pub(super) fn predicted_tick_secs(&self, load: Load, processes: u32, split: Split) -> f64 {
        match self.config.samplers_composite {
            true => balance::helping_tick_secs(load, processes, split),
            false => balance::tick_secs(load, processes, split),
        }
    }

    /// The role a worker that joins now will most likely have once it is ready, so that it need not change:
    /// workers that are still starting count, since all of a cluster may start at once.
    pub(super) fn role_of_newcomer(&self) -> Role {
        let processes = self.expected.max(self.workers.len().saturating_add(1));
        let processes = u32::try_from(processes).unwrap_or(u32::MAX);
        let samplers = self.workers.values().filter(|w| w.assigned().role.samples()).count();
        match self.wanted(processes) {
            Split::Nobody | Split::Alone => Role::Both,
            Split::AllDirect => Role::Sampler,
            Split::Divided(k) if (samplers as u32) < k => Role::Sampler,
            Split::Divided(_) => Role::Compositor,
        }
    }

    /// A worker came or went: nobody else changes more than that calls for. The formula's K then follows with
    /// hysteresis, like any change of demand.
    pub(super) fn processes_changed(&mut self, actions: &mut Vec<Action>) {
        let processes = self.processes();
        self.hysteresis.reset();
        let wanted = self.wanted(processes);
        let split = match (processes, wanted, self.split) {
            (0, ..) => Split::Nobody,
            (1, ..) => Split::Alone,
            (_, Split::AllDirect, Split::AllDirect) => Split::AllDirect,
            (p, wanted, before) => {
                let k = match wanted {
                    Split::Divided(k) => k,
                    _ => p - 1,
                };
                // From a split with a K of its own, K moves by the one worker at most.
                let near = match before {
                    Split::Divided(before) => k.clamp(before.saturating_sub(1), before.saturating_add(1)),
                    _ => k,
                };
                Split::Divided(near.clamp(1, p - 1))
            }
        };
        self.apply(split, actions);
    }

    /// Changes roles if that pays.
    pub(super) fn rebalance(&mut self, now: Uptime, actions: &mut Vec<Action>) {
        let processes = self.processes();
        if processes < 2 {
            return;
        }
        let load = Load::of(&self.demand(), &self.believed_costs());
        let wanted = self.wanted(processes);
        let tick_secs = |split| self.predicted_tick_secs(load, processes, split);
        let (tick, better) = (tick_secs(self.split), tick_secs(wanted));
        if self.hysteresis.pays(now, (self.split, tick), (wanted, better), processes) {
            self.apply(wanted, actions);
        }
    }

    /// Gives every member the role it has under `split`, leaving alone as many as possible: a sampler is kept
    /// for the samples it owns, a compositor for those it holds.
    fn apply(&mut self, split: Split, actions: &mut Vec<Action>) {
        self.split = split;
        let owned = self.directory.owned();
        let owns = |worker: WorkerId| owned.get(&worker).copied().unwrap_or(0);
        let mut ranked: Vec<(u8, usize, WorkerId)> = self
            .members()
            .map(|w| match w.role() {
                Some(Role::Sampler) => (0, usize::MAX - owns(w.id), w.id),
                Some(Role::Both) => (1, usize::MAX - owns(w.id), w.id),
                _ => (2, w.holdings(), w.id),
            })
            .collect();
        ranked.sort_unstable();
        for (place, (_, _, id)) in ranked.into_iter().enumerate() {
            let role = match split {
                Split::Nobody | Split::Alone => Role::Both,
                Split::AllDirect => Role::Sampler,
                Split::Divided(k) if place < k as usize => Role::Sampler,
                Split::Divided(_) => Role::Compositor,
            };
            let Some(worker) = self.workers.get_mut(&id) else { continue };
            if worker.assigned().role != role {
                self.counters.roles_changed += 1;
                self.to_refine = true;
                actions.push(Action::Assign { worker: id, assignment: worker.assign(role) });
                self.lines.update(worker);
            }
        }
    }
}
