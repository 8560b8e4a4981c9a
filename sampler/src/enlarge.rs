//! Enlarges images of views that are rendered in less detail.

use argus_scene::{Channel, Detail, OutputFormat};
use rayon::prelude::*;

/// Channels of a pixel: colour, or radiance.
const CHANNELS: usize = 3;

/// The image of a view of a size in pixels, from what [`Detail`] renders of it: colour or radiance, rows tightly packed.
///
/// Each pixel is a mean of 4×4 around its place by Catmull and Rom's cubic ("A class of local interpolating splines", 1974),
/// which neither blurs nor moves what is rendered. At edges the outermost pixels repeat.
pub(crate) fn enlarged(image: &[u8], format: OutputFormat, detail: Detail, size: [u32; 2]) -> Vec<u8> {
    // A cubic overshoots.
    match format.channel {
        Channel::U8 => enlarged_by(
            image,
            |byte| f32::from(*byte),
            |value| value.round().clamp(0.0, 255.0) as u8,
            detail,
            size,
        ),
        Channel::F32 | Channel::I32 => {
            let (texels, _) = image.as_chunks::<4>();
            let write = |value: f32| value.max(0.0).to_le_bytes();
            enlarged_by(texels, |bytes| f32::from_le_bytes(*bytes), write, detail, size).into_flattened()
        }
    }
}

/// [`enlarged`] of numbers that `read` and `write` convert.
fn enlarged_by<T: Copy + Default + Send + Sync>(
    image: &[T],
    read: impl Fn(&T) -> f32 + Sync,
    write: impl Fn(f32) -> T + Sync,
    detail: Detail,
    size: [u32; 2],
) -> Vec<T> {
    let from = detail.size(size).map(|side| side as usize);
    let [width, height] = size.map(|side| side as usize);
    let [columns, rows] = [0, 1].map(|axis| taps(from[axis], [width, height][axis], detail.scale()));
    let mut wide = vec![0.0f32; width * from[1] * CHANNELS];
    wide.par_chunks_mut(width * CHANNELS).zip(image.par_chunks(from[0] * CHANNELS)).for_each(
        |(wide, row)| {
            for (pixel, Taps { at, weights }) in wide.chunks_exact_mut(CHANNELS).zip(&columns) {
                for (channel, value) in pixel.iter_mut().enumerate() {
                    *value = (0..4).map(|tap| read(&row[at[tap] * CHANNELS + channel]) * weights[tap]).sum();
                }
            }
        },
    );
    let mut all = vec![T::default(); width * height * CHANNELS];
    all.par_chunks_mut(width * CHANNELS).zip(&rows).for_each(|(row, Taps { at, weights })| {
        for (place, to) in row.iter_mut().enumerate() {
            let value: f32 = (0..4).map(|tap| wide[at[tap] * width * CHANNELS + place] * weights[tap]).sum();
            *to = write(value);
        }
    });
    all
}

/// What a pixel of the large image takes along one axis.
struct Taps {
    at: [usize; 4],
    weights: [f32; 4],
}

/// The taps of `to` pixels from `from` that are `scale` times as large, about the same middle.
fn taps(from: usize, to: usize, scale: u32) -> Vec<Taps> {
    let scale = f64::from(scale);
    let beyond = (from as f64 * scale - to as f64) * 0.5;
    let last = from.saturating_sub(1) as isize;
    let tap = |pixel: usize| {
        let place = (pixel as f64 + 0.5 + beyond) / scale - 0.5;
        let (first, share) = (place.floor() as isize, place - place.floor());
        Taps { at: [-1, 0, 1, 2].map(|by| (first + by).clamp(0, last) as usize), weights: cubic(share) }
    };
    (0..to).map(tap).collect()
}

/// Weights of four pixels in a row for a place between the middle two, 0 to 1. Their sum is 1.
fn cubic(t: f64) -> [f32; 4] {
    let [t2, t3] = [t * t, t * t * t];
    [-t3 + 2.0 * t2 - t, 3.0 * t3 - 5.0 * t2 + 2.0, -3.0 * t3 + 4.0 * t2 + t, t3 - t2]
        .map(|weight| (0.5 * weight) as f32)
}

#[cfg(test)]
mod tests {
    use argus_scene::Output;

    use super::*;

    fn image_of([width, height]: [u32; 2], color: impl Fn(f64, f64) -> f64) -> Vec<u8> {
        let place = |i: u32| (f64::from(i % width) + 0.5, f64::from(i / width) + 0.5);
        let byte = |i| (color(place(i).0, place(i).1)).round() as u8;
        (0..width * height).flat_map(|i| [byte(i); CHANNELS]).collect()
    }

    #[test]
    fn a_ramp_stays_in_its_place_at_every_size() {
        for detail in [Detail::Half, Detail::Quarter] {
            for size in [[40, 32], [41, 33], [43, 35]] {
                let scale = f64::from(detail.scale());
                let small = detail.size(size);
                let beyond = [0, 1].map(|i| (f64::from(small[i]) * scale - f64::from(size[i])) * 0.5);
                let ramp = |x: f64, y: f64| 40.0 + 3.0 * x + 2.0 * y;
                let rendered = image_of(small, |x, y| {
                    ramp(x * scale - beyond[0], y * scale - beyond[1]).clamp(0.0, 255.0)
                });
                let shown = enlarged(&rendered, Output::Color.format(), detail, size);
                let expected = image_of(size, ramp);
                let [width, height] = size.map(|side| side as usize);
                // Where no pixel repeats.
                let edge = 2 * detail.scale() as usize;
                for y in edge..height - edge {
                    for x in edge..width - edge {
                        let at = (y * width + x) * CHANNELS;
                        assert!(shown[at].abs_diff(expected[at]) <= 1, "{detail} {size:?} {x} {y}");
                    }
                }
            }
        }
    }

    #[test]
    fn one_colour_stays_that_colour_and_the_smallest_images_have_one() {
        for size in [[1, 1], [2, 3], [5, 1], [9, 9]] {
            for detail in [Detail::Half, Detail::HalfFewRays, Detail::Quarter] {
                let [width, height] = detail.size(size);
                let image = vec![77; (width * height) as usize * CHANNELS];
                let pixels = (size[0] * size[1]) as usize * CHANNELS;
                assert_eq!(enlarged(&image, Output::Color.format(), detail, size), vec![77; pixels]);
                // Above what a byte holds.
                let bright = 300f32.to_le_bytes().repeat(image.len());
                let shown = enlarged(&bright, Output::Radiance.format(), detail, size);
                let shown = shown.as_chunks::<4>().0.iter().map(|bytes| f32::from_le_bytes(*bytes));
                assert_eq!(shown.clone().count(), pixels);
                assert!(shown.into_iter().all(|value| (value - 300.0).abs() < 1e-3));
            }
        }
    }
}
