//! Workers that are killed and paused while a cluster serves: of a seed, and bounded, so that a run can be repeated.

use std::time::{Duration, Instant};

use argus_client::Client;
use rand::rngs::SmallRng;
use rand::{Rng, SeedableRng};
use rustix::process::{Pid, Signal, kill_process};

/// A paused worker goes on after at most this long.
const LONGEST_PAUSE: Duration = Duration::from_millis(2000);

/// Nobody is disturbed so shortly before the end: what follows is the cluster's rest.
const REST: Duration = Duration::from_secs(3);

/// What was done.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Disturbed {
    pub(super) kills: u64,
    pub(super) pauses: u64,
}

/// Kills a worker or pauses it, another each time.
pub(super) struct Chaos {
    rng: SmallRng,
    every: Duration,
    /// When the next turn is due; it is taken once somebody can be disturbed.
    next: Instant,
    /// Who is paused, and until when.
    paused: Vec<(u32, Instant)>,
    done: Disturbed,
}

impl Chaos {
    pub(super) fn new(seed: u64, every: Duration) -> Self {
        let rng = SmallRng::seed_from_u64(seed);
        Self { rng, every, next: Instant::now() + every / 2, paused: Vec::new(), done: Disturbed::default() }
    }

    /// Does what is due; `left` is how long the test goes on.
    pub(super) async fn go_on(&mut self, client: &Client, left: Duration) {
        let now = Instant::now();
        self.wake(now);
        if now < self.next || left < REST {
            return;
        }
        let Ok(status) = client.status().await else { return };
        // Workers that play a role: of those that start, killing would only say how fast they start.
        let is_paused = |pid: u32| self.paused.iter().any(|(paused, _)| *paused == pid);
        let playing = status.workers.iter().filter(|w| !matches!(w.role.as_str(), "idle" | "unknown"));
        let mut pids: Vec<u32> = playing.map(|w| w.pid).filter(|pid| !is_paused(*pid)).collect();
        pids.sort_unstable();
        // One always goes on.
        if pids.len() < 2 {
            return;
        }
        // What had to wait for somebody is made up for, yet not all at once.
        self.next = (self.next + self.every).max(now + self.every / 2);
        let pid = pids[self.rng.random_range(0..pids.len())];
        if self.kills_next() {
            signal(pid, Signal::KILL);
            self.done.kills += 1;
        } else {
            signal(pid, Signal::STOP);
            let ms = self.rng.random_range(100..LONGEST_PAUSE.as_millis() as u64);
            self.paused.push((pid, now + Duration::from_millis(ms)));
            self.done.pauses += 1;
        }
    }

    /// By chance; but a pause comes first and a kill soon after it, so that a short test has both, and the pause does not
    /// wait for a new process.
    fn kills_next(&mut self) -> bool {
        let by_chance = self.rng.random_bool(0.5);
        match self.done {
            Disturbed { pauses: 0, .. } => false,
            Disturbed { kills: 0, .. } => true,
            _ => by_chance,
        }
    }

    fn wake(&mut self, by: Instant) {
        self.paused.retain(|(pid, until)| {
            let stays = *until > by;
            if !stays {
                signal(*pid, Signal::CONT);
            }
            stays
        });
    }

    /// Lets everybody go on.
    pub(super) fn end(mut self) -> Disturbed {
        self.wake(Instant::now() + LONGEST_PAUSE);
        self.done
    }
}

impl Drop for Chaos {
    fn drop(&mut self) {
        self.wake(Instant::now() + LONGEST_PAUSE);
    }
}

/// Sends a signal to a process that this test's cluster started. A process that has ended meanwhile is no error.
fn signal(pid: u32, signal: Signal) {
    if let Some(pid) = i32::try_from(pid).ok().and_then(Pid::from_raw) {
        let _ = kill_process(pid, signal);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[cfg(unix)]
    #[test]
    fn a_signal_reaches_its_process_and_one_that_has_ended_is_no_error() {
        use std::os::unix::process::ExitStatusExt as _;
        let mut child = std::process::Command::new("sleep").arg("60").spawn().expect("sleep starts");
        let pid = child.id();
        signal(pid, Signal::STOP);
        signal(pid, Signal::CONT);
        signal(pid, Signal::KILL);
        let status = child.wait().expect("it ends");
        assert_eq!(status.signal(), Some(9));
        signal(pid, Signal::KILL);
        // Neither the group of this test nor everything.
        signal(0, Signal::KILL);
        signal(u32::MAX, Signal::KILL);
    }

    #[test]
    fn short_tests_have_both_kinds_and_long_ones_about_as_many_of_each() {
        let mut chaos = Chaos::new(3, Duration::from_secs(1));
        let take = |chaos: &mut Chaos| {
            let kills = chaos.kills_next();
            chaos.done.kills += u64::from(kills);
            chaos.done.pauses += u64::from(!kills);
        };
        (0..2).for_each(|_| take(&mut chaos));
        assert_eq!((chaos.done.kills, chaos.done.pauses), (1, 1));
        (0..198).for_each(|_| take(&mut chaos));
        assert!(chaos.done.kills.abs_diff(100) < 25, "{:?}", chaos.done);
    }
}
