//! The cores of a simulated machine, shared by its tasks, and its network link.

use std::collections::BTreeMap;

use super::Nanos;

/// Cores shared evenly by tasks: n tasks on C cores each run at the speed min(1, C/n).
///
/// Time is kept as the work of a task that never ends. Tasks that begin or end change only the speed at which this
/// grows, so each task ends at a fixed amount of it.
#[derive(Debug)]
pub(super) struct Host<T> {
    cores: f64,
    /// Work in seconds at `since`.
    work: f64,
    since: Nanos,
    /// Tasks by the work at which they end, as f64 bits (which sort like non-negative numbers), and by number.
    tasks: BTreeMap<(u64, u64), T>,
    count: u64,
    /// Changes whenever the next end may change.
    pub(super) version: u64,
}

impl<T> Host<T> {
    pub(super) fn new(cores: u32) -> Self {
        Self { cores: f64::from(cores), work: 0.0, since: 0, tasks: BTreeMap::new(), count: 0, version: 0 }
    }

    fn pace(&self) -> f64 {
        (self.cores / self.tasks.len().max(1) as f64).min(1.0)
    }

    fn pass(&mut self, now: Nanos) {
        self.work += self.pace() * (now - self.since) as f64 * 1e-9;
        self.since = now;
    }

    /// Starts a task that needs a core for `ms` milliseconds.
    pub(super) fn begin(&mut self, now: Nanos, ms: f64, task: T) {
        self.pass(now);
        self.count += 1;
        self.version += 1;
        self.tasks.insert(((self.work + ms * 1e-3).to_bits(), self.count), task);
    }

    /// When the next task ends, unless another begins before.
    pub(super) fn next_end(&self) -> Option<Nanos> {
        let ((end, _), _) = self.tasks.first_key_value()?;
        let left = (f64::from_bits(*end) - self.work).max(0.0) / self.pace();
        Some(self.since + (left * 1e9).ceil() as Nanos)
    }

    /// Removes and returns the tasks that have ended by now.
    pub(super) fn ended(&mut self, now: Nanos) -> Vec<T> {
        self.pass(now);
        self.version += 1;
        let mut ended = Vec::new();
        // An end within the next nanosecond counts as now.
        while let Some(first) = self.tasks.first_entry() {
            if f64::from_bits(first.key().0) > self.work + 1e-9 {
                break;
            }
            ended.push(first.remove());
        }
        ended
    }
}

/// A machine's link: transmissions are sent one after another.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Link {
    up_free: Nanos,
    down_free: Nanos,
}

/// Sends `bytes` now. Returns when they have arrived.
pub(super) fn transfer(
    links: &mut [Link],
    from: usize,
    to: usize,
    now: Nanos,
    bytes: u64,
    rate: f64,
) -> Nanos {
    let takes = (bytes as f64 / rate * 1e9) as Nanos;
    let sent = now.max(links[from].up_free) + takes;
    links[from].up_free = sent;
    // The receiver's link is busy while the bytes arrive, at the same time as the sender's if it is free.
    let arrived = sent.max(links[to].down_free + takes);
    links[to].down_free = arrived;
    arrived
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Nanos = 1_000_000;

    #[test]
    fn tasks_share_the_cores_evenly() {
        let mut host = Host::new(2);
        host.begin(0, 10.0, 'a');
        host.begin(0, 10.0, 'b');
        assert_eq!(host.next_end(), Some(10 * MS));
        // From 5 ms on, three tasks share two cores. Two of them have 5 ms of work left.
        host.begin(5 * MS, 1.0, 'c');
        let next = host.next_end().unwrap();
        assert!(next.abs_diff(6_500_000) < 10, "{next}");
        assert_eq!(host.ended(next), ['c']);
        let next = host.next_end().unwrap();
        assert!(next.abs_diff(10_500_000) < 10, "{next}");
        assert_eq!(host.ended(next), ['a', 'b']);
        assert_eq!(host.next_end(), None);
    }

    #[test]
    fn a_sender_transmits_one_after_another() {
        let mut links = [Link::default(); 4];
        let times: Vec<Nanos> = (1..4).map(|to| transfer(&mut links, 0, to, 0, 1_000_000, 1e9)).collect();
        assert_eq!(times, [MS, 2 * MS, 3 * MS]);
        // Two senders to one receiver share its link.
        let mut links = [Link::default(); 3];
        assert_eq!(transfer(&mut links, 0, 2, 0, 1_000_000, 1e9), MS);
        assert_eq!(transfer(&mut links, 1, 2, 0, 1_000_000, 1e9), 2 * MS);
    }
}
