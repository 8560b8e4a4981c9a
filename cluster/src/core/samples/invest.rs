//! Which samples are worth their price: their savings and costs in seconds of one process.
//!
//! While views have the time that they are worth, one camera set is rendered at a time, by workers that are idle. While they lack
//! time, all camera sets that pay are rendered, best first, as many as save what is lacking. If the other workers carry all views in
//! some way, they are rendered *at once*: the samplers, of which the balance formula says how many there are, leave views to the
//! others until these samples are there.

use argus_scene::FaceMask;

use super::Samples;
use super::investments::CameraSet;
use super::lot::Lot;
use crate::core::event::WorkerId;
use crate::core::workers::Workers;

/// The usual number of sub-samples of a texel.
const SUB_SAMPLES: u64 = 4;

/// Seconds of a single ray until one was measured.
const USUAL_RAY_SECS: f64 = 2e-6;

impl Samples {
    /// Learns the seconds that views would have saved with these faces of cameras' samples.
    pub(in crate::core) fn learn_camera_set(&mut self, camera_set: CameraSet, secs: f64) {
        self.investments.learn(camera_set, secs);
    }

    /// Learns the seconds that a view saved by these cameras' samples.
    pub(in crate::core) fn credit(&mut self, used: &[u64], secs: f64, workers: &Workers) {
        let pixels = pixels_for(secs, workers);
        self.placement.credit(used, pixels / used.len().max(1) as f64);
    }

    /// Closes a tick: invests in the camera sets that save most for their price, once those that were chosen before are there. `lacking`
    /// is the number of processes that views lack, and whether samplers may leave views to the others. Returns the number of samples to
    /// render.
    pub(super) fn invest(&mut self, workers: &Workers, ticks: f64, (lacking, at_once): (f64, bool)) -> usize {
        let tick_secs = self.config.tick.as_secs_f64();
        self.investments.tick(ticks, lacking > 0.0);
        self.lot.passed_secs += ticks * tick_secs;
        if !(self.config.refining_share > 0.0) || self.placed_are_coming() {
            return 0;
        }
        self.lot = Lot::default();
        let Some(sample_secs) = self.sample_price_secs(workers) else { return 0 };
        let (mut missing, mut price_secs, mut lacking_secs) = (0, 0.0, lacking * tick_secs);
        while let Some(chosen) = self.best_camera_set(sample_secs, workers) {
            missing += self.missing(&chosen.camera_set).count();
            price_secs += chosen.price_secs;
            let pixels = pixels_for(chosen.secs_a_tick, workers) / chosen.camera_set.len() as f64;
            chosen.camera_set.iter().for_each(|(index, faces)| self.placement.invest(*index, *faces, pixels));
            self.changed = true;
            lacking_secs -= chosen.secs_a_tick;
            if !(lacking_secs > 0.0) {
                break;
            }
        }
        if at_once {
            let samplers = workers.queues().samplers().len().max(1);
            self.lot = Lot { secs: price_secs / samplers as f64, passed_secs: 0.0 };
        }
        missing
    }

    /// The camera set that saves most for its price, if there is room for it.
    fn best_camera_set(&self, sample_secs: f64, workers: &Workers) -> Option<Chosen> {
        let price = |camera_set: &[(u64, FaceMask)]| sample_secs * self.whole_samples(camera_set);
        let ticks_an_epoch = match self.versions.moves() {
            true => self.config.epoch.as_secs_f64() / self.config.tick.as_secs_f64(),
            false => f64::INFINITY,
        };
        let (camera_set, secs_a_tick) = self.investments.best(price, ticks_an_epoch)?;
        let most = (self.config.refining_bytes / self.sample_bytes(workers).max(1)) as usize;
        let placed_anew = camera_set.iter().filter(|(index, _)| !self.placement.is_placed(*index)).count();
        let there_is_room = self.placement.placed().count() + placed_anew <= most;
        let chosen =
            || Chosen { camera_set: camera_set.to_vec(), price_secs: price(camera_set), secs_a_tick };
        there_is_room.then(chosen)
    }

    /// Whether placed samples are not held by any worker yet.
    fn placed_are_coming(&self) -> bool {
        self.placement.placed().any(|index| self.is_coming(index))
    }

    fn is_coming(&self, index: u64) -> bool {
        let faces = self.placement.faces(index);
        faces.is_some_and(|faces| self.locations.holders_of(self.served(index), faces).next().is_none())
    }

    /// Samples that are rendered at once, since views lack time.
    pub(in crate::core) fn lot(&self) -> Lot {
        self.lot
    }

    /// Number of placed samples that no worker holds yet.
    pub(in crate::core) fn coming(&self) -> usize {
        self.placement.placed().filter(|index| self.is_coming(*index)).count()
    }

    /// Whether a worker renders samples at once, and leaves views to others.
    pub(in crate::core) fn renders_at_once(&self, worker: WorkerId) -> bool {
        self.lot.lasts() && self.has_to_render(worker, |index| self.is_coming(index))
    }

    /// The faces of a camera set that no worker holds or will hold, by camera.
    fn missing(&self, camera_set: &[(u64, FaceMask)]) -> impl Iterator<Item = FaceMask> {
        let lacked = |(index, faces): &(u64, FaceMask)| {
            let placed = self.placement.faces(*index).unwrap_or(FaceMask::NONE);
            faces.without(self.locations.faces_held(self.served(*index))).without(placed)
        };
        camera_set.iter().map(lacked).filter(|faces| !faces.is_empty())
    }

    /// Cost of rendering a camera set, in whole samples: that of the faces that no worker holds.
    fn whole_samples(&self, camera_set: &[(u64, FaceMask)]) -> f64 {
        self.missing(camera_set).map(FaceMask::share).sum()
    }

    /// Seconds of one process for a whole sample: measured, or else those of a direct view of its texels with four
    /// sub-samples each.
    fn sample_price_secs(&self, workers: &Workers) -> Option<f64> {
        let texels = self.set.rig.sample_texels() * SUB_SAMPLES;
        let as_a_view = || {
            let cost = workers.iter().find_map(|worker| worker.report().direct_cost);
            cost.map(|cost| cost.ms(texels) * 1e-3)
        };
        workers.costs().sample_secs().or_else(as_a_view).filter(|secs| *secs > 0.0)
    }
}

/// A camera set that is worth its price.
struct Chosen {
    camera_set: CameraSet,
    price_secs: f64,
    secs_a_tick: f64,
}

/// Converts seconds of one process to pixels of holes: the rays that could be traced in that time.
fn pixels_for(secs: f64, workers: &Workers) -> f64 {
    let ray_secs = workers.costs().ray_secs().unwrap_or(USUAL_RAY_SECS).max(1e-9);
    secs.max(0.0) / ray_secs
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::core::config::Config;
    use crate::core::event::WorkerId;
    use crate::core::tests::set_info;

    #[test]
    fn a_camera_set_costs_its_faces() {
        let mut samples = Samples::new(&Arc::new(Config::default()), Arc::new(set_info()));
        let faces = |bits| FaceMask::new(bits, "faces").unwrap();
        let camera_set = [(1, faces(0b11)), (2, faces(0b1)), (3, FaceMask::ALL)];
        assert_eq!(samples.whole_samples(&camera_set), 1.5);
        // One worker has a face that is wanted and one that is not; another has all of the last camera's sample.
        let [first, last] = [1, 3].map(|camera| samples.served(camera));
        samples.reported(WorkerId(1), (&[first], &[(first, faces(0b101))]), (&[], &[]));
        samples.reported(WorkerId(2), (&[last], &[]), (&[], &[]));
        assert_eq!(samples.missing(&camera_set).collect::<Vec<_>>(), [faces(0b10), faces(0b1)]);
        assert!((samples.whole_samples(&camera_set) - 2.0 / 6.0).abs() < 1e-12);
        assert_eq!(samples.whole_samples(&camera_set[2..]), 0.0, "nothing is missing");
    }
}
