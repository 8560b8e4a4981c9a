//! What is said of two renderings that differ in some effects: their change beside its bound.

use argus_scene::EffectPlan;
use argus_scene::effects::EffectKind;
use argus_scene::metrics::{CompareError, flip_mean};
use argus_scene::tone::srgb_from_linear;
use image::RgbImage;

/// Difference of images.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Change {
    /// Largest change of a byte, 0 to 255.
    pub(super) most: u8,
    /// Mean change of a byte.
    pub(super) mean: f64,
    /// Mean FLIP.
    pub(super) flip: f64,
}

impl Change {
    /// The change of some images into others, which are as many and of the same sizes.
    ///
    /// # Errors
    /// Images of different sizes, or without pixels.
    pub(super) fn between(before: &[RgbImage], after: &[RgbImage]) -> Result<Self, CompareError> {
        let mut change = Self::default();
        for (before, after) in before.iter().zip(after) {
            change.flip += flip_mean(before, after)?;
            let off = before.iter().zip(after.iter()).map(|(a, b)| a.abs_diff(*b));
            change.most = change.most.max(off.clone().max().unwrap_or(0));
            change.mean += off.map(f64::from).sum::<f64>() / before.len().max(1) as f64;
        }
        let images = before.len().max(1) as f64;
        Ok(Self { flip: change.flip / images, mean: change.mean / images, ..change })
    }
}

/// How a row differs from `auto`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Against {
    /// It is `auto`.
    Itself,
    /// It has more effects.
    On,
    /// It has fewer effects.
    Off,
}

/// A display-linear bound that says nothing.
const NO_BOUND: f64 = 1.0;

/// The bound of switching some effects together, in bytes, of which one is rounding: that of the sum of the rows' bounds.
/// `None` if a row's bound is 1, which says nothing, or the sum is.
pub(super) fn bound_bytes(plan: &EffectPlan, switched: &[EffectKind]) -> Option<f64> {
    let shadows = switched.contains(&EffectKind::Shadows);
    let sum: f64 = switched
        .iter()
        // Both change the same light's share, which stays between 0 and 1.
        .filter(|effect| !(shadows && **effect == EffectKind::SoftShadows))
        .map(|effect| plan.row(*effect).map_or(0.0, |row| row.bound))
        .sum();
    (sum < NO_BOUND).then(|| 255.0 * f64::from(srgb_from_linear(sum as f32)) + 1.0)
}

/// Largest share of a frame that effects which changed no pixel may cost.
pub(super) const IDLE_SHARE: f64 = 0.05;
/// Most bytes of noise that are added to a bound.
pub(super) const MOST_NOISE: u8 = 2;

/// What was found of a row.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Found {
    pub(super) against: Against,
    /// Bytes; `None` without a bound.
    pub(super) bound: Option<f64>,
    /// Largest change of a byte with many rays, of views and sample.
    pub(super) changed: u8,
    /// Noise of that change, bytes.
    pub(super) noise: u8,
    /// Share of a frame that the switched effects cost: the larger one of view and sample.
    pub(super) share: f64,
}

/// The verdicts on a row; `None` where a question does not arise.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Verdicts {
    /// No byte changed by more than the bound.
    pub(super) within: Option<bool>,
    /// Effects that are switched off change some byte.
    pub(super) moves: Option<bool>,
    /// Effects of `auto` that changed no byte cost at most [`IDLE_SHARE`] of a frame.
    pub(super) cheap: Option<bool>,
}

impl Verdicts {
    pub(super) fn of(found: &Found) -> Self {
        let Found { against, bound, changed, noise, share } = *found;
        let most = bound.map(|bound| bound + f64::from(noise.min(MOST_NOISE)));
        let is_switched = against != Against::Itself;
        Self {
            within: most.filter(|_| is_switched).map(|most| f64::from(changed) <= most),
            moves: (against == Against::Off).then_some(changed > 0),
            // NaN is not cheap.
            cheap: (against == Against::Off && changed == 0).then_some(share <= IDLE_SHARE),
        }
    }

    /// Whether every verdict is good; `None` if there is none.
    pub(super) fn passed(self) -> Option<bool> {
        let all = [self.within, self.moves, self.cheap];
        all.iter().any(Option::is_some).then(|| all.iter().all(|verdict| *verdict != Some(false)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const GOOD: Found = Found { against: Against::On, bound: Some(4.0), changed: 4, noise: 0, share: 0.5 };

    #[test]
    fn a_change_beyond_the_bound_fails() {
        assert_eq!(Verdicts::of(&GOOD).passed(), Some(true));
        for against in [Against::On, Against::Off] {
            assert_eq!(Verdicts::of(&Found { against, bound: Some(3.9), ..GOOD }).within, Some(false));
            assert_eq!(Verdicts::of(&Found { against, bound: None, changed: 255, ..GOOD }).within, None);
        }
        assert_eq!(Verdicts::of(&Found { bound: Some(3.9), ..GOOD }).passed(), Some(false));
    }

    #[test]
    fn noise_is_added_to_the_bound_up_to_two_bytes() {
        let noisy = |changed, noise| Verdicts::of(&Found { changed, noise, ..GOOD }).within;
        assert_eq!((noisy(6, 2), noisy(6, 1), noisy(7, 200)), (Some(true), Some(false), Some(false)));
    }

    #[test]
    fn effects_that_are_switched_off_and_change_nothing_fail_and_are_dear_beyond_a_twentieth() {
        let idle = Found { against: Against::Off, changed: 0, share: 0.04, ..GOOD };
        let verdicts = Verdicts::of(&idle);
        assert_eq!((verdicts.moves, verdicts.cheap), (Some(false), Some(true)));
        for share in [0.06, f64::NAN] {
            assert_eq!(Verdicts::of(&Found { share, ..idle }).cheap, Some(false));
        }
        let works = Verdicts::of(&Found { changed: 1, share: 0.9, ..idle });
        assert_eq!((works.moves, works.cheap), (Some(true), None));
    }

    #[test]
    fn auto_itself_is_not_judged() {
        let found = Found { against: Against::Itself, bound: Some(1.0), changed: 9, ..GOOD };
        assert_eq!(Verdicts::of(&found).passed(), None);
    }

    #[test]
    fn changes_are_the_largest_and_the_mean_of_all_images() {
        let grey = |level| RgbImage::from_pixel(8, 8, image::Rgb([level; 3]));
        let change = Change::between(&[grey(10), grey(20)], &[grey(10), grey(26)]).unwrap();
        assert_eq!((change.most, change.mean), (6, 3.0));
        assert!(change.flip > 0.0);
        assert_eq!(Change::between(&[grey(3)], &[grey(3)]).unwrap(), Change::default());
        assert!(Change::between(&[grey(3)], &[RgbImage::new(3, 3)]).is_err());
    }
}
