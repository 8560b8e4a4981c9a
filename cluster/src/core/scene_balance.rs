//! Which scene of a service a worker belongs to: where newcomers go, and when a worker moves to another scene.
//!
//! A worker has one scene at a time. To move it costs the time of opening another scene, and all that it had made of the one before.
//! So few things move a worker:
//!
//! 1. *A scene has viewers and no worker.* It gets one at once, from a scene without viewers, or from one that has several. If all
//!    others have viewers and one worker each, there are fewer workers than scenes with viewers: then they take turns. A turn
//!    is as long as a move took, so that at least half of a worker's time is spent on views.
//! 2. *A scene has more to do than its workers carry*, for some seconds, and another would be left with far less.
//! 3. *A scene without viewers has no worker*, and another has one to spare, for a longer time: so its first viewer does not wait.
//!
//! At constant demand no worker moves back: a scene gives a worker away only if it then has at most [`LEFT`] times the load per
//! worker that the other one had, and takes one only above [`FULL`]. The property is tested below.

use std::time::Duration;

use super::time::Uptime;

/// Processes that views ask for, per worker, above which a scene takes another worker.
const FULL: f64 = 0.7;

/// Greatest load per worker of a scene that has given a worker away, as a part of what the other one had.
const LEFT: f64 = 0.5;

/// Greatest load per worker of a scene that gives a worker to one without viewers.
const LIGHT: f64 = 0.3;

/// How long a scene must have too much to do until a worker moves to it.
const FULL_FOR: Duration = Duration::from_secs(3);

/// How long a scene must have had a worker to spare until it moves to a scene without viewers.
const SPARE_FOR: Duration = Duration::from_secs(20);

/// Least time between two moves that no waiting viewer asks for.
const PAUSE: Duration = Duration::from_secs(10);

/// How long a scene counts as looked at after its last view: viewers pause, and then want the next one soon.
const VIEWED_FOR: Duration = Duration::from_secs(4);

/// Shortest turn of a scene that has the only worker, while viewers of another scene wait.
const LEAST_TURN: Duration = Duration::from_secs(3);

/// Longest time that a worker may be on its way without having joined. Then it counts as lost.
const ON_THE_WAY: Duration = Duration::from_secs(15);

/// Longest time for which a move that has not ended, or a turn in which no view was answered, holds up other scenes.
const LONGEST_MOVE: Duration = Duration::from_secs(120);

/// What is asked of one scene, and who does it.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SceneLoad {
    /// Workers that joined it and stay, and those that are on their way to it.
    pub workers: usize,
    /// Whether one of them answers views.
    pub answers: bool,
    /// Processes that its views ask for: seconds of one process in a second.
    pub asked: f64,
    /// Whether it has views in flight, or got some since the last step. Sessions whose cameras stand still ask for nothing.
    pub is_viewed: bool,
    /// Views that it has answered so far.
    pub answered: u64,
}

impl SceneLoad {
    /// Processes asked for, per worker, if it had so many workers.
    fn per_worker(&self, workers: usize) -> f64 {
        match workers {
            0 if self.asked > 0.0 => f64::INFINITY,
            0 => 0.0,
            workers => self.asked / workers as f64,
        }
    }
}

/// A worker of one scene must move to another one. Scenes are counted as they are served.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SceneMove {
    /// The scene that gives the worker away.
    pub from: usize,
    /// The scene that gets it.
    pub to: usize,
}

/// What is remembered of one scene.
#[derive(Debug, Clone, Copy, Default)]
struct Past {
    /// When it was last looked at.
    viewed: Option<Uptime>,
    /// Since when views have waited for its first worker.
    waits_since: Option<Uptime>,
    /// Since when one of its workers has answered views, and how many views it had answered before.
    answers_since: Option<(Uptime, u64)>,
}

/// Decides which worker moves when.
#[derive(Debug, Clone)]
pub struct SceneBalance {
    scenes: Vec<Past>,
    /// The last move, until the scene that gets the worker answers: since when, and where to.
    under_way: Option<(Uptime, usize)>,
    /// When the last move began.
    moved: Option<Uptime>,
    /// How long the last move took, from the decision until the scene answered.
    took: Duration,
    /// What could be improved without hurry, and since when.
    wish: Option<(SceneMove, Uptime)>,
}

impl SceneBalance {
    /// The balance of so many scenes.
    pub fn new(scenes: usize) -> Self {
        let scenes = vec![Past::default(); scenes];
        Self { scenes, under_way: None, moved: None, took: Duration::ZERO, wish: None }
    }

    /// The move that should begin now, if any. `loads` has an entry for each scene. To be called some times a second.
    pub fn step(&mut self, loads: &[SceneLoad], now: Uptime) -> Option<SceneMove> {
        self.remember(loads, now);
        if self.is_under_way(loads, now) {
            return None;
        }
        let decided = self.for_waiting_viewers(loads, now).or_else(|| self.without_hurry(loads, now))?;
        (self.under_way, self.moved, self.wish) = (Some((now, decided.to)), Some(now), None);
        Some(decided)
    }

    fn remember(&mut self, loads: &[SceneLoad], now: Uptime) {
        for (past, load) in self.scenes.iter_mut().zip(loads) {
            if load.is_viewed {
                past.viewed = Some(now);
            }
            // Whoever waits has a view in flight. A viewer who has seen enough does not call the worker back.
            let waits = load.is_viewed && load.workers == 0;
            past.waits_since = waits.then(|| past.waits_since.unwrap_or(now));
            past.answers_since = load.answers.then(|| past.answers_since.unwrap_or((now, load.answered)));
        }
    }

    /// Whether the last move has not ended: one at a time, so that its effect is seen before the next one.
    fn is_under_way(&mut self, loads: &[SceneLoad], now: Uptime) -> bool {
        let Some((began, to)) = self.under_way else { return false };
        let (load, took) = (loads.get(to).copied().unwrap_or_default(), now.since(began));
        if load.answers {
            self.took = took;
        }
        let is_lost = (load.workers == 0 && took > ON_THE_WAY) || took > LONGEST_MOVE;
        if load.answers || is_lost {
            self.under_way = None;
        }
        self.under_way.is_some()
    }

    fn is_viewed(&self, scene: usize, now: Uptime) -> bool {
        self.scenes[scene].viewed.is_some_and(|at| now.since(at) < VIEWED_FOR)
    }

    /// The move to the scene whose viewers have waited longest for a first worker.
    fn for_waiting_viewers(&self, loads: &[SceneLoad], now: Uptime) -> Option<SceneMove> {
        let waits = |to: &usize| Some((self.scenes[*to].waits_since?, *to));
        let (_, to) = (0..loads.len()).filter_map(|to| waits(&to)).min()?;
        let others = || (0..loads.len()).filter(|from| *from != to && loads[*from].workers > 0);
        let least_loaded = |scenes: &mut dyn Iterator<Item = usize>| {
            let left = |from: usize| loads[from].per_worker(loads[from].workers - 1);
            scenes.min_by(|a, b| left(*a).total_cmp(&left(*b)))
        };
        let unviewed = least_loaded(&mut others().filter(|from| !self.is_viewed(*from, now)));
        let with_several = || least_loaded(&mut others().filter(|from| loads[*from].workers > 1));
        // Of those that have had their turn, the one whose turn is longest. A turn without an answer would be of no use.
        let turn = self.took.max(LEAST_TURN);
        let began = |from: usize| {
            let (began, before) = self.scenes[from].answers_since?;
            let least = if loads[from].answered > before { turn } else { LONGEST_MOVE };
            (now.since(began) >= least).then_some((began, from))
        };
        let had_its_turn = others().filter_map(began).min().map(|(_, from)| from);
        let from = unviewed.or_else(with_several).or(had_its_turn)?;
        Some(SceneMove { from, to })
    }

    /// A move that no viewer waits for, once it has been an improvement for long enough.
    fn without_hurry(&mut self, loads: &[SceneLoad], now: Uptime) -> Option<SceneMove> {
        let relief = self.relief(loads, now).map(|wish| (wish, FULL_FOR));
        let wish = relief.or_else(|| self.spare(loads).map(|wish| (wish, SPARE_FOR)));
        let (wish, lasts) = match wish {
            Some(wish) => wish,
            None => {
                self.wish = None;
                return None;
            }
        };
        let since = self.wish.filter(|(before, _)| *before == wish).map_or(now, |(_, since)| since);
        self.wish = Some((wish, since));
        let has_paused = self.moved.is_none_or(|moved| now.since(moved) >= PAUSE);
        (now.since(since) >= lasts && has_paused).then_some(wish)
    }

    /// A worker for the scene that has most to do, from the one that is left with least.
    fn relief(&self, loads: &[SceneLoad], now: Uptime) -> Option<SceneMove> {
        let load = |scene: &usize| loads[*scene].per_worker(loads[*scene].workers);
        let full = (0..loads.len()).filter(|to| loads[*to].workers > 0 && load(to) > FULL);
        let to = full.max_by(|a, b| load(a).total_cmp(&load(b)))?;
        let left = |from: usize| loads[from].per_worker(loads[from].workers - 1);
        let gives = |from: &usize| {
            let workers = loads[*from].workers;
            let may = workers > 1 || (workers == 1 && !self.is_viewed(*from, now));
            *from != to && may && (left(*from) <= LEFT * load(&to) || !self.is_viewed(*from, now))
        };
        let from = (0..loads.len()).filter(gives).min_by(|a, b| left(*a).total_cmp(&left(*b)))?;
        Some(SceneMove { from, to })
    }

    /// A worker for a scene without any, from one that hardly needs it.
    fn spare(&self, loads: &[SceneLoad]) -> Option<SceneMove> {
        let to = (0..loads.len()).find(|to| loads[*to].workers == 0)?;
        let left = |from: usize| loads[from].per_worker(loads[from].workers - 1);
        let gives = |from: &usize| loads[*from].workers > 1 && left(*from) <= LIGHT;
        let from = (0..loads.len()).filter(gives).min_by(|a, b| left(*a).total_cmp(&left(*b)))?;
        Some(SceneMove { from, to })
    }
}

/// The scene for a worker that joins. `held` is the scene that it has open, where it need open none. While workers return to a new
/// leader (`returning`), each goes back to that one.
pub fn scene_for_newcomer(loads: &[SceneLoad], held: Option<usize>, returning: bool) -> usize {
    if let Some(held) = held.filter(|held| returning && *held < loads.len()) {
        return held;
    }
    let waits = |scene: usize| loads[scene].is_viewed && loads[scene].workers == 0;
    let need = |scene: usize| {
        let load = loads[scene];
        // Greater is more: viewers without a worker, no worker, work per worker, few workers, no scene to open.
        (waits(scene), load.workers == 0, load.per_worker(load.workers), load.workers, held == Some(scene))
    };
    let needs_more = |a: &usize, b: &usize| {
        let (a_need, b_need) = (need(*a), need(*b));
        let work = |per_worker: f64| if per_worker > FULL { per_worker } else { 0.0 };
        (a_need.0, a_need.1)
            .cmp(&(b_need.0, b_need.1))
            .then(work(a_need.2).total_cmp(&work(b_need.2)))
            .then(b_need.3.cmp(&a_need.3))
            .then(a_need.4.cmp(&b_need.4))
            // Of equals the first.
            .then(b.cmp(a))
    };
    (0..loads.len()).max_by(needs_more).unwrap_or(0)
}

#[cfg(test)]
mod tests;
