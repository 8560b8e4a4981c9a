//! Whether a picture can be made out: its brightness, and what is lost in white and in black.

use image::RgbImage;

/// Bounds of the mean display value of visible surfaces.
pub(super) const MEAN: [f64; 2] = [0.2, 0.6];
/// Largest share of visible surfaces that is clipped white.
pub(super) const MOST_WHITE: f64 = 0.08;
/// Largest share of visible surfaces that is nearly black.
pub(super) const MOST_DARK: f64 = 0.25;
/// A pixel is nearly black if all of its channels are below this byte.
pub(super) const DARK: u8 = 4;
/// A pixel is clipped white if all of its channels are at least this byte.
const WHITE: u8 = 254;

/// What a picture shows of the surfaces in it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Shown {
    /// Share of the pixels that show a surface.
    pub(super) visible: f64,
    /// Mean display value of those pixels, 0 to 1; NaN if there is none.
    pub(super) mean: f64,
    /// Share of those pixels that is clipped white.
    pub(super) white: f64,
    /// Share of those pixels that is nearly black.
    pub(super) dark: f64,
}

impl Shown {
    /// Measures a picture. `ranges` has metres to the surface of each pixel, +inf for the sky.
    pub(super) fn of(image: &RgbImage, ranges: &[f32]) -> Self {
        let surfaces = image.pixels().zip(ranges).filter(|(_, range)| range.is_finite());
        let (mut count, mut sum, mut white, mut dark) = (0u64, 0u64, 0u64, 0u64);
        for (pixel, _) in surfaces {
            count += 1;
            sum += pixel.0.iter().map(|byte| u64::from(*byte)).sum::<u64>();
            white += u64::from(pixel.0.iter().all(|byte| *byte >= WHITE));
            dark += u64::from(pixel.0.iter().all(|byte| *byte < DARK));
        }
        let share = |part: u64| part as f64 / count as f64;
        Self {
            visible: count as f64 / ranges.len() as f64,
            mean: sum as f64 / (count as f64 * 3.0 * 255.0),
            white: share(white),
            dark: share(dark),
        }
    }

    /// Whether surfaces are visible, neither dark nor washed out.
    pub(super) fn passed(&self) -> bool {
        // NaN passes no comparison.
        (MEAN[0]..=MEAN[1]).contains(&self.mean) && self.white <= MOST_WHITE && self.dark <= MOST_DARK
    }
}

#[cfg(test)]
mod tests {
    use image::Rgb;

    use super::*;

    /// A picture of 100 pixels: the first ones of these levels, the rest grey, and the last ten sky.
    fn shown(levels: &[u8], grey: u8) -> Shown {
        let level = |i: u32| levels.get(i as usize).copied().unwrap_or(grey);
        let image = RgbImage::from_fn(100, 1, |x, _| Rgb([level(x); 3]));
        let ranges: Vec<f32> = (0..100).map(|i| if i < 90 { 2.0 } else { f32::INFINITY }).collect();
        Shown::of(&image, &ranges)
    }

    #[test]
    fn pictures_that_are_dark_washed_out_or_empty_do_not_pass() {
        assert_eq!(shown(&[], 102), Shown { visible: 0.9, mean: 0.4, white: 0.0, dark: 0.0 });
        for (levels, grey, passes) in [
            (&[][..], 102, true),
            (&[], 50, false),
            (&[], 154, false),
            (&[255; 7], 100, true),
            (&[255; 8], 100, false),
            (&[3; 22], 100, true),
            (&[3; 23], 100, false),
            (&[4; 23], 100, true),
        ] {
            assert_eq!(shown(levels, grey).passed(), passes, "{levels:?} {grey}");
        }
        let nothing = Shown::of(&RgbImage::new(2, 1), &[f32::INFINITY; 2]);
        assert!(nothing.mean.is_nan() && !nothing.passed());
    }

    #[test]
    fn a_saturated_colour_is_not_white() {
        let red = RgbImage::from_pixel(4, 4, Rgb([255, 0, 0]));
        assert_eq!(Shown::of(&red, &[1.0; 16]).white, 0.0);
    }
}
