//! Kills and pauses workers at random while a cluster serves, repeatable by seed.

use std::time::{Duration, Instant};

use argus_client::Client;
use rand::rngs::SmallRng;
use rand::{Rng, SeedableRng};
use rustix::process::{Pid, Signal, kill_process};

/// Longest pause of a worker.
const LONGEST_PAUSE: Duration = Duration::from_millis(2000);

/// No worker is disturbed this shortly before the end, so that the cluster can recover.
const REST: Duration = Duration::from_secs(3);

/// Counts of disturbances.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Disturbances {
    pub(super) kills: u64,
    pub(super) pauses: u64,
}

/// Kills or pauses a random worker at each turn.
pub(super) struct Chaos {
    rng: SmallRng,
    every: Duration,
    /// When the next turn is due. It waits until a worker can be disturbed.
    next: Instant,
    /// Paused processes, and when each resumes.
    paused: Vec<(u32, Instant)>,
    done: Disturbances,
}

impl Chaos {
    pub(super) fn new(seed: u64, every: Duration) -> Self {
        let rng = SmallRng::seed_from_u64(seed);
        Self {
            rng,
            every,
            next: Instant::now() + every / 2,
            paused: Vec::new(),
            done: Disturbances::default(),
        }
    }

    /// Does what is due; `left` is the remaining time of the test.
    pub(super) async fn run_due(&mut self, client: &Client, left: Duration) {
        let now = Instant::now();
        self.wake(now);
        if now < self.next || left < REST {
            return;
        }
        let Ok(status) = client.status().await else { return };
        // Only workers with a role: killing one that starts would only measure its start.
        let is_paused = |pid: u32| self.paused.iter().any(|(paused, _)| *paused == pid);
        let playing = status.workers.iter().filter(|w| !matches!(w.role_name(), "idle" | "unknown"));
        let mut pids: Vec<u32> = playing.map(|w| w.pid).filter(|pid| !is_paused(*pid)).collect();
        pids.sort_unstable();
        // At least one worker always runs.
        if pids.len() < 2 {
            return;
        }
        // Delayed turns are caught up, but not all at once.
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

    /// Whether the next disturbance is a kill. The first is a pause and the second a kill, so that a short test has
    /// both; then chance decides.
    fn kills_next(&mut self) -> bool {
        let by_chance = self.rng.random_bool(0.5);
        match self.done {
            Disturbances { pauses: 0, .. } => false,
            Disturbances { kills: 0, .. } => true,
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

    /// Resumes all paused workers.
    pub(super) fn end(mut self) -> Disturbances {
        self.wake(Instant::now() + LONGEST_PAUSE);
        self.done
    }
}

impl Drop for Chaos {
    fn drop(&mut self) {
        self.wake(Instant::now() + LONGEST_PAUSE);
    }
}

/// Sends a signal to a process of this test's cluster. Ignores processes that have already ended.
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
    fn a_signal_reaches_its_process_and_ended_processes_are_ignored() {
        use std::os::unix::process::ExitStatusExt as _;
        let mut child = std::process::Command::new("sleep").arg("60").spawn().expect("sleep starts");
        let pid = child.id();
        signal(pid, Signal::STOP);
        signal(pid, Signal::CONT);
        signal(pid, Signal::KILL);
        let status = child.wait().expect("it ends");
        assert_eq!(status.signal(), Some(9));
        signal(pid, Signal::KILL);
        // Pid 0 (this test's group) and -1 (everything) must not be signalled.
        signal(0, Signal::KILL);
        signal(u32::MAX, Signal::KILL);
    }

    #[test]
    fn short_tests_have_a_pause_and_a_kill_and_long_ones_about_as_many_of_each() {
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
