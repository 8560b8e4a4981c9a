//! Correction of the model's costs by measured ones.

use std::collections::HashMap;

use super::super::smooth::Smoothed;
use super::Setting;

/// Greatest ratio of measured to predicted time, or its inverse. Beyond it is an accident, such as a compiled program
/// or a delayed process.
const WILD: f64 = 20.0;

/// The ratio of measured to predicted time of each setting. Settings without recent use take the ratio of all direct,
/// or of all reconstructed, views.
#[derive(Debug, Clone)]
pub struct Pace {
    weight: f64,
    settings: HashMap<Setting, Smoothed>,
    kinds: [Smoothed; 2],
}

impl Pace {
    /// Starts with the model's costs; `weight` of the newest observation is in (0, 1].
    pub fn new(weight: f64) -> Self {
        Self { weight, settings: HashMap::new(), kinds: [Smoothed::new(weight), Smoothed::new(weight)] }
    }

    /// Learns from a frame's measured time and the model's.
    pub fn observe(&mut self, setting: Setting, ms: f64, expected_ms: f64) {
        let ratio = ms / expected_ms;
        // A NaN is ignored.
        if !(ratio > 1.0 / WILD && ratio < WILD) {
            return;
        }
        let weight = self.weight;
        self.settings.entry(setting).or_insert_with(|| Smoothed::new(weight)).observe(ratio);
        self.kinds[usize::from(setting.is_direct())].observe(ratio);
    }

    /// The factor on the model's time of a setting.
    pub fn factor(&self, setting: Setting) -> f64 {
        let own = self.settings.get(&setting).and_then(Smoothed::value);
        own.or(self.kinds[usize::from(setting.is_direct())].value()).unwrap_or(1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slower_machine_changes_the_pace_and_accidents_do_not() {
        let direct = |samples_per_pixel| Setting::Direct { samples_per_pixel };
        let mut pace = Pace::new(0.3);
        assert_eq!(pace.factor(direct(1)), 1.0);
        for ms in [3.0, 3.1, 2.9, 3.0, f64::NAN, 0.0, 9e9, 3.0] {
            pace.observe(direct(1), ms, 2.0);
        }
        assert!((pace.factor(direct(1)) - 1.5).abs() < 0.05);
        assert!((pace.factor(direct(4)) - 1.5).abs() < 0.05, "its kind is as slow");
        let warp = Setting::of(&argus_scene::Plan::Warp(argus_scene::Warp::default()));
        assert_eq!(pace.factor(warp), 1.0);
    }
}
