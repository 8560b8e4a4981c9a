//! Calibrated models of a scene's errors and costs.

use argus_scene::{PlanRequest, Rig, SceneHash};
use serde::{Deserialize, Serialize};

use super::super::smooth::median;
use super::choose::Candidate;
use super::regression::Belief;
use super::{Observed, Pace, Regression, Setting, Situation};

/// Version of the file format and of the features. Models of other versions are not read.
pub const MODEL_VERSION: u32 = 1;

/// One calibration view, rendered with several settings.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Trial {
    /// Its features before rendering.
    pub situation: Situation,
    /// Number of its pixels.
    pub pixels: u64,
    /// Its answer with each setting; the settings and their order are the same in all trials.
    pub answers: Vec<Answer>,
}

/// The frame of one setting for a calibration view.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Answer {
    /// The setting.
    pub setting: Setting,
    /// Mean FLIP against the reference, at 67 pixels a degree.
    pub error: f64,
    /// Milliseconds of rendering it alone.
    pub ms: f64,
    /// The statistics of its pixels.
    pub observed: Observed,
}

/// The cost of rendering a view, linear in its pixels.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Cost {
    /// Milliseconds of a view without pixels.
    pub fixed_ms: f64,
    /// Milliseconds per million pixels.
    pub ms_per_megapixel: f64,
}

/// The calibration of a setting.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Calibrated {
    /// The setting.
    pub setting: Setting,
    /// Its cost.
    pub cost: Cost,
    /// Median error of the calibration views.
    pub median_error: f64,
    /// Regression of the error before rendering, on [`Situation`].
    pub before: Regression,
    /// Regressions of the error after a frame, on [`Situation`] and [`Observed`].
    pub after: Vec<After>,
}

/// A setting's error after a frame of another setting, or of its own.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct After {
    /// The setting of the observed frame.
    pub seen: Setting,
    /// Regression of the error.
    pub error: Regression,
}

/// The calibration of one scene, rig and device.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Model {
    /// [`MODEL_VERSION`] when it was written.
    pub version: u32,
    /// The scene.
    pub scene: SceneHash,
    /// The rig of its sample cameras.
    pub rig: Rig,
    /// Adapter, driver and version.
    pub device: String,
    /// Number of calibration views.
    pub views: usize,
    /// All calibrated settings.
    pub settings: Vec<Calibrated>,
}

impl Model {
    /// Fits a model to calibration views. `timings` are further costs at other sizes: (setting, pixels,
    /// milliseconds). Settings with too few measurements are omitted.
    pub fn fit(
        scene: SceneHash,
        rig: Rig,
        device: String,
        trials: &[Trial],
        timings: &[(Setting, u64, f64)],
    ) -> Self {
        let offered = trials.first().map_or(&[][..], |trial| &trial.answers);
        let complete: Vec<&Trial> = trials
            .iter()
            .filter(|trial| {
                trial.answers.len() == offered.len()
                    && trial.answers.iter().zip(offered).all(|(a, b)| a.setting == b.setting)
            })
            .collect();
        let before: Vec<Vec<f64>> = complete.iter().map(|trial| trial.situation.0.to_vec()).collect();
        let calibrated = |i: usize| {
            let setting = offered[i].setting;
            let errors: Vec<f64> = complete.iter().map(|trial| trial.answers[i].error).collect();
            let after = (0..offered.len()).filter_map(|seen| {
                let rows: Vec<Vec<f64>> = complete
                    .iter()
                    .map(|trial| after_features(&trial.situation, &trial.answers[seen].observed))
                    .collect();
                Some(After { seen: offered[seen].setting, error: Regression::fit(&rows, &errors)? })
            });
            let own = complete.iter().map(|trial| (trial.pixels, trial.answers[i].ms));
            let more = timings.iter().filter(|(of, ..)| *of == setting).map(|&(_, pixels, ms)| (pixels, ms));
            Some(Calibrated {
                setting,
                cost: Cost::fit(own.chain(more))?,
                median_error: median(errors.clone())?,
                before: Regression::fit(&before, &errors)?,
                after: after.collect(),
            })
        };
        let settings = (0..offered.len()).filter_map(calibrated).collect();
        Self { version: MODEL_VERSION, scene, rig, device, views: complete.len(), settings }
    }

    /// The name of the model's file: one for each scene, rig and device.
    pub fn file_name(&self) -> String {
        // FNV-1a over what the file itself states.
        let text = format!("{} {:?} {}", self.version, self.rig, self.device);
        let hash = text
            .bytes()
            .fold(0xcbf2_9ce4_8422_2325_u64, |h, b| (h ^ u64::from(b)).wrapping_mul(0x0000_0100_0000_01b3));
        format!("{}-{hash:016x}.json", self.scene)
    }

    /// Whether it is of this scene and rig, and of this version.
    pub fn fits(&self, scene: SceneHash, rig: &Rig) -> bool {
        self.version == MODEL_VERSION && self.scene == scene && self.rig == *rig && !self.settings.is_empty()
    }

    /// The calibration of one setting.
    pub fn of(&self, setting: Setting) -> Option<&Calibrated> {
        self.settings.iter().find(|calibrated| calibrated.setting == setting)
    }

    /// The settings that a request allows, with beliefs before rendering.
    pub fn candidates(
        &self,
        request: &PlanRequest,
        situation: &Situation,
        pixels: u64,
        pace: &Pace,
    ) -> Vec<Candidate<'_>> {
        let allowed = self.settings.iter().filter(|c| c.setting.is_allowed_by(request));
        allowed
            .map(|calibrated| Candidate {
                setting: calibrated.setting,
                ms: calibrated.cost.ms(pixels) * pace.factor(calibrated.setting),
                error: calibrated.before.believe(&situation.0),
                judged_factor: calibrated.after(calibrated.setting).map_or(f64::INFINITY, Regression::factor),
            })
            .collect()
    }

    /// The candidates after a frame of the setting `seen`. Settings without a regression for it keep their beliefs.
    pub fn enlightened<'a>(
        &'a self,
        candidates: &[Candidate<'a>],
        situation: &Situation,
        seen: Setting,
        observed: &Observed,
    ) -> Vec<Candidate<'a>> {
        let features = after_features(situation, observed);
        let believe = |candidate: &Candidate<'a>| -> Candidate<'a> {
            let after = self.of(candidate.setting).and_then(|calibrated| calibrated.after(seen));
            let error: Belief<'a> = after.map_or(candidate.error, |error| error.believe(&features));
            Candidate { error, ..*candidate }
        };
        candidates.iter().map(believe).collect()
    }
}

fn after_features(situation: &Situation, observed: &Observed) -> Vec<f64> {
    situation.0.into_iter().chain(observed.features()).collect()
}

impl Calibrated {
    fn after(&self, seen: Setting) -> Option<&Regression> {
        self.after.iter().find(|after| after.seen == seen).map(|after| &after.error)
    }
}

impl Cost {
    /// Fits a line through the median times at each size. With only one size, the cost is proportional to the pixels:
    /// small views are then underestimated, large ones never.
    pub(crate) fn fit(measured: impl Iterator<Item = (u64, f64)>) -> Option<Self> {
        let mut measured: Vec<(u64, f64)> = measured.filter(|(_, ms)| *ms >= 0.0 && ms.is_finite()).collect();
        measured.sort_by_key(|m| m.0);
        let sizes: Vec<(f64, f64)> = measured
            .chunk_by(|a, b| a.0 == b.0)
            .filter_map(|same| Some((same[0].0 as f64 * 1e-6, median(same.iter().map(|s| s.1).collect())?)))
            .collect();
        let n = sizes.len() as f64;
        let (x, y) = sizes.iter().fold((0.0, 0.0), |(x, y), s| (x + s.0 / n, y + s.1 / n));
        let (xx, xy) =
            sizes.iter().fold((0.0, 0.0), |(xx, xy), s| (xx + (s.0 - x).powi(2), xy + (s.0 - x) * (s.1 - y)));
        let slope = if xx > 0.0 { (xy / xx).max(0.0) } else { 0.0 };
        let fixed = y - slope * x;
        match (sizes.len(), fixed > 0.0) {
            (0, _) => None,
            (2.., true) => Some(Self { fixed_ms: fixed, ms_per_megapixel: slope }),
            _ => Some(Self { fixed_ms: 0.0, ms_per_megapixel: y / x.max(1e-9) }),
        }
    }

    /// Milliseconds of a view of this many pixels.
    pub fn ms(&self, pixels: u64) -> f64 {
        self.fixed_ms + self.ms_per_megapixel * pixels as f64 * 1e-6
    }
}
