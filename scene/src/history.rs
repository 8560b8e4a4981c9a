//! Data of a frame for temporal reprojection: where its surfaces were, and which samples served them.
//!
//! A slowly moving camera sees mostly what it saw before, so [`crate::Search::Seeded`] may start there instead of at
//! a coarse splat of the samples. It is only a start: the samples decide where the search ends.

use crate::{Camera, Frame, Output, Plan, SampleId};

/// An earlier frame, as the start of a search.
#[derive(Debug, Clone, PartialEq)]
pub struct History {
    camera: Camera,
    size: [u32; 2],
    samples: Vec<SampleId>,
    words: Vec<u32>,
    links: u32,
}

/// Bits of a word that name a sample. The rest hold its inverse range with 20 bits of mantissa, more than a
/// sample stores.
const SOURCE_BITS: u32 = 3;
const SOURCE_MASK: u32 = (1 << SOURCE_BITS) - 1;

impl History {
    /// The history of a frame from samples and its camera. `None` if the frame lacks range or source, or the camera
    /// is invalid. Frames may come from untrusted sources: a range that is not positive counts as sky, and an unknown
    /// source as the first. `before`: the history from which the frame itself started.
    pub fn of(frame: &Frame, camera: &Camera, before: Option<&Self>) -> Option<Self> {
        let Plan::Warp(warp) = &frame.provenance.plan else { return None };
        camera.validate().ok()?;
        let samples: Vec<SampleId> = warp
            .samples
            .iter()
            .copied()
            .filter(|id| !id.is_reflection_probe())
            .take(1 << SOURCE_BITS)
            .collect();
        let (ranges, rest) = frame.images[Output::Range].as_ref()?.as_chunks::<4>();
        let sources = frame.images[Output::Source].as_ref()?;
        let pixels = u64::from(frame.width) * u64::from(frame.height);
        let whole = rest.is_empty() && ranges.len() as u64 == pixels && sources.len() as u64 == pixels;
        if !whole || pixels == 0 || samples.is_empty() {
            return None;
        }
        let word = |(range, &source): (&[u8; 4], &u8)| {
            let inverse = f32::from_le_bytes(*range).recip();
            let known = (1..=samples.len()).contains(&usize::from(source));
            let source = if known { u32::from(source) - 1 } else { 0 };
            // Written so that NaN counts as sky; infinitely far is 0.
            if inverse >= f32::MIN_POSITIVE && inverse.is_finite() {
                inverse.to_bits() & !SOURCE_MASK | source
            } else {
                0
            }
        };
        let words = ranges.iter().zip(sources.iter()).map(word).collect();
        let links = match frame.provenance.history {
            true => before.map_or(0, |before| before.links).saturating_add(1),
            false => 0,
        };
        Some(Self { camera: *camera, size: [frame.width, frame.height], samples, words, links })
    }

    /// The frame's camera.
    pub fn camera(&self) -> &Camera {
        &self.camera
    }

    /// Size in pixels: width, height.
    pub fn size(&self) -> [u32; 2] {
        self.size
    }

    /// The frame's samples in the order of its plan: at most 8.
    pub fn samples(&self) -> &[SampleId] {
        &self.samples
    }

    /// One word per pixel, row 0 at the top: the bits of the inverse range (1/metres), with the last three replaced
    /// by the sample's position in [`History::samples`]; 0 for sky.
    pub fn words(&self) -> &[u32] {
        &self.words
    }

    /// Number of frames between it and one that started from samples; 0 if its own search did.
    pub fn links(&self) -> u32 {
        self.links
    }

    /// Inverse range (1/metres) of a word of [`History::words`]; 0 for sky.
    pub fn inverse_range(word: u32) -> f32 {
        f32::from_bits(word & !SOURCE_MASK)
    }

    /// Its size in bytes.
    pub fn bytes(&self) -> u64 {
        let words = self.words.len() * size_of::<u32>();
        (size_of::<Self>() + words + self.samples.len() * size_of::<SampleId>()) as u64
    }
}

#[cfg(test)]
mod tests {
    use bytes::Bytes;
    use glam::DVec3;

    use super::*;
    use crate::{Images, Provenance, SceneHash, SceneState, Warp};

    fn camera() -> Camera {
        Camera::look_at(DVec3::new(3.0, 2.0, 5.0), DVec3::ZERO)
    }

    fn frame(ranges: &[f32], sources: &[u8]) -> Frame {
        let id = |index| SampleId { version: 0, camera: index };
        let samples = vec![id(7), id(4), id(SampleId::REFLECTION_PROBES)];
        Frame {
            images: Images::from([
                (Output::Range, ranges.iter().flat_map(|range| range.to_le_bytes()).collect()),
                (Output::Source, Bytes::copy_from_slice(sources)),
            ]),
            ..Frame::without_images(
                ranges.len() as u32,
                1,
                Provenance::of_plan(
                    SceneHash([0; 32]),
                    SceneState::default(),
                    Plan::Warp(Warp { samples, ..Warp::default() }),
                ),
            )
        }
    }

    #[test]
    fn a_word_holds_the_inverse_range_and_the_sample() {
        let history = History::of(&frame(&[4.0, 0.1, f32::INFINITY], &[1, 2, 0]), &camera(), None).unwrap();
        let indices: Vec<u64> = history.samples().iter().map(|id| id.camera).collect();
        assert_eq!(indices, [7, 4], "reflection probes serve no pixel");
        let [near, far, sky] = history.words() else { panic!("a word a pixel") };
        assert_eq!((History::inverse_range(*near), near & 7), (0.25, 0));
        assert!((History::inverse_range(*far) / 10.0 - 1.0).abs() < 1e-5 && far & 7 == 1);
        assert_eq!(*sky, 0);
    }

    #[test]
    fn an_invalid_range_is_sky_and_an_unknown_source_is_the_first() {
        let ranges = [f32::NAN, -3.0, 0.0, -0.0, f32::NEG_INFINITY, f32::MAX, 1e-39, 2.0];
        let history = History::of(&frame(&ranges, &[1, 1, 1, 1, 1, 1, 1, 99]), &camera(), None).unwrap();
        let (last, others) = history.words().split_last().unwrap();
        assert!(others.iter().all(|&word| word == 0), "{others:?}");
        assert_eq!((History::inverse_range(*last), last & 7), (0.5, 0));
    }

    #[test]
    fn links_count_from_the_frame_that_started_from_samples() {
        let fresh = frame(&[1.0], &[1]);
        let mut begun = fresh.clone();
        begun.provenance.history = true;
        let first = History::of(&fresh, &camera(), None).unwrap();
        let second = History::of(&begun, &camera(), Some(&first)).unwrap();
        let third = History::of(&begun, &camera(), Some(&second)).unwrap();
        let anew = History::of(&fresh, &camera(), Some(&third)).unwrap();
        assert_eq!([first, second, third, anew].map(|history| history.links()), [0, 1, 2, 0]);
    }

    #[test]
    fn a_frame_without_range_or_source_has_no_history() {
        let whole = frame(&[1.0, 2.0], &[1, 1]);
        assert!(History::of(&whole, &camera(), None).is_some());
        for lost in [Output::Range, Output::Source] {
            let images = whole.images.clone().with(lost, None);
            assert!(History::of(&Frame { images, ..whole.clone() }, &camera(), None).is_none());
        }
        assert!(History::of(&Frame { width: 3, ..whole.clone() }, &camera(), None).is_none());
        assert!(History::of(&frame(&[], &[]), &camera(), None).is_none(), "no pixels");
        let nowhere = Camera { eye: DVec3::splat(f64::NAN), ..camera() };
        assert!(History::of(&whole, &nowhere, None).is_none());
        let mut direct = whole;
        direct.provenance.plan = Plan::direct(1);
        assert!(History::of(&direct, &camera(), None).is_none(), "no sample served its pixels");
    }
}
