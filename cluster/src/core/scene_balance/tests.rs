//! Tests of the balance between scenes, with workers that take some time to open another scene.

use super::*;

/// Time between two steps.
const STEP: Duration = Duration::from_millis(250);

/// What a scene's viewers ask for, in processes, and whether there are any.
type Asked = Option<f64>;

/// A service with workers that answer once they have opened their scene.
struct Service {
    balance: SceneBalance,
    now: Uptime,
    /// The scene of each worker, and since when it answers.
    workers: Vec<(usize, Uptime)>,
    /// Time of opening a scene.
    opening: Duration,
    moves: Vec<(Uptime, SceneMove)>,
}

impl Service {
    fn new(scenes: usize, workers: &[usize]) -> Self {
        let workers = workers.iter().map(|scene| (*scene, Uptime::default())).collect();
        let balance = SceneBalance::new(scenes);
        Self { balance, now: Uptime::default(), workers, opening: Duration::from_secs(1), moves: Vec::new() }
    }

    fn loads(&self, asked: &[Asked]) -> Vec<SceneLoad> {
        let load = |(scene, asked): (usize, &Asked)| {
            let of_scene = || self.workers.iter().filter(|(at, _)| *at == scene);
            let answers = of_scene().any(|(_, since)| self.now >= *since);
            // What a scene without a worker asks for is not known.
            let known = asked.filter(|_| answers).unwrap_or(0.0);
            let answered = if answers && asked.is_some() { self.now.0.as_millis() as u64 } else { 0 };
            let workers = of_scene().count();
            SceneLoad { workers, answers, asked: known, is_viewed: asked.is_some(), answered }
        };
        asked.iter().enumerate().map(load).collect()
    }

    /// Runs for some seconds, and returns the moves of this time.
    fn run(&mut self, asked: &[Asked], secs: u64) -> Vec<SceneMove> {
        let (before, until) = (self.moves.len(), self.now.after(Duration::from_secs(secs)));
        while self.now < until {
            let loads = self.loads(asked);
            if let Some(decided) = self.balance.step(&loads, self.now) {
                let worker = self.workers.iter_mut().find(|(scene, _)| *scene == decided.from);
                *worker.expect("a worker to move") = (decided.to, self.now.after(self.opening));
                self.moves.push((self.now, decided));
            }
            self.now = self.now.after(STEP);
        }
        self.moves[before..].iter().map(|(_, decided)| *decided).collect()
    }

    /// Workers of each of two scenes.
    fn counts(&self) -> [usize; 2] {
        [0, 1].map(|scene| self.workers.iter().filter(|(at, _)| *at == scene).count())
    }
}

#[test]
fn nothing_moves_while_each_scene_has_what_it_needs() {
    let mut service = Service::new(2, &[0, 1]);
    assert_eq!(service.run(&[Some(0.5), Some(0.3)], 120), []);
    assert_eq!(service.run(&[Some(0.5), None], 120), []);
    assert_eq!(service.run(&[None, None], 120), []);
}

#[test]
fn viewers_without_a_worker_get_an_idle_one_at_once() {
    let mut service = Service::new(3, &[0, 0, 2]);
    // Scene 0 has two workers, and scene 2 has no viewers.
    assert_eq!(service.run(&[Some(0.9), Some(0.1), None], 2), [SceneMove { from: 2, to: 1 }]);
    let mut service = Service::new(3, &[0, 0, 2]);
    assert_eq!(service.run(&[Some(0.9), Some(0.1), Some(0.1)], 2), [SceneMove { from: 0, to: 1 }]);
    assert!(service.run(&[Some(0.9), Some(0.1), Some(0.1)], 120).is_empty(), "each has one now");
}

#[test]
fn one_worker_serves_two_scenes_in_turns_and_each_for_half_of_the_time() {
    for opening in [1, 10] {
        let mut service = Service::new(2, &[0]);
        service.opening = Duration::from_secs(opening);
        let moves = service.run(&[Some(0.5), Some(0.5)], 400);
        assert!(moves.windows(2).all(|pair| pair[0].from == pair[1].to), "it alternates: {moves:?}");
        let times: Vec<Uptime> = service.moves.iter().map(|(at, _)| *at).collect();
        for pair in times.windows(2) {
            let (took, opening) = (pair[1].since(pair[0]), service.opening);
            assert!(took >= LEAST_TURN.max(opening) + opening, "the turn of a scene is too short: {took:?}");
            assert!(took <= 3 * LEAST_TURN.max(opening), "the other scene waits too long: {took:?}");
        }
        assert!(times.len() > 8, "{times:?}");
        // Once the viewers of one are gone, it stays with the other.
        let last = service.run(&[None, Some(0.5)], 120);
        assert!(last.len() <= 1, "{last:?}");
        assert_eq!(service.counts(), [0, 1]);
    }
}

#[test]
fn a_turn_lasts_until_a_view_was_answered() {
    let at = |secs: u64| Uptime(Duration::from_secs(secs));
    let mut balance = SceneBalance::new(2);
    let mut step = |answered, now| {
        let busy = SceneLoad { workers: 1, answers: true, asked: 1.0, is_viewed: true, answered };
        let waits = SceneLoad { is_viewed: true, ..SceneLoad::default() };
        balance.step(&[busy, waits], now)
    };
    assert_eq!(step(7, at(0)), None);
    assert_eq!(step(7, at(60)), None, "its first view takes long");
    assert_eq!(step(8, at(61)), Some(SceneMove { from: 0, to: 1 }));
    let mut balance = SceneBalance::new(2);
    let stuck = SceneLoad { workers: 1, answers: true, asked: 1.0, is_viewed: true, answered: 0 };
    let waits = SceneLoad { is_viewed: true, ..SceneLoad::default() };
    assert_eq!(balance.step(&[stuck, waits], at(0)), None);
    assert!(balance.step(&[stuck, waits], at(121)).is_some(), "the other scene does not wait for ever");
}

#[test]
fn a_viewer_who_has_left_does_not_call_the_worker_back() {
    let mut service = Service::new(2, &[0]);
    service.run(&[Some(0.2), None], 10);
    assert_eq!(service.run(&[None, Some(0.2)], 5), [SceneMove { from: 0, to: 1 }]);
    assert_eq!(service.run(&[None, None], 120), []);
}

#[test]
fn workers_follow_the_load_and_come_back_after_it() {
    let mut service = Service::new(2, &[0, 0, 1, 1]);
    assert_eq!(service.run(&[Some(0.1), Some(3.0)], 60), [SceneMove { from: 0, to: 1 }]);
    assert_eq!(service.counts(), [1, 3], "a scene with viewers keeps one");
    assert_eq!(service.run(&[Some(3.0), Some(0.1)], 60).len(), 2);
    assert_eq!(service.counts(), [3, 1]);
    service.run(&[None, Some(4.0)], 60);
    assert_eq!(service.counts(), [0, 4], "the other has no viewers");
    // Its next viewer should not have to wait for a move.
    service.run(&[None, Some(0.2)], 60);
    assert_eq!(service.counts(), [1, 3]);
}

#[test]
fn a_short_peak_moves_nothing() {
    let mut service = Service::new(2, &[0, 0, 1]);
    for _ in 0..20 {
        assert_eq!(service.run(&[Some(0.1), Some(2.0)], 2), []);
        assert_eq!(service.run(&[Some(0.1), Some(0.4)], 4), []);
    }
}

#[test]
fn at_constant_demand_moves_end_whatever_the_demand_is() {
    let demands = [0.0, 0.2, 0.35, 0.7, 0.71, 1.0, 1.4, 2.0, 5.0];
    for workers in 2..7 {
        for first in demands {
            for second in demands {
                let asked = [Some(first), Some(second)];
                let mut service = Service::new(2, &vec![0; workers]);
                service.run(&asked, 120);
                assert!(!service.counts().contains(&0), "{workers}, {asked:?}: {:?}", service.counts());
                let later = service.run(&asked, 240);
                assert_eq!(later, [], "{workers} workers, {asked:?}: {:?}", service.counts());
            }
        }
    }
}

#[test]
fn a_worker_that_is_lost_on_its_way_holds_nothing_up() {
    let mut service = Service::new(2, &[0, 0]);
    assert_eq!(service.run(&[Some(0.1), Some(0.1)], 1).len(), 1);
    service.workers.retain(|(scene, _)| *scene == 0);
    service.workers.push((0, service.now));
    assert_eq!(service.run(&[Some(0.1), Some(0.1)], 60), [SceneMove { from: 0, to: 1 }]);
}

#[test]
fn newcomers_go_where_they_are_missing() {
    let load = |workers, asked, is_viewed| SceneLoad {
        workers,
        answers: workers > 0,
        asked,
        is_viewed,
        ..SceneLoad::default()
    };
    let place = |loads: &[SceneLoad]| scene_for_newcomer(loads, None, false);
    assert_eq!(place(&[load(0, 0.0, false), load(0, 0.0, false)]), 0, "of equals the first");
    assert_eq!(place(&[load(1, 0.0, false), load(0, 0.0, false)]), 1);
    assert_eq!(place(&[load(0, 0.0, false), load(0, 0.0, true)]), 1, "viewers wait");
    assert_eq!(place(&[load(1, 0.1, true), load(2, 3.0, true)]), 1, "the load");
    assert_eq!(place(&[load(1, 0.1, true), load(2, 0.3, true)]), 0, "fewer workers");
    let empty = [load(0, 0.0, false); 3];
    assert_eq!(scene_for_newcomer(&empty, Some(2), false), 2, "it has that one open");
    let one_waits = [load(1, 0.0, false), load(0, 0.0, true)];
    assert_eq!(scene_for_newcomer(&one_waits, Some(0), false), 1);
    assert_eq!(scene_for_newcomer(&one_waits, Some(0), true), 0, "all workers return to what they have");
}
