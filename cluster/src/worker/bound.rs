//! Whether a frame from samples keeps its order's bound: the worker sees the pixels, the planner only predicted them.
//!
//! Two things can be wrong. Samples may miss a part of the view, which the frame says itself. And their texels may be
//! coarse, which nothing shows but the ranges: a surface far from a sample and near to the viewer is made of blocks.

use argus_scene::{Camera, Frame, SampleCamera};
use glam::DVec2;

use crate::core::planner::{LEAST_FINE, MOST_TEXEL_PIXELS};

/// A frame of which samples miss more than this share is not good enough: tracing so many holes costs much of a view from
/// triangles, and around holes samples are wrong as well.
const MOST_UNRESOLVED: f64 = 0.05;

/// Columns and rows of pixels that are looked at. Some 770 of them tell shares of 95% and 93% apart.
const GRID: [u32; 2] = [32, 24];

/// What is wrong with a frame from samples that these cameras took, in the order of its plan; `None` if it keeps the bound. It
/// is judged by the range and source that it holds.
pub(super) fn shortfall(frame: &Frame, camera: &Camera, samples: &[SampleCamera]) -> Option<String> {
    if frame.unresolved_fraction > MOST_UNRESOLVED {
        return Some(format!("the samples miss {:.1}% of the view", frame.unresolved_fraction * 100.0));
    }
    let fine = fine_share(frame, camera, samples)?;
    let is_coarse = fine < LEAST_FINE;
    is_coarse.then(|| format!("the samples are too coarse for {:.1}% of the view", (1.0 - fine) * 100.0))
}

/// Share of the frame's pixels whose texel is fine enough; `None` where no pixel says where it comes from.
fn fine_share(frame: &Frame, camera: &Camera, samples: &[SampleCamera]) -> Option<f64> {
    let (ranges, sources) = (frame.range.as_ref()?.as_chunks::<4>().0, frame.source.as_ref()?);
    let [width, height] = [frame.width, frame.height];
    let pixel_angle = 2.0 * camera.tan_half_fov(width, height).y / f64::from(height.max(1));
    let angles: Vec<f64> = samples.iter().map(SampleCamera::texel_angle).collect();
    let [columns, rows] = [GRID[0].min(width), GRID[1].min(height)];
    let (mut looked_at, mut fine) = (0_u32, 0_u32);
    for i in 0..columns * rows {
        let middle = |i: u32, parts: u32, side: u32| {
            (u64::from(2 * i + 1) * u64::from(side) / u64::from(2 * parts)) as u32
        };
        let (x, y) = (middle(i % columns, columns, width), middle(i / columns, rows, height));
        let at = y as usize * width as usize + x as usize;
        let (Some(range), Some(source)) = (ranges.get(at), sources.get(at)) else { continue };
        // 0 is no sample: a guess, which is counted as such.
        let Some(index) = usize::from(*source).checked_sub(1).filter(|index| *index < samples.len()) else {
            continue;
        };
        let range = f64::from(f32::from_le_bytes(*range));
        let farther = match range == f64::INFINITY {
            // The sky is as far from both.
            true => 1.0,
            false => {
                let ray = camera.direction(DVec2::new(f64::from(x), f64::from(y)) + 0.5, width, height);
                (camera.eye + range * ray).distance(samples[index].center()) / range
            }
        };
        looked_at += 1;
        // Written so that what is not a number is not fine.
        fine += u32::from(range > 0.0 && farther * angles[index] <= MOST_TEXEL_PIXELS * pixel_angle);
    }
    (looked_at > 0).then(|| f64::from(fine) / f64::from(looked_at))
}

#[cfg(test)]
mod tests {
    use argus_scene::{OmniLayout, Plan, Provenance, SceneHash, Served, Warp};
    use bytes::Bytes;
    use glam::DVec3;

    use super::*;

    const SIZE: [u32; 2] = [320, 240];

    /// A frame of which every pixel comes from one sample and is so far away.
    fn frame(range: f32, source: u8) -> Frame {
        let pixels = (SIZE[0] * SIZE[1]) as usize;
        Frame {
            width: SIZE[0],
            height: SIZE[1],
            color: None,
            range: Some(Bytes::from(range.to_le_bytes().repeat(pixels))),
            mask: None,
            source: Some(Bytes::from(vec![source; pixels])),
            confidence: None,
            unresolved_fraction: 0.0,
            served: Served::default(),
            predicted: None,
            decision: None,
            provenance: Provenance {
                scene: SceneHash([0; 32]),
                epoch: 0,
                plan: Plan::Warp(Warp::default()),
                specification: None,
                device: String::new(),
                history: false,
            },
            stages: Vec::new(),
        }
    }

    /// A cube whose texels are a little finer than the pixels of a view of `SIZE` from where it stands.
    fn sample(center: DVec3) -> SampleCamera {
        SampleCamera::Omni { center, layout: OmniLayout::CubeFaces { face: 512 } }
    }

    fn judged(frame: &Frame, eye: DVec3, samples: &[SampleCamera]) -> Option<String> {
        let camera = Camera { fov_deg: 58.0, ..Camera::look_at(eye, eye + DVec3::X) };
        shortfall(frame, &camera, samples)
    }

    #[test]
    fn a_viewer_who_walks_up_to_a_wall_gets_no_blocks() {
        let samples = [sample(DVec3::ZERO)];
        let wall = |eye: f64| frame(10.0 - eye as f32, 1);
        let at = |eye: f64| judged(&wall(eye), DVec3::new(eye, 0.0, 0.0), &samples);
        assert_eq!([at(0.0), at(2.0)], [None, None]);
        assert!(at(5.0).is_some_and(|reason| reason.contains("too coarse for 100.0%")));
        assert!(at(9.99).is_some());
    }

    #[test]
    fn each_pixel_is_judged_by_the_sample_that_it_comes_from() {
        let samples = [sample(DVec3::ZERO), sample(DVec3::new(8.0, 0.0, 0.0))];
        let eye = DVec3::new(8.0, 0.0, 0.0);
        assert!(judged(&frame(2.0, 1), eye, &samples).is_some());
        assert_eq!(judged(&frame(2.0, 2), eye, &samples), None);
    }

    #[test]
    fn a_small_part_may_be_coarse_and_holes_are_counted() {
        let samples = [sample(DVec3::ZERO), sample(DVec3::new(8.0, 0.0, 0.0))];
        let eye = DVec3::new(8.0, 0.0, 0.0);
        let with_coarse_rows = |rows: usize| {
            let mut sources = vec![2; (SIZE[0] * SIZE[1]) as usize];
            sources[..rows * SIZE[0] as usize].fill(1);
            judged(&Frame { source: Some(sources.into()), ..frame(2.0, 2) }, eye, &samples)
        };
        assert_eq!(with_coarse_rows(8), None);
        assert!(with_coarse_rows(40).is_some());
        let holes =
            |unresolved_fraction| judged(&Frame { unresolved_fraction, ..frame(2.0, 2) }, eye, &samples);
        assert_eq!(holes(0.04), None);
        assert_eq!(holes(0.06).unwrap(), "the samples miss 6.0% of the view");
    }

    #[test]
    fn the_sky_is_as_fine_as_texels_are_and_a_broken_range_is_not_fine() {
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
    fn a_frame_that_does_not_say_where_it_comes_from_is_not_judged_by_that() {
        let samples = [sample(DVec3::ZERO)];
        let eye = DVec3::new(9.0, 0.0, 0.0);
        assert!(judged(&frame(1.0, 1), eye, &samples).is_some());
        assert_eq!(judged(&frame(1.0, 0), eye, &samples), None);
        assert_eq!(judged(&frame(1.0, 9), eye, &samples), None);
        assert_eq!(judged(&Frame { range: None, ..frame(1.0, 1) }, eye, &samples), None);
        assert_eq!(judged(&Frame { width: 0, height: 0, ..frame(1.0, 1) }, eye, &samples), None);
        assert_eq!(judged(&frame(1.0, 1), eye, &[]), None);
    }
}
