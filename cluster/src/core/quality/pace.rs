//! Costs kept up to date: what frames were seen to cost against what the model had said.

use std::collections::HashMap;

use super::super::smooth::Smoothed;
use super::Setting;

/// A frame may have been this many times as slow, or as fast, as was predicted, before it is taken for an
/// accident (a program that was compiled, a process that was held up).
const WILD: f64 = 20.0;

/// The ratio of measured to predicted time of each setting, and, for settings that were not used lately, of
/// all direct and of all reconstructed views.
#[derive(Debug, Clone)]
pub struct Pace {
    weight: f64,
    settings: HashMap<Setting, Smoothed>,
    kinds: [Smoothed; 2],
}

impl Pace {
    /// Costs are as the model has them; `weight` of the newest observation in (0, 1].
    pub fn new(weight: f64) -> Self {
        Self { weight, settings: HashMap::new(), kinds: [Smoothed::new(weight), Smoothed::new(weight)] }
    }

    /// A frame took `ms` where the model alone says `expected_ms`.
    pub fn observe(&mut self, setting: Setting, ms: f64, expected_ms: f64) {
        let ratio = ms / expected_ms;
        // Written so that NaN is refused.
        if !(ratio > 1.0 / WILD && ratio < WILD) {
            return;
        }
        let weight = self.weight;
        self.settings.entry(setting).or_insert_with(|| Smoothed::new(weight)).observe(ratio);
        self.kinds[usize::from(setting.is_direct())].observe(ratio);
    }

    /// What the model's time for a setting is to be multiplied by.
    pub fn factor(&self, setting: Setting) -> f64 {
        let own = self.settings.get(&setting).and_then(Smoothed::value);
        own.or(self.kinds[usize::from(setting.is_direct())].value()).unwrap_or(1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slower_machine_is_noticed_and_accidents_are_not() {
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
