//! References of judged views, and the errors of frames that came under load.

use std::time::Duration;

use anyhow::{Context as _, Result, ensure};
use argus_client::load::{burst, direct_view};
use argus_client::{Client, RenderOptions};
use argus_scene::metrics::{FlipTiles, flip_tiles};
use argus_scene::{Camera, Frame, Output, Plan, SceneState};
use image::RgbImage;

use crate::median::{mean, median};

/// Samples a side of a reference's pixel: 16 per pixel.
const REFERENCE_SIDE: u32 = 4;
/// Longest wait for a reference.
const PATIENCE: Duration = Duration::from_secs(60);
/// Side in pixels of the tiles that are judged one by one.
const TILE: u32 = 32;

/// A frame that came under load, and its camera.
#[derive(Debug, Clone)]
pub(super) struct Judged {
    pub(super) camera: Camera,
    pub(super) frame: Frame,
}

/// Errors of a phase's judged frames against their references; `None` if none came.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Errors {
    /// Number of judged frames.
    pub(super) judged: u64,
    /// Mean FLIP against 16 samples per pixel.
    pub(super) flip: Option<f64>,
    /// The worst tile's FLIP.
    pub(super) worst_tile: Option<f64>,
    /// Mean FLIP minus that of direct views of one sample per pixel at the same poses.
    pub(super) excess: Option<f64>,
    /// The largest difference of a tile's FLIP to the same tile of the direct view.
    pub(super) excess_tile: Option<f64>,
    /// Judged frames from samples whose error was predicted.
    pub(super) warped: u64,
    /// Share of these whose mean FLIP is at most the predicted one: the direct view's plus the predicted excess.
    pub(super) bounded: Option<f64>,
    /// Median of their predicted over true mean FLIP.
    pub(super) ratio: Option<f64>,
}

/// The FLIP of a judged frame and of the direct view of its pose.
struct Found<'a> {
    shown: FlipTiles,
    direct: &'a FlipTiles,
    /// The predicted excess FLIP over the direct view; frames from samples only.
    excess: Option<f64>,
}

impl Found<'_> {
    /// Predicted and true mean FLIP of a frame from samples.
    fn predicted_and_true(&self) -> Option<(f64, f64)> {
        self.excess.map(|excess| (self.direct.mean + excess, self.shown.mean))
    }
}

/// The reference of one pose and moment.
#[derive(Debug)]
struct Truth {
    camera: Camera,
    state: SceneState,
    reference: RgbImage,
    /// FLIP of a direct view with one sample per pixel.
    direct: FlipTiles,
}

/// The references of all poses and moments judged so far. In a still scene all modes share them.
#[derive(Debug, Default)]
pub(super) struct Truths(Vec<Truth>);

impl Truths {
    /// Judges frames. The service, which should be idle, first renders the missing references. Frames without a
    /// reference are skipped.
    ///
    /// # Errors
    /// A reference that is not what was requested, or an image of the wrong size.
    pub(super) async fn judge(&mut self, client: &Client, judged: &[Judged]) -> Result<Errors> {
        self.render_missing(client, judged).await?;
        let found = judged.iter().filter_map(|Judged { camera, frame }| {
            let truth = self.find(camera, frame.provenance.state)?;
            Some(image_of(frame).and_then(|image| {
                let shown = flip_tiles(&truth.reference, &image, TILE)?;
                Ok(Found { shown, direct: &truth.direct, excess: predicted_excess(frame) })
            }))
        });
        Ok(Errors::of(&found.collect::<Result<Vec<_>>>()?))
    }

    fn find(&self, camera: &Camera, state: SceneState) -> Option<&Truth> {
        self.0.iter().find(|truth| truth.camera == *camera && truth.state == state)
    }

    async fn render_missing(&mut self, client: &Client, judged: &[Judged]) -> Result<()> {
        let mut missing: Vec<(Camera, SceneState)> = Vec::new();
        for Judged { camera, frame } in judged {
            let wanted = (*camera, frame.provenance.state);
            if self.find(camera, wanted.1).is_none() && !missing.contains(&wanted) {
                missing.push(wanted);
            }
        }
        let Some(Judged { frame: like, .. }) = judged.first() else { return Ok(()) };
        let views = missing.iter().flat_map(|&(camera, state)| {
            [REFERENCE_SIDE, 1].map(|side| direct_view(like, camera, state, side))
        });
        let mut frames: Vec<Option<Frame>> = vec![None; 2 * missing.len()];
        // One view in flight per worker of a small cluster: nothing is timed here.
        let patience = RenderOptions { deadline: PATIENCE, ..RenderOptions::default() };
        burst(client, views.collect(), 2, &patience, |i, answer| frames[i] = Some(answer.frame)).await;
        for (&(camera, state), pair) in missing.iter().zip(frames.chunks_exact(2)) {
            let [Some(reference), Some(direct)] = pair else { continue };
            for frame in [reference, direct] {
                ensure!(
                    matches!(frame.provenance.plan, Plan::Direct { .. }) && frame.provenance.state == state,
                    "a reference is not what was asked for: {:?}",
                    frame.provenance
                );
            }
            let reference = image_of(reference)?;
            let direct = flip_tiles(&reference, &image_of(direct)?, TILE)?;
            self.0.push(Truth { camera, state, reference, direct });
        }
        Ok(())
    }
}

impl Errors {
    /// The errors of frames, tile by tile against the direct views of the same poses.
    fn of(found: &[Found<'_>]) -> Self {
        let worst = |of: &dyn Fn(f64, f64) -> f64| {
            let tiles = found.iter().flat_map(|f| f.shown.tiles.iter().zip(&f.direct.tiles));
            tiles.map(|(shown, direct)| of(*shown, *direct)).reduce(f64::max)
        };
        let average = |of: &dyn Fn(f64, f64) -> f64| {
            let each = found.iter().map(|f| of(f.shown.mean, f.direct.mean));
            (!found.is_empty()).then(|| mean(each))
        };
        let warped: Vec<(f64, f64)> = found.iter().filter_map(Found::predicted_and_true).collect();
        let of_warped = |of: &dyn Fn() -> f64| (!warped.is_empty()).then(of);
        // A frame without error has the best ratio if no error was predicted, and otherwise a very large one.
        let ratio = |(predicted, shown): &(f64, f64)| predicted / shown.max(1e-6);
        Self {
            judged: found.len() as u64,
            flip: average(&|shown, _| shown),
            worst_tile: worst(&|shown, _| shown),
            excess: average(&|shown, direct| shown - direct),
            excess_tile: worst(&|shown, direct| shown - direct),
            warped: warped.len() as u64,
            bounded: of_warped(&|| {
                mean(warped.iter().map(|(most, shown)| f64::from(u8::from(shown <= most))))
            }),
            ratio: of_warped(&|| median(&warped.iter().map(ratio).collect::<Vec<_>>())),
        }
    }
}

/// The predicted excess FLIP of a frame from samples; `None` for other frames and for frames whose plan was named.
fn predicted_excess(frame: &Frame) -> Option<f64> {
    let decision = frame.decision.filter(|_| matches!(frame.provenance.plan, Plan::Warp(_)))?;
    Some(decision.excess)
}

fn image_of(frame: &Frame) -> Result<RgbImage> {
    let color = frame.images[Output::Color].as_ref().context("the frame has no colour")?;
    RgbImage::from_raw(frame.width, frame.height, color.to_vec()).context("the frame is not of its size")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found<'a>(shown: &[f64], direct: &'a FlipTiles, excess: Option<f64>) -> Found<'a> {
        Found { shown: tiles(shown), direct, excess }
    }

    fn tiles(values: &[f64]) -> FlipTiles {
        FlipTiles { mean: mean(values.iter().copied()), tiles: values.to_vec() }
    }

    #[test]
    fn excess_compares_equal_tiles_rather_than_the_worst_ones() {
        // The direct view's worst tile is another one than the frame's.
        let direct = tiles(&[0.5, 0.1]);
        let errors = Errors::of(&[found(&[0.4, 0.4], &direct, None), found(&[0.5, 0.1], &direct, None)]);
        assert_eq!((errors.judged, errors.worst_tile), (2, Some(0.5)));
        assert!((errors.excess_tile.unwrap() - 0.3).abs() < 1e-12, "{errors:?}");
        assert!((errors.flip.unwrap() - 0.35).abs() < 1e-12, "{errors:?}");
        assert!((errors.excess.unwrap() - 0.05).abs() < 1e-12, "{errors:?}");
    }

    #[test]
    fn frames_better_than_direct_views_have_negative_excess() {
        let errors = Errors::of(&[found(&[0.1, 0.2], &tiles(&[0.2, 0.3]), None)]);
        assert!(errors.excess.unwrap() < 0.0 && errors.excess_tile.unwrap() < 0.0, "{errors:?}");
    }

    #[test]
    fn only_frames_from_samples_count_for_predictions() {
        let direct = tiles(&[0.1, 0.1]);
        let errors = Errors::of(&[
            found(&[0.1, 0.1], &direct, None),
            found(&[0.12, 0.12], &direct, Some(0.05)),
            found(&[0.2, 0.2], &direct, Some(0.05)),
        ]);
        assert_eq!((errors.judged, errors.warped, errors.bounded), (3, 2, Some(0.5)));
        assert!((errors.ratio.unwrap() - (1.25 + 0.75) / 2.0).abs() < 0.26, "{errors:?}");
        let none = Errors::of(&[found(&[0.0, 0.0], &tiles(&[0.0, 0.0]), Some(0.0))]);
        assert!(none.ratio.unwrap().is_finite());
    }

    #[test]
    fn without_judged_frames_there_are_no_errors() {
        assert_eq!(Errors::of(&[]), Errors::default());
    }
}
