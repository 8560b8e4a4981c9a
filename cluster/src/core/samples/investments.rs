//! Samples as investments: a camera set is rendered when the views that it will serve save more than it costs.
//!
//! A *camera set* is a set of sample cameras that together bring a view within its error bound, each with the faces in which
//! views look. Each view from triangles tells what its camera set would have saved: its time less the predicted time of a view
//! from samples, in seconds of one process. Savings are averaged per camera set. A camera set is worth its price if its savings per
//! tick, over the horizon for which interest is expected to last, exceed the time to render its missing faces.

use std::collections::BTreeMap;

use argus_scene::FaceMask;

/// Expected duration of interest in a camera set, ticks, in a still scene.
const HORIZON_TICKS: f64 = 60.0;

/// The same while views lack time: savings are known for a short time only, and rendering takes time from views.
const HORIZON_UNDER_LOAD_TICKS: f64 = 20.0;

/// Weight of the newest tick in a camera set's average savings: a short visit of a viewer is no reason to invest.
const WEIGHT: f64 = 0.1;

/// The same while views lack time: then a short visit is, since each view that is cheaper leaves time to the others.
const WEIGHT_UNDER_LOAD: f64 = 0.5;

/// Most remembered camera sets: those that save most.
const MOST_CAMERA_SETS: usize = 256;

/// Savings in seconds per tick below which a camera set is forgotten.
const NEGLIGIBLE_SECS: f64 = 1e-5;

/// Cameras of a camera set, ascending, with their faces.
pub(super) type CameraSet = Vec<(u64, FaceMask)>;

/// The savings of one camera set.
#[derive(Debug, Clone, Default)]
struct Savings {
    /// The faces of its cameras that views looked at.
    camera_set: CameraSet,
    /// Seconds saved in the current tick.
    fresh_secs: f64,
    /// Average seconds saved per tick.
    secs_a_tick: f64,
}

/// The savings of all camera sets.
#[derive(Debug, Clone, Default)]
pub(super) struct Investments {
    camera_sets: BTreeMap<Vec<u64>, Savings>,
    /// Whether views lacked time in the last tick.
    under_load: bool,
}

impl Investments {
    /// Learns the seconds that a view would have saved with a camera set. Savings that are not positive are ignored.
    pub(super) fn learn(&mut self, mut camera_set: CameraSet, secs: f64) {
        if camera_set.is_empty() || !(secs > 0.0 && secs.is_finite()) {
            return;
        }
        camera_set.sort_unstable();
        let cameras = camera_set.iter().map(|(camera, _)| *camera).collect();
        let savings = self.camera_sets.entry(cameras).or_default();
        savings.fresh_secs += secs;
        if savings.camera_set.is_empty() {
            savings.camera_set = camera_set;
            return;
        }
        for ((_, faces), (_, wanted)) in savings.camera_set.iter_mut().zip(camera_set) {
            *faces = faces.union(wanted);
        }
    }

    /// Closes a tick.
    pub(super) fn tick(&mut self, ticks: f64, under_load: bool) {
        self.under_load = under_load;
        let newest = if under_load { WEIGHT_UNDER_LOAD } else { WEIGHT };
        let weight = 1.0 - (1.0 - newest).powf(ticks);
        for savings in self.camera_sets.values_mut() {
            let a_tick = savings.fresh_secs / ticks.max(1.0);
            savings.secs_a_tick += weight * (a_tick - savings.secs_a_tick);
            savings.fresh_secs = 0.0;
        }
        self.camera_sets.retain(|_, savings| savings.secs_a_tick >= NEGLIGIBLE_SECS);
        if self.camera_sets.len() > MOST_CAMERA_SETS {
            let mut by_savings: Vec<f64> =
                self.camera_sets.values().map(|savings| savings.secs_a_tick).collect();
            by_savings.sort_by(|a, b| b.total_cmp(a));
            let least = by_savings[MOST_CAMERA_SETS - 1];
            self.camera_sets.retain(|_, savings| savings.secs_a_tick >= least);
        }
    }

    /// The camera set that saves most for its price, and its savings per tick; `None` if no camera set is worth its price.
    /// `price` gives the seconds to render a camera set's missing samples. `most_ticks` limits the horizon if samples do
    /// not last.
    pub(super) fn best(
        &self,
        price: impl Fn(&[(u64, FaceMask)]) -> f64,
        most_ticks: f64,
    ) -> Option<(&[(u64, FaceMask)], f64)> {
        let horizon = if self.under_load { HORIZON_UNDER_LOAD_TICKS } else { HORIZON_TICKS }.min(most_ticks);
        let worth = self.camera_sets.values().filter_map(|savings| {
            let camera_set = &savings.camera_set;
            let price = price(camera_set);
            let gain = savings.secs_a_tick * horizon;
            // A camera set without a price is complete.
            (price > 0.0 && gain > price).then_some((gain / price, camera_set, savings.secs_a_tick))
        });
        let best = worth.max_by(|a, b| a.0.total_cmp(&b.0).then(b.1.cmp(a.1)));
        best.map(|(_, camera_set, secs)| (camera_set.as_slice(), secs))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn whole(cameras: &[u64]) -> CameraSet {
        cameras.iter().map(|camera| (*camera, FaceMask::ALL)).collect()
    }

    fn after(ticks: u32, secs_a_tick: f64) -> Investments {
        let mut investments = Investments::default();
        for _ in 0..ticks {
            investments.learn(whole(&[3, 1]), secs_a_tick / 2.0);
            investments.learn(whole(&[1, 3]), secs_a_tick / 2.0);
            investments.tick(1.0, false);
        }
        investments
    }

    #[test]
    fn a_camera_set_is_worth_its_price_once_steady_views_save_more_than_it_costs() {
        let price = |camera_set: &[(u64, FaceMask)]| 2.0 * camera_set.len() as f64;
        assert_eq!(after(1, 0.2).best(price, f64::INFINITY), None, "a moment is no reason");
        let (camera_set, secs) =
            after(30, 0.2).best(price, f64::INFINITY).map(|(b, s)| (b.to_vec(), s)).unwrap();
        assert_eq!(camera_set, whole(&[1, 3]));
        assert!((0.15..0.2).contains(&secs), "{secs}");
        assert_eq!(
            after(30, 0.05).best(price, f64::INFINITY),
            None,
            "3 s are saved at most, and 4 s is the price"
        );
        let mut under_load = Investments::default();
        under_load.learn(whole(&[1, 3]), 0.5);
        under_load.tick(1.0, true);
        assert!(under_load.best(price, f64::INFINITY).is_some(), "there is no time to wait");
    }

    #[test]
    fn samples_that_last_a_short_time_must_pay_within_it() {
        let price = |_: &[(u64, FaceMask)]| 1.0;
        assert!(after(40, 0.5).best(price, f64::INFINITY).is_some());
        assert!(after(40, 0.5).best(price, 0.1).is_none());
    }

    #[test]
    fn of_two_camera_sets_the_one_that_saves_more_for_its_price_comes_first() {
        let mut investments = Investments::default();
        for _ in 0..50 {
            investments.learn(whole(&[1]), 1.0);
            investments.learn(whole(&[2]), 2.0);
            investments.tick(1.0, false);
        }
        let of = |prices: [f64; 3]| investments.best(|b| prices[b[0].0 as usize], 60.0).map(|(b, _)| b[0].0);
        assert_eq!(of([0.0, 1.0, 1.0]), Some(2));
        assert_eq!(of([0.0, 1.0, 3.0]), Some(1));
        assert_eq!(of([0.0, 0.0, 0.0]), None, "nothing is missing");
        assert_eq!(of([0.0, f64::NAN, f64::INFINITY]), None);
    }

    #[test]
    fn only_the_camera_sets_with_the_greatest_savings_are_remembered() {
        let mut investments = Investments::default();
        for index in 0..3 * MOST_CAMERA_SETS as u64 {
            investments.learn(whole(&[index]), 1.0 + index as f64);
        }
        for secs in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            investments.learn(whole(&[1 << 40]), secs);
        }
        investments.learn(Vec::new(), 1.0);
        investments.tick(1.0, false);
        assert_eq!(investments.camera_sets.len(), MOST_CAMERA_SETS);
        assert!(!investments.camera_sets.contains_key(&vec![1 << 40]));
        (0..400).for_each(|_| investments.tick(1.0, false));
        assert!(investments.camera_sets.is_empty(), "interest fades");
    }

    #[test]
    fn a_camera_set_has_the_faces_that_any_of_its_views_wanted() {
        let [left, right] = [FaceMask::only(1), FaceMask::only(0)];
        let mut investments = Investments::default();
        for _ in 0..50 {
            investments.learn(vec![(3, left), (1, left)], 1.0);
            investments.learn(vec![(1, right), (3, left)], 1.0);
            investments.tick(1.0, false);
        }
        let (camera_set, secs) = investments.best(|_| 1.0, 60.0).unwrap();
        assert_eq!(camera_set, [(1, left.union(right)), (3, left)]);
        assert!(secs > 1.5, "views that want other faces of the same cameras save together: {secs}");
    }
}
