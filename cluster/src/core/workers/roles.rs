//! Assigns roles by the split that the formula wants, with the fewest changes.

use std::collections::HashMap;

use super::Workers;
use super::balance::{self, Load, Split};
use crate::core::event::{Action, Role, WorkerId};
use crate::core::time::Uptime;

/// The samples that a worker would lose by another role.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(in crate::core) struct SampleCounts {
    /// Number of samples that it owns.
    pub(in crate::core) owned: usize,
    /// Number of samples that it holds.
    pub(in crate::core) held: usize,
}

impl Workers {
    fn processes(&self) -> u32 {
        u32::try_from(self.queues.ready()).unwrap_or(u32::MAX)
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

    /// Predicted seconds of a tick's work under a split.
    pub(in crate::core) fn predicted_tick_secs(&self, load: Load, processes: u32, split: Split) -> f64 {
        match self.config.samplers_composite {
            true => balance::helping_tick_secs(load, processes, split),
            false => balance::tick_secs(load, processes, split),
        }
    }

    /// The role of a worker that joins now, chosen so that it need not change once the worker is ready. Starting
    /// workers count, since a whole cluster may start at once.
    pub(super) fn role_of_newcomer(&self) -> Role {
        let processes = self.expected.max(self.workers.len().saturating_add(1));
        let processes = u32::try_from(processes).unwrap_or(u32::MAX);
        let samplers = self.workers.values().filter(|w| w.assigned().role.samples()).count();
        match self.wanted(processes) {
            Split::NoWorkers | Split::Alone => Role::Both,
            Split::AllDirect => Role::Sampler,
            Split::Divided(k) if (samplers as u32) < k => Role::Sampler,
            Split::Divided(_) => Role::Compositor,
        }
    }

    /// The split after a worker came or left: no other roles change than that requires. K then follows the formula
    /// with hysteresis.
    pub(in crate::core) fn split_of_change(&mut self) -> Split {
        let processes = self.processes();
        self.hysteresis.reset();
        let wanted = self.wanted(processes);
        match (processes, wanted, self.split) {
            (0, ..) => Split::NoWorkers,
            (1, ..) => Split::Alone,
            (_, Split::AllDirect, Split::AllDirect) => Split::AllDirect,
            (p, wanted, before) => {
                let k = match wanted {
                    Split::Divided(k) => k,
                    _ => p - 1,
                };
                // From a divided split, K moves by at most one.
                let near = match before {
                    Split::Divided(before) => k.clamp(before.saturating_sub(1), before.saturating_add(1)),
                    _ => k,
                };
                Split::Divided(near.clamp(1, p - 1))
            }
        }
    }

    /// A better split, if changing roles for it pays now. Called once a tick or more often.
    pub(in crate::core) fn better_split(&mut self, now: Uptime) -> Option<Split> {
        let processes = self.processes();
        if processes < 2 {
            return None;
        }
        let load = Load::of(&self.demand(), &self.believed_costs());
        let wanted = self.wanted(processes);
        let tick_secs = |split| self.predicted_tick_secs(load, processes, split);
        let (tick, better) = (tick_secs(self.split), tick_secs(wanted));
        self.hysteresis.pays(now, (self.split, tick), (wanted, better), processes).then_some(wanted)
    }

    /// Assigns roles by `split`, with the fewest changes: samplers that own most samples stay samplers, compositors
    /// that hold most stay compositors.
    pub(in crate::core) fn divide(
        &mut self,
        split: Split,
        sample_counts: &HashMap<WorkerId, SampleCounts>,
        actions: &mut Vec<Action>,
    ) {
        self.split = split;
        let counts_of = |worker: WorkerId| sample_counts.get(&worker).copied().unwrap_or_default();
        let mut ranked: Vec<(u8, usize, WorkerId)> = self
            .members()
            .map(|w| match w.role() {
                Some(Role::Sampler) => (0, usize::MAX - counts_of(w.id()).owned, w.id()),
                Some(Role::Both) => (1, usize::MAX - counts_of(w.id()).owned, w.id()),
                _ => (2, counts_of(w.id()).held, w.id()),
            })
            .collect();
        ranked.sort_unstable();
        for (place, (_, _, id)) in ranked.into_iter().enumerate() {
            let role = match split {
                Split::NoWorkers | Split::Alone => Role::Both,
                Split::AllDirect => Role::Sampler,
                Split::Divided(k) if place < k as usize => Role::Sampler,
                Split::Divided(_) => Role::Compositor,
            };
            let Some(worker) = self.workers.get_mut(&id) else { continue };
            if worker.assigned().role != role {
                self.counts.roles_changed += 1;
                self.changed = true;
                actions.push(Action::Assign { worker: id, assignment: worker.assign(role) });
                self.queues.update(worker.queue_membership());
            }
        }
    }
}
