//! What calibration measured of a scene.

use argus_scene::{PlanRequest, Rig, SceneHash};
use serde::{Deserialize, Serialize};

use super::choose::Candidate;
use super::regression::Belief;
use super::{Observed, Pace, Regression, Setting, Situation};

/// Of the file format and of the meaning of all features; a model of another version is not read.
pub const MODEL_VERSION: u32 = 1;

/// One calibration view, answered with several settings.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Trial {
    /// What could be said of it before.
    pub situation: Situation,
    /// Pixels.
    pub pixels: u64,
    /// What came of each setting; the same settings in the same order in all trials.
    pub answers: Vec<Answer>,
}

/// A setting's answer to a view.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Answer {
    /// Which.
    pub setting: Setting,
    /// Mean FLIP against the reference, at 67 pixels a degree.
    pub error: f64,
    /// Milliseconds of rendering it, alone.
    pub ms: f64,
    /// What its pixels say.
    pub observed: Observed,
}

/// Milliseconds of rendering a view.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Cost {
    /// Of a view without pixels.
    pub fixed_ms: f64,
    /// Of every million pixels.
    pub ms_per_megapixel: f64,
}

/// What is known of a setting.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Calibrated {
    /// Which.
    pub setting: Setting,
    /// What it costs.
    pub cost: Cost,
    /// Median error of the calibration views.
    pub median_error: f64,
    /// Error before anything was rendered, from [`Situation`].
    pub before: Regression,
    /// Error once a frame was seen, from [`Situation`] and [`Observed`].
    pub after: Vec<After>,
}

/// A setting's error once a frame of a setting was seen.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct After {
    /// The setting of the frame that was seen.
    pub seen: Setting,
    /// The error, given what was seen.
    pub error: Regression,
}

/// What calibration measured of one scene, rig and device.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Model {
    /// [`MODEL_VERSION`].
    pub version: u32,
    /// The scene.
    pub scene: SceneHash,
    /// Where its sample cameras stand.
    pub rig: Rig,
    /// Adapter, driver and version.
    pub device: String,
    /// Calibration views.
    pub views: usize,
    /// All settings that are chosen among.
    pub settings: Vec<Calibrated>,
}

impl Model {
    /// Fits to calibration views. `timings` are further measurements of cost, (setting, pixels, milliseconds), at
    /// other sizes than the trials'. Settings that were never measured, or too seldom, are left out.
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

    /// The file that a model is kept in: one for each scene, rig and device.
    pub fn file_name(&self) -> String {
        // FNV-1a; what it tells apart is written in the file.
        let text = format!("{} {:?} {}", self.version, self.rig, self.device);
        let hash = text
            .bytes()
            .fold(0xcbf2_9ce4_8422_2325_u64, |h, b| (h ^ u64::from(b)).wrapping_mul(0x0000_0100_0000_01b3));
        format!("{}-{hash:016x}.json", self.scene)
    }

    /// Whether it speaks of what is served, and in this version's words.
    pub fn fits(&self, scene: SceneHash, rig: &Rig) -> bool {
        self.version == MODEL_VERSION && self.scene == scene && self.rig == *rig && !self.settings.is_empty()
    }

    /// What is known of a setting.
    pub fn of(&self, setting: Setting) -> Option<&Calibrated> {
        self.settings.iter().find(|calibrated| calibrated.setting == setting)
    }

    /// The settings that a request allows, each with what is believed of it before anything was rendered.
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

    /// The same candidates, now that a frame of the setting `seen` was seen. Those that nothing is known of
    /// under this light keep what was believed before.
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
    /// A line through the median times at each size. With one size alone all of the cost is the pixels': small
    /// views are then thought cheaper than they are, large ones never.
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

    /// Of a view of that many pixels.
    pub fn ms(&self, pixels: u64) -> f64 {
        self.fixed_ms + self.ms_per_megapixel * pixels as f64 * 1e-6
    }
}

/// The lower of two middles.
fn median(mut values: Vec<f64>) -> Option<f64> {
    values.retain(|v| v.is_finite());
    values.sort_by(f64::total_cmp);
    values.get(values.len().saturating_sub(1) / 2).copied()
}
