//! Statistics of a frame's pixels that predict its error.

use argus_scene::{Frame, Output};
use serde::{Deserialize, Serialize};

/// Least difference of brightness at an edge, of 255.
const EDGE: u32 = 26;
/// Distance in pixels of the coarse detail.
const COARSE: usize = 4;

/// Statistics of a frame, each a mean over its pixels.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Observed {
    /// Difference of brightness (0 to 1) to the pixels right and below: what one ray per pixel gets wrong.
    pub detail: f64,
    /// Difference of brightness (0 to 1) to the pixels four columns and rows away: the part of the detail at that
    /// scale.
    pub coarse_detail: f64,
    /// Share of pixels on an edge.
    pub edges: f64,
    /// Share of pixels that no sample saw and that were not traced.
    pub unresolved: f64,
    /// Share of pixels where a second sample shows the same surface; 0 if unknown.
    pub agreeing: f64,
    /// Mean residual of the pixels that a sample saw, relative to the tolerance; 0 if unknown.
    pub residual: f64,
}

impl Observed {
    /// Number of features.
    pub const FEATURES: usize = 6;

    /// Measures a frame with colour and, if it was reconstructed, confidence. `None` without colour.
    pub fn of(frame: &Frame) -> Option<Self> {
        let columns = frame.width as usize;
        let pixels = columns * frame.height as usize;
        let color =
            frame.images[Output::Color].as_ref().filter(|color| color.len() == pixels * 3 && pixels > 0)?;
        // Rec. 601 luma in 8 bits. FLIP's weights differ by less than its errors vary.
        let luma = |p: &[u8]| (77 * u32::from(p[0]) + 150 * u32::from(p[1]) + 29 * u32::from(p[2])) >> 8;
        let luma: Vec<u8> = color.chunks_exact(3).map(|p| luma(p) as u8).collect();
        let (fine, edges) = differences(&luma, columns, 1);
        let (coarse, _) = differences(&luma, columns, COARSE);
        let share = |count: usize| count as f64 / pixels as f64;
        let (mut agreeing, mut residual) = (0.0, 0.0);
        if let Some(confidence) = frame.images[Output::Confidence].as_ref().filter(|c| c.len() == pixels) {
            let seen = confidence.iter().filter(|&&c| c != 0).count();
            let low: u64 = confidence.iter().filter(|&&c| c != 0).map(|c| u64::from(127 - (c & 127))).sum();
            agreeing = share(confidence.iter().filter(|&&c| c & 128 != 0).count());
            residual = low as f64 / 127.0 / seen.max(1) as f64;
        }
        Some(Self {
            detail: fine,
            coarse_detail: coarse,
            edges,
            unresolved: frame.unresolved_fraction,
            agreeing,
            residual,
        })
    }

    /// Features on which the error's logarithm depends about linearly.
    pub fn features(&self) -> [f64; Self::FEATURES] {
        let least = 1e-4;
        [
            (self.detail + least).ln(),
            ((self.coarse_detail + least) / (self.detail + least)).ln(),
            self.edges.sqrt(),
            self.unresolved.sqrt(),
            self.agreeing,
            self.residual,
        ]
    }
}

/// Mean absolute difference, 0 to 1, to the values `step` columns and rows away, and the share of values that differ
/// from either by more than [`EDGE`].
fn differences(luma: &[u8], columns: usize, step: usize) -> (f64, f64) {
    let (mut sum, mut count, mut edges) = (0_u64, 0_u64, 0_u64);
    for (y, row) in luma.chunks_exact(columns).enumerate() {
        let below = luma.get((y + step) * columns..).unwrap_or_default();
        let right = row.get(step..).unwrap_or_default();
        let mut across = |others: &[u8]| {
            for (a, b) in row.iter().zip(others) {
                let difference = u32::from(a.abs_diff(*b));
                sum += u64::from(difference);
                edges += u64::from(difference > EDGE);
            }
            count += row.len().min(others.len()) as u64;
        };
        across(right);
        across(&below[..below.len().min(columns)]);
    }
    let mean = |total: u64| total as f64 / count.max(1) as f64;
    (mean(sum) / 255.0, mean(edges))
}

#[cfg(test)]
mod tests {
    use argus_scene::{Images, Plan, Provenance, SceneHash, SceneState};

    use super::*;

    fn frame(width: u32, height: u32, color: Vec<u8>, confidence: Option<Vec<u8>>) -> Frame {
        Frame {
            images: Images::from([(Output::Color, color.into())])
                .with(Output::Confidence, confidence.map(bytes::Bytes::from)),
            unresolved_fraction: 0.25,
            ..Frame::without_images(
                width,
                height,
                Provenance::of_plan(SceneHash([0; 32]), SceneState::default(), Plan::direct(1)),
            )
        }
    }

    #[test]
    fn a_flat_frame_has_no_detail_and_a_checkerboard_the_most() {
        let flat = Observed::of(&frame(8, 8, vec![90; 192], None)).unwrap();
        assert_eq!((flat.detail, flat.coarse_detail, flat.edges), (0.0, 0.0, 0.0));
        let board = (0..64).flat_map(|i| [if (i % 8 + i / 8) % 2 == 0 { 0 } else { 255 }; 3]);
        let board = Observed::of(&frame(8, 8, board.collect(), None)).unwrap();
        assert!(board.detail > 0.99 && board.edges == 1.0, "{board:?}");
        assert_eq!(board.coarse_detail, 0.0, "its period is two pixels");
    }

    #[test]
    fn confidence_is_decoded_by_its_bits() {
        let seen = Observed::of(&frame(2, 2, vec![0; 12], Some(vec![0, 127, 255, 128]))).unwrap();
        assert_eq!((seen.agreeing, seen.unresolved), (0.5, 0.25));
        assert!((seen.residual - 1.0 / 3.0).abs() < 1e-12, "{seen:?}");
    }

    #[test]
    fn frames_of_one_pixel_or_without_colour_are_accepted() {
        let one = Observed::of(&frame(1, 1, vec![7; 3], Some(vec![0]))).unwrap();
        assert!(one.features().iter().all(|f| f.is_finite()), "{one:?}");
        assert!(
            Observed::of(&Frame { images: Images::default(), ..frame(1, 1, vec![7; 3], None) }).is_none()
        );
        assert!(Observed::of(&frame(2, 1, vec![7; 3], None)).is_none(), "short");
    }
}
