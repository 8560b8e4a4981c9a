//! Which samples are worth their price: their savings and costs in seconds of one process.

use super::Samples;
use crate::core::workers::Workers;

/// The usual number of sub-samples of a texel.
const SUB_SAMPLES: u64 = 4;

/// Seconds of a single ray until one was measured.
const USUAL_RAY_SECS: f64 = 2e-6;

impl Samples {
    /// Learns the seconds that views would have saved with these cameras' samples.
    pub(in crate::core) fn learn_bundle(&mut self, cameras: Vec<u64>, secs: f64) {
        self.investments.learn(cameras, secs);
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
        let is_coming =
            |index: u64| self.placement.is_placed(index) && !self.locations.is_held(self.served(index));
        if !(self.config.refining_share > 0.0) || self.placement.placed().any(is_coming) {
            return 0;
        }
        let Some(sample_secs) = self.sample_price_secs(workers) else { return 0 };
        let missing = |bundle: &[u64]| -> Vec<u64> {
            let lacks = |index: &u64| !self.locations.is_held(self.served(*index));
            bundle.iter().copied().filter(lacks).collect()
        };
        let price = |bundle: &[u64]| sample_secs * missing(bundle).len() as f64;
        let ticks_an_epoch = match self.versions.moves() {
            true => self.config.epoch.as_secs_f64() / self.config.tick.as_secs_f64(),
            false => f64::INFINITY,
        };
        let Some((bundle, secs)) = self.investments.best(price, ticks_an_epoch) else { return 0 };
        let (bundle, missing) = (bundle.to_vec(), missing(bundle).len());
        let most = (self.config.refining_bytes / self.sample_bytes(workers).max(1)) as usize;
        if self.placement.placed().count() + missing > most {
            return 0;
        }
        let pixels = pixels_for(secs, workers) / bundle.len() as f64;
        bundle.iter().for_each(|index| self.placement.invest(*index, pixels));
        self.changed = true;
        missing
    }

    /// Seconds of one process for a sample: measured, or else those of a direct view of its texels with four
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
