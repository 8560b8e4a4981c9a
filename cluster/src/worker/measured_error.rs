//! Measures the error of a frame from samples whose request bounds it, before it is delivered.
//!
//! Some blocks of the frame's pixels are traced with many samples per pixel. A block's error is FLIP's colour difference (Andersson et
//! al., "FLIP", 2020, section 4.1) between mean colours of the block. The mean stands for the filter by which FLIP models the eye's
//! resolution. FLIP's terms for edges and points are left out, so measured errors are slightly smaller than a whole frame's mean FLIP.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use argus_scene::tone::linear_from_srgb;
use argus_scene::{Frame, Output, PixelJob, Prediction, ViewJob};

use super::node::Node;

/// Longest time of tracing the pixels.
const PATIENCE: Duration = Duration::from_secs(2);

/// Pixels per side of a block: about as many as FLIP's filters blend at 67 pixels per degree.
const BLOCK: u32 = 4;

/// Blocks per side of a frame. The frame is divided into this many columns and rows of cells, and each cell has one block.
const BLOCKS: u32 = 8;

/// Upper quantile of the normal distribution that a measured error is stated at: 95%.
const QUANTILE: f64 = 1.645;

/// Samples per pixel of the reference.
const REFERENCE_SAMPLES: u32 = 16;

/// The error of a frame from samples, measured by tracing some of its pixels before `until`: an upper bound of the mean
/// FLIP's colour difference. The error is 1 if it cannot be measured.
pub(super) async fn error_of(
    node: &Arc<Node>,
    job: &ViewJob,
    frame: &Frame,
    until: Option<tokio::time::Instant>,
) -> Prediction {
    let measured = async {
        let (blocks, shown) = blocks_of(frame, BLOCKS, 0)?;
        let reference = node.render_thread.render_pixels(&pixels_of(job, &blocks)).await.ok()?;
        upper_error(&blocks, &shown, &reference.color)
    };
    let within = until.map_or(PATIENCE, |until| until.saturating_duration_since(tokio::time::Instant::now()));
    let error = tokio::time::timeout(within.min(PATIENCE), measured).await.ok().flatten();
    Prediction { error: error.unwrap_or(1.0), ms: frame.rendering_ms() }
}

/// The job of tracing the pixels of some blocks as the reference.
fn pixels_of(job: &ViewJob, blocks: &BTreeMap<u32, usize>) -> PixelJob {
    PixelJob {
        camera: job.camera,
        width: job.width,
        height: job.height,
        pixels: blocks.keys().copied().collect(),
        samples_per_pixel: REFERENCE_SAMPLES,
        state: job.state,
        time_secs: job.time_secs,
        reflections: job.reflections,
    }
}

/// Upper bound of the mean error of all blocks of a frame, from some of its blocks. Both images hold the pixels of
/// `blocks` in their order.
fn upper_error(blocks: &BTreeMap<u32, usize>, shown: &[u8], reference: &[u8]) -> Option<f64> {
    let bytes = 3 * blocks.len();
    if bytes == 0 || [shown, reference].iter().any(|image| image.len() != bytes) {
        return None;
    }
    let errors: Vec<f64> = block_means(blocks, shown)
        .into_iter()
        .zip(block_means(blocks, reference))
        .map(|(shown, reference)| color_difference(shown, reference))
        .collect();
    let count = errors.len() as f64;
    let mean = errors.iter().sum::<f64>() / count;
    let variance = errors.iter().map(|error| (error - mean).powi(2)).sum::<f64>() / (count - 1.0).max(1.0);
    Some((mean + QUANTILE * (variance / count).sqrt()).min(1.0))
}

/// Pixels of the blocks, ascending, each with the number of its block; and their sRGB colours. `turn` moves the
/// blocks, of which there are `side` × `side`.
fn blocks_of(frame: &Frame, side: u32, turn: u64) -> Option<(BTreeMap<u32, usize>, Vec<u8>)> {
    let color = frame.images[Output::Color].as_ref()?;
    let mut blocks = BTreeMap::new();
    for block in 0..side * side {
        // Roberts' two-dimensional sequence (2018) spreads positions evenly.
        let step = (turn * u64::from(side * side) + u64::from(block)) as f64;
        let share = [0.754_877_666_246_69, 0.569_840_290_998_05].map(|s| (step * s).fract());
        let first = |cell: u32, size: u32, share: f64| {
            let place = (f64::from(cell) + share) / f64::from(side) * f64::from(size);
            (place as u32).min(size.saturating_sub(BLOCK))
        };
        let column = first(block % side, frame.width, share[0]);
        let row = first(block / side, frame.height, share[1]);
        for y in row..(row + BLOCK).min(frame.height) {
            for x in column..(column + BLOCK).min(frame.width) {
                blocks.insert(y * frame.width + x, block as usize);
            }
        }
    }
    let pixel = |&pixel: &u32| color.get(3 * pixel as usize..3 * pixel as usize + 3);
    let shown: Option<Vec<&[u8]>> = blocks.keys().map(pixel).collect();
    Some((blocks, shown?.concat()))
}

/// The mean of each block, linear RGB.
fn block_means(blocks: &BTreeMap<u32, usize>, image: &[u8]) -> Vec<[f64; 3]> {
    let mut sums: BTreeMap<usize, ([f64; 3], f64)> = BTreeMap::new();
    for (block, pixel) in blocks.values().zip(image.as_chunks::<3>().0) {
        let (sum, count) = sums.entry(*block).or_default();
        sum.iter_mut()
            .zip(pixel)
            .for_each(|(sum, byte)| *sum += f64::from(linear_from_srgb(f32::from(*byte) / 255.0)));
        *count += 1.0;
    }
    sums.into_values().map(|(sum, count)| sum.map(|x| x / count)).collect()
}

/// FLIP's difference of two linear RGB colours, 0 to 1.
fn color_difference(a: [f64; 3], b: [f64; 3]) -> f64 {
    // Exponent of differences. Differences up to the first share of the largest one map to the second share of the
    // range.
    const EXPONENT: f64 = 0.7;
    const LARGE: f64 = 0.4;
    const UP_TO_LARGE: f64 = 0.95;
    let distance = |a: [f64; 3], b: [f64; 3]| {
        let ([l, a, b], [m, c, d]) = (adjusted_lab(a), adjusted_lab(b));
        ((l - m).abs() + (a - c).hypot(b - d)).powf(EXPONENT)
    };
    let most = distance([0.0, 1.0, 0.0], [0.0, 0.0, 1.0]);
    let share = distance(a, b) / most;
    match share < LARGE {
        true => share / LARGE * UP_TO_LARGE,
        false => (UP_TO_LARGE + (share - LARGE) / (1.0 - LARGE) * (1.0 - UP_TO_LARGE)).min(1.0),
    }
}

/// CIELAB of linear RGB, with the Hunt adjustment: dark colours are less colourful.
fn adjusted_lab([r, g, b]: [f64; 3]) -> [f64; 3] {
    // Relative to white.
    let x = (0.412_456_4 * r + 0.357_576_1 * g + 0.180_437_5 * b) / 0.950_47;
    let y = 0.212_672_9 * r + 0.715_152_2 * g + 0.072_175 * b;
    let z = (0.019_333_9 * r + 0.119_192 * g + 0.950_304_1 * b) / 1.088_83;
    let f = |t: f64| if t > 216.0 / 24389.0 { t.cbrt() } else { t * (841.0 / 108.0) + 4.0 / 29.0 };
    let l = 116.0 * f(y) - 16.0;
    [l, 0.01 * l * 500.0 * (f(x) - f(y)), 0.01 * l * 200.0 * (f(y) - f(z))]
}

#[cfg(test)]
mod tests {
    use argus_scene::{Images, Plan, Provenance, SceneHash, SceneState, Warp};

    use super::*;

    fn frame(width: u32, height: u32) -> Frame {
        let color = (0..width * height).flat_map(|pixel| [pixel as u8, 7, 9]).collect::<Vec<u8>>();
        Frame {
            images: Images::from([(Output::Color, color.into())]),
            ..Frame::without_images(
                width,
                height,
                Provenance::of_plan(SceneHash([0; 32]), SceneState::default(), Plan::Warp(Warp::default())),
            )
        }
    }

    #[test]
    fn colour_differences_equal_those_of_flip() {
        let (black, white) = ([0.0; 3], [1.0; 3]);
        assert_eq!(color_difference(white, white), 0.0);
        assert!((color_difference([0.0, 1.0, 0.0], [0.0, 0.0, 1.0]) - 1.0).abs() < 1e-12);
        // The reference implementation's value for images of one colour.
        assert!((color_difference(black, white) - 0.967).abs() < 0.003, "{}", color_difference(black, white));
        let dim = color_difference([0.20; 3], [0.21; 3]);
        assert!((0.01..0.2).contains(&dim), "{dim}");
    }

    #[test]
    fn blocks_lie_within_the_frame_at_every_turn_and_frame_size() {
        for (width, height) in [(320, 240), (17, 5), (3, 2), (1, 1)] {
            let frame = frame(width, height);
            for turn in [0, 1, 99, 1 << 40] {
                let (blocks, shown) = blocks_of(&frame, BLOCKS, turn).unwrap();
                assert!(blocks.keys().all(|&pixel| pixel < width * height));
                assert_eq!(shown.len(), 3 * blocks.len());
                let first = *blocks.keys().next().unwrap();
                assert_eq!(shown[0], first as u8);
            }
        }
        assert_ne!(blocks_of(&frame(320, 240), BLOCKS, 0), blocks_of(&frame(320, 240), BLOCKS, 1));
        assert_eq!(blocks_of(&Frame { images: Images::default(), ..frame(4, 4) }, BLOCKS, 0), None);
    }

    #[test]
    fn an_upper_error_holds_for_frames_whose_blocks_differ_and_is_0_for_equal_ones() {
        let (blocks, shown) = blocks_of(&frame(320, 240), BLOCKS, 0).unwrap();
        assert_eq!(upper_error(&blocks, &shown, &shown), Some(0.0));
        // A tenth of the blocks shows something else.
        let other: Vec<u8> = shown
            .as_chunks::<3>()
            .0
            .iter()
            .zip(blocks.values())
            .flat_map(|(pixel, block)| if block % 10 == 0 { [250, 20, 20] } else { *pixel })
            .collect();
        let error = upper_error(&blocks, &other, &shown).unwrap();
        assert!((0.05..0.3).contains(&error), "{error}");
        assert_eq!(upper_error(&blocks, &shown, &shown[1..]), None);
        assert_eq!(upper_error(&BTreeMap::new(), &[], &[]), None);
    }
}
