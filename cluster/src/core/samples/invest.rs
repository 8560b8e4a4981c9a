//! Which samples are worth their price: their savings and costs in seconds of one process.

use argus_scene::FaceMask;

use super::Samples;
use super::investments::Bundle;
use crate::core::workers::Workers;

/// The usual number of sub-samples of a texel.
const SUB_SAMPLES: u64 = 4;

/// Seconds of a single ray until one was measured.
const USUAL_RAY_SECS: f64 = 2e-6;

impl Samples {
    /// Learns the seconds that views would have saved with these faces of cameras' samples.
    pub(in crate::core) fn learn_bundle(&mut self, bundle: Bundle, secs: f64) {
        self.investments.learn(bundle, secs);
    }

    /// Learns the seconds that a view saved by these cameras' samples.
    pub(in crate::core) fn credit(&mut self, used: &[u64], secs: f64, workers: &Workers) {
        let pixels = pixels_for(secs, workers);
        self.placement.credit(used, pixels / used.len().max(1) as f64);
    }

    /// Closes a tick: invests in the bundle that saves most for its price. One bundle is rendered at a time. Returns
    /// the number of samples to render.
    pub(super) fn invest(&mut self, workers: &Workers, ticks: f64) -> usize {
        self.investments.tick(ticks);
        let is_coming = |index: u64| {
            let faces = self.placement.faces(index);
            faces.is_some_and(|faces| self.locations.holders_of(self.served(index), faces).next().is_none())
        };
        if !(self.config.refining_share > 0.0) || self.placement.placed().any(is_coming) {
            return 0;
        }
        let Some(sample_secs) = self.sample_price_secs(workers) else { return 0 };
        let price = |bundle: &[(u64, FaceMask)]| sample_secs * self.whole_samples(bundle);
        let ticks_an_epoch = match self.versions.moves() {
            true => self.config.epoch.as_secs_f64() / self.config.tick.as_secs_f64(),
            false => f64::INFINITY,
        };
        let Some((bundle, secs)) = self.investments.best(price, ticks_an_epoch) else { return 0 };
        let (bundle, missing) = (bundle.to_vec(), self.missing(bundle).count());
        let most = (self.config.refining_bytes / self.sample_bytes(workers).max(1)) as usize;
        let placed_anew = bundle.iter().filter(|(index, _)| !self.placement.is_placed(*index)).count();
        if self.placement.placed().count() + placed_anew > most {
            return 0;
        }
        let pixels = pixels_for(secs, workers) / bundle.len() as f64;
        bundle.iter().for_each(|(index, faces)| self.placement.invest(*index, *faces, pixels));
        self.changed = true;
        missing
    }

    /// The faces of a bundle that no worker holds, by camera.
    fn missing(&self, bundle: &[(u64, FaceMask)]) -> impl Iterator<Item = FaceMask> {
        let lacked =
            |(index, faces): &(u64, FaceMask)| faces.without(self.locations.faces_held(self.served(*index)));
        bundle.iter().map(lacked).filter(|faces| !faces.is_empty())
    }

    /// Cost of rendering a bundle, in whole samples: that of the faces that no worker holds.
    fn whole_samples(&self, bundle: &[(u64, FaceMask)]) -> f64 {
        self.missing(bundle).map(FaceMask::share).sum()
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
    fn a_bundle_costs_its_faces() {
        let mut samples = Samples::new(&Arc::new(Config::default()), Arc::new(set_info()));
        let faces = |bits| FaceMask::new(bits, "faces").unwrap();
        let bundle = [(1, faces(0b11)), (2, faces(0b1)), (3, FaceMask::ALL)];
        assert_eq!(samples.whole_samples(&bundle), 1.5);
        // One worker has a face that is wanted and one that is not; another has all of the last camera's sample.
        let [first, last] = [1, 3].map(|camera| samples.served(camera));
        samples.reported(WorkerId(1), (&[first], &[(first, faces(0b101))]), (&[], &[]));
        samples.reported(WorkerId(2), (&[last], &[]), (&[], &[]));
        assert_eq!(samples.missing(&bundle).collect::<Vec<_>>(), [faces(0b10), faces(0b1)]);
        assert!((samples.whole_samples(&bundle) - 2.0 / 6.0).abs() < 1e-12);
        assert_eq!(samples.whole_samples(&bundle[2..]), 0.0, "nothing is missing");
    }
}
