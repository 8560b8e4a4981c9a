//! Checks a frame from samples against the planner's error bound. The worker sees the pixels, which the planner only
//! predicted.
//!
//! Two faults are detected. Samples may miss a part of the view, which the frame itself says. And texels may be too
//! coarse: a surface that is far from its sample and near the viewer shows blocks. Only the ranges reveal this.

use argus_scene::rig::Coverage;
use argus_scene::{Camera, Frame, Output, SampleCamera};
use glam::DVec2;

use crate::core::planner::{LEAST_FINE, MOST_TEXEL_PIXELS, predicted_excess};

/// Greatest share of pixels that samples may miss. Tracing more holes costs much of a direct view, and samples are
/// unreliable around holes.
const MOST_UNRESOLVED: f64 = 0.05;

/// Greatest share of pixels that recent frames may miss. Most of them lie beyond the frames' borders, and not around
/// silhouettes.
const MOST_UNRESOLVED_BY_FRAMES: f64 = 0.15;

/// Columns and rows of the checked pixels. About 770 pixels suffice to distinguish shares of 95% and 93%.
const GRID: [u32; 2] = [32, 24];

/// The fault of a frame from samples; `None` if it is within the bound. `samples` are the cameras of its plan's
/// samples, in order. One that shows the whole view finely is good enough whatever the bound; under load `max_excess` may be
/// greater than such a frame's error, and then a coarser one is good enough too. Reads the frame's range and source images.
pub(super) fn shortfall(
    frame: &Frame,
    camera: &Camera,
    samples: &[SampleCamera],
    max_excess: f64,
) -> Option<String> {
    let is_of_frames = !frame.provenance.plan.frames().is_empty();
    let most = if is_of_frames { MOST_UNRESOLVED_BY_FRAMES } else { MOST_UNRESOLVED };
    if frame.unresolved_fraction > most {
        return Some(format!("the samples miss {:.1}% of the view", frame.unresolved_fraction * 100.0));
    }
    let fine = fine_share(frame, camera, samples)?;
    let covered = 1.0 - frame.unresolved_fraction;
    let (excess, _) = predicted_excess(Some(Coverage { covered, fine: fine * covered }), 1.0);
    let is_coarse = fine < LEAST_FINE && excess > max_excess;
    is_coarse.then(|| format!("the samples are too coarse for {:.1}% of the view", (1.0 - fine) * 100.0))
}

/// Share of the checked pixels whose texel is fine enough. `None` if no pixel has a source.
fn fine_share(frame: &Frame, camera: &Camera, samples: &[SampleCamera]) -> Option<f64> {
    let (ranges, sources) =
        (frame.images[Output::Range].as_ref()?.as_chunks::<4>().0, frame.images[Output::Source].as_ref()?);
    let [width, height] = [frame.width, frame.height];
    let pixel_angle = 2.0 * camera.tan_half_fov(width, height).y / f64::from(height.max(1));
    let angles: Vec<f64> = samples.iter().map(SampleCamera::texel_angle).collect();
    let [columns, rows] = [GRID[0].min(width), GRID[1].min(height)];
    let (mut checked, mut fine) = (0_u32, 0_u32);
    for i in 0..columns * rows {
        let middle = |i: u32, parts: u32, side: u32| {
            (u64::from(2 * i + 1) * u64::from(side) / u64::from(2 * parts)) as u32
        };
        let (x, y) = (middle(i % columns, columns, width), middle(i / columns, rows, height));
        let at = y as usize * width as usize + x as usize;
        let (Some(range), Some(source)) = (ranges.get(at), sources.get(at)) else { continue };
        // Source 0 is a guess, which the mask counts.
        let Some(index) = usize::from(*source).checked_sub(1).filter(|index| *index < samples.len()) else {
            continue;
        };
        let range = f64::from(f32::from_le_bytes(*range));
        let farther = match range == f64::INFINITY {
            // The sky is equally far from both.
            true => 1.0,
            false => {
                let ray = camera.direction(DVec2::new(f64::from(x), f64::from(y)) + 0.5, width, height);
                (camera.eye + range * ray).distance(samples[index].center()) / range
            }
        };
        checked += 1;
        // Written so that NaN is not fine.
        fine += u32::from(range > 0.0 && farther * angles[index] <= MOST_TEXEL_PIXELS * pixel_angle);
    }
    (checked > 0).then(|| f64::from(fine) / f64::from(checked))
}

#[cfg(test)]
mod tests {
    use argus_scene::{Images, OmniLayout, Plan, Provenance, SceneHash, SceneState, Warp};
    use bytes::Bytes;
    use glam::DVec3;

    use super::*;

    const SIZE: [u32; 2] = [320, 240];

    /// A frame whose pixels all have this range and source.
    fn frame(range: f32, source: u8) -> Frame {
        let pixels = (SIZE[0] * SIZE[1]) as usize;
        Frame {
            images: Images::from([
                (Output::Range, range.to_le_bytes().repeat(pixels).into()),
                (Output::Source, vec![source; pixels].into()),
            ]),
            ..Frame::without_images(
                SIZE[0],
                SIZE[1],
                Provenance::of_plan(SceneHash([0; 32]), SceneState::default(), Plan::Warp(Warp::default())),
            )
        }
    }

    /// The frame with another image, or without it.
    fn with(frame: Frame, output: Output, image: Option<Bytes>) -> Frame {
        Frame { images: frame.images.clone().with(output, image), ..frame }
    }

    /// A cube map whose texels, seen from its centre, are slightly finer than the pixels of a view of `SIZE`.
    fn sample(center: DVec3) -> SampleCamera {
        SampleCamera::Omni { center, layout: OmniLayout::CubeFaces { face: 512 } }
    }

    fn judged(frame: &Frame, eye: DVec3, samples: &[SampleCamera]) -> Option<String> {
        let camera = Camera { fov_deg: 58.0, ..Camera::look_at(eye, eye + DVec3::X) };
        shortfall(frame, &camera, samples, 0.0)
    }

    #[test]
    fn texels_are_too_coarse_near_a_wall() {
        let samples = [sample(DVec3::ZERO)];
        let wall = |eye: f64| frame(10.0 - eye as f32, 1);
        let at = |eye: f64| judged(&wall(eye), DVec3::new(eye, 0.0, 0.0), &samples);
        assert_eq!([at(0.0), at(2.0)], [None, None]);
        assert!(at(5.0).is_some_and(|reason| reason.contains("too coarse for 100.0%")));
        assert!(at(9.99).is_some());
    }

    #[test]
    fn under_load_coarser_frames_are_good_enough() {
        let samples = [sample(DVec3::ZERO)];
        let camera = |eye: DVec3| Camera { fov_deg: 58.0, ..Camera::look_at(eye, eye + DVec3::X) };
        let coarse = |max_excess: f64| {
            shortfall(&frame(5.0, 1), &camera(DVec3::new(5.0, 0.0, 0.0)), &samples, max_excess)
        };
        assert!(coarse(0.05).is_some());
        assert_eq!(coarse(0.2), None);
    }

    #[test]
    fn each_pixel_is_judged_by_its_own_sample() {
        let samples = [sample(DVec3::ZERO), sample(DVec3::new(8.0, 0.0, 0.0))];
        let eye = DVec3::new(8.0, 0.0, 0.0);
        assert!(judged(&frame(2.0, 1), eye, &samples).is_some());
        assert_eq!(judged(&frame(2.0, 2), eye, &samples), None);
    }

    #[test]
    fn a_small_share_may_be_coarse_or_missing() {
        let samples = [sample(DVec3::ZERO), sample(DVec3::new(8.0, 0.0, 0.0))];
        let eye = DVec3::new(8.0, 0.0, 0.0);
        let with_coarse_rows = |rows: usize| {
            let mut sources = vec![2; (SIZE[0] * SIZE[1]) as usize];
            sources[..rows * SIZE[0] as usize].fill(1);
            judged(&with(frame(2.0, 2), Output::Source, Some(sources.into())), eye, &samples)
        };
        assert_eq!(with_coarse_rows(8), None);
        assert!(with_coarse_rows(40).is_some());
        let holes =
            |unresolved_fraction| judged(&Frame { unresolved_fraction, ..frame(2.0, 2) }, eye, &samples);
        assert_eq!(holes(0.04), None);
        assert_eq!(holes(0.06).unwrap(), "the samples miss 6.0% of the view");
    }

    #[test]
    fn the_sky_is_fine_and_an_invalid_range_is_not() {
        let samples = [sample(DVec3::new(1e6, 0.0, 0.0))];
        let of = |range: f32| judged(&frame(range, 1), DVec3::ZERO, &samples);
        assert_eq!(of(f32::INFINITY), None);
        for range in [0.0, -1.0, 1e-30, f32::NAN] {
            assert!(of(range).is_some(), "{range}");
        }
        let dual =
            SampleCamera::Omni { center: DVec3::ZERO, layout: OmniLayout::DualParaboloid { side: 64 } };
        assert!(judged(&frame(2.0, 1), DVec3::ZERO, &[dual]).is_some(), "an image without faces");
    }

    #[test]
    fn a_frame_without_ranges_or_sources_is_accepted() {
        let samples = [sample(DVec3::ZERO)];
        let eye = DVec3::new(9.0, 0.0, 0.0);
        assert!(judged(&frame(1.0, 1), eye, &samples).is_some());
        assert_eq!(judged(&frame(1.0, 0), eye, &samples), None);
        assert_eq!(judged(&frame(1.0, 9), eye, &samples), None);
        assert_eq!(judged(&with(frame(1.0, 1), Output::Range, None), eye, &samples), None);
        assert_eq!(judged(&Frame { width: 0, height: 0, ..frame(1.0, 1) }, eye, &samples), None);
        assert_eq!(judged(&frame(1.0, 1), eye, &[]), None);
    }
}
