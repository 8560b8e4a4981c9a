//! A view that is computed on the processor: its inputs, its steps and its images.

use argus_scene::{Lighting, Output, Outputs};
use argus_shaders::layout::compositor::{Fill, ViewSample, ViewUniform};
use bytes::Bytes;
use glam::Vec3;
use rayon::prelude::*;

use super::fill::{fill, mask_sky, sky_block};
use super::lookup::{Fetches, SETTLED, fetch, neighbours, splat, splat3};
use super::source::{HostFrame, Level, encoded};
use super::splat;
use super::warp;
use crate::draw_batch::SplatCall;
use crate::frames::ChunkImages;

/// Source of a pixel that no frame saw.
pub(super) const UNRESOLVED: u32 = 255;
/// Added to the source of a pixel whose colour and depth come from different frames.
pub(super) const OTHER_SAMPLE: u32 = 64;
/// Confidence without residual and with a second frame in agreement.
pub(super) const CERTAIN: u32 = 255;
/// Factor by which the level of colours in sRGB is coarser: averages give dark texels less weight, so stripes alias more.
const COARSER: f32 = 1.08;
/// Rows of cells that one thread computes at once; a multiple of every block of the sky's mask.
const BAND: usize = 16;

/// A frame, and how a view reads it.
#[derive(Debug)]
pub(crate) struct HostSource<'a> {
    pub(crate) sample: ViewSample,
    pub(crate) frame: &'a HostFrame,
    /// Texels along the edge of a pixel, at equal distance from both cameras.
    pub(crate) footprint: f32,
    /// Coarsest level whose texels are no larger than most pixels.
    pub(crate) level: usize,
    /// Whether colours are interpolated between that level and the next coarser one.
    pub(crate) between: bool,
}

/// What a view is computed from.
#[derive(Debug)]
pub(crate) struct HostInputs<'a> {
    /// The whole view as one piece whose target is its own image.
    pub(crate) view: ViewUniform,
    pub(crate) sources: Vec<HostSource<'a>>,
    pub(crate) splats: Vec<SplatCall>,
    pub(crate) blocks: Vec<u32>,
    pub(crate) fill: Fill,
    pub(crate) lighting: &'a Lighting,
    /// Sub-pixels along the edge of a pixel.
    pub(crate) side: u32,
    /// Whether sub-pixels are linear radiance, which is averaged.
    pub(crate) linear: bool,
    pub(crate) outputs: Outputs,
}

/// A view while its pixels are computed.
pub(super) struct View<'a> {
    pub(super) of: &'a ViewUniform,
    pub(super) sources: &'a [HostSource<'a>],
    /// Columns of cells.
    pub(super) columns: usize,
    pub(super) linear: bool,
    pub(super) confident: bool,
    /// Whether range is asked for.
    ranged: bool,
    lighting: &'a Lighting,
    /// Linear radiance of each value of a channel.
    radiance: [f32; 256],
}

/// A pixel or sub-pixel.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pixel {
    /// sRGB 0 to 255, or linear radiance.
    pub(super) color: [f32; 3],
    /// 1 + position in the plan's list; 0 for sky.
    pub(super) source: u32,
    pub(super) confidence: u32,
    /// Metres; 0 without a surface.
    pub(super) range: f32,
}

impl View<'_> {
    /// Direction of a position in the view, at depth 1.
    #[inline(always)]
    pub(super) fn direction_of(&self, [x, y]: [f32; 2]) -> [f32; 3] {
        let ViewUniform { corner, right, down, .. } = self.of;
        [
            corner[0] + right[0] * x + down[0] * y,
            corner[1] + right[1] * x + down[1] * y,
            corner[2] + right[2] * x + down[2] * y,
        ]
    }

    /// A pixel of the sky.
    pub(super) fn sky(&self, d: [f32; 3]) -> Pixel {
        let d = Vec3::from(d).normalize_or_zero();
        let sky = &self.lighting.sky;
        let radiance = match &sky.map {
            Some(map) => map.radiance(d),
            None if d.y >= 0.0 => sky.horizon.lerp(sky.zenith, d.y.min(1.0)),
            None => sky.horizon.lerp(sky.ground, (-4.0 * d.y).min(1.0)),
        };
        let color = match self.linear {
            true => radiance.to_array(),
            false => radiance.to_array().map(|channel| encoded(channel * self.of.lighting.exposure) * 255.0),
        };
        Pixel { color, source: 0, confidence: CERTAIN, range: 0.0 }
    }

    /// A pixel whose ray the frames see past: some frame sees past each of its points, two may not.
    pub(super) fn seen_sky(&self, d: [f32; 3]) -> Pixel {
        Pixel { confidence: CERTAIN >> 1, ..self.sky(d) }
    }

    /// The pixel of a settled fetch; unresolved if the frame's texels are too coarse for it.
    #[inline(always)]
    pub(super) fn surface(&self, fetched: &Fetches, lane: usize, source: usize, d: [f32; 3]) -> Pixel {
        let color = self.color(source, fetched.place(lane), || fetched.level(lane));
        if !fetched.is_fine(self, lane) {
            return Pixel { color, source: UNRESOLVED, confidence: 0, range: 0.0 };
        }
        let range = match self.ranged {
            true => (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt() / fetched.q[lane].max(1e-30),
            false => 0.0,
        };
        let confidence = if self.confident { self.confidence(fetched, lane, source, d) } else { 0 };
        Pixel { color, source: source as u32 + 1, confidence, range }
    }

    /// A pixel of the sky whose colour a frame has.
    #[inline(always)]
    pub(super) fn sky_in(&self, fetched: &Fetches, lane: usize, source: usize) -> Pixel {
        let color = self.color(source, fetched.place(lane), || 0.0);
        Pixel { color, source: 0, confidence: CERTAIN >> 1, range: 0.0 }
    }

    /// An unresolved pixel. Its colour is a guess.
    pub(super) fn unresolved(&self, fetched: &Fetches, source: usize) -> Pixel {
        let color = self.bilinear(self.sources[source].frame.level(0), fetched.place(0));
        Pixel { color, source: UNRESOLVED, confidence: 0, range: 0.0 }
    }

    /// Confidence that a frame has the surface of a pixel.
    fn confidence(&self, fetched: &Fetches, lane: usize, source: usize, d: [f32; 3]) -> u32 {
        // 0 is reserved for pixels that no frame saw.
        let match_of_depth = ((127.0 * (1.0 - fetched.residual[lane]) + 0.5) as u32).max(1);
        let others = (0..self.sources.len()).filter(|other| *other != source);
        let seconded = others
            .map(|other| fetch(self, other, &splat3(d), &splat(fetched.q[lane])))
            .any(|other| other.agreement[0] >= SETTLED);
        match_of_depth | u32::from(seconded) << 7
    }

    /// The colour at a place of a frame, texels. `level` is that whose texels are as large as the pixel.
    #[inline(always)]
    fn color(&self, source: usize, place: [f32; 2], level: impl FnOnce() -> f32) -> [f32; 3] {
        let HostSource { frame, level: own, between, .. } = &self.sources[source];
        if !*between && *own == 0 && !self.linear {
            return self.bilinear(&frame.finest, place);
        }
        self.color_between(source, place, level())
    }

    /// The colour at a place of a frame where coarser levels count, or linear radiance.
    fn color_between(&self, source: usize, place: [f32; 2], level: f32) -> [f32; 3] {
        let HostSource { frame, level: own, between, .. } = &self.sources[source];
        let (finer, share) = match (self.linear, *between) {
            (true, _) => (level as usize, level.fract()),
            (false, true) => (*own, (level * COARSER - *own as f32).clamp(0.0, 1.0)),
            (false, false) => (*own, 0.0),
        };
        let at = |level: usize| {
            let level = frame.level(level);
            let [x, y] = [
                (place[0] + 0.5) * (level.width as f32 / frame.width as f32) - 0.5,
                (place[1] + 0.5) * (level.height as f32 / frame.height as f32) - 0.5,
            ];
            self.bilinear(level, [x, y])
        };
        let first = at(finer);
        if share == 0.0 {
            return first;
        }
        let second = at(finer + 1);
        std::array::from_fn(|i| first[i] + (second[i] - first[i]) * share)
    }

    /// A bilinear fetch.
    #[inline(always)]
    fn bilinear(&self, level: &Level, [x, y]: [f32; 2]) -> [f32; 3] {
        let (base_x, base_y) = (x.floor(), y.floor());
        let (fx, fy) = (x - base_x, y - base_y);
        let (left, right) = neighbours(base_x, level.width);
        let (top, bottom) = neighbours(base_y, level.height);
        let above = &level.texels[top * level.width..][..level.width];
        let below = &level.texels[bottom * level.width..][..level.width];
        let texels = [above[left], above[right], below[left], below[right]];
        let weights = [(1.0 - fx) * (1.0 - fy), fx * (1.0 - fy), (1.0 - fx) * fy, fx * fy];
        if self.linear {
            return self.linear_mean(texels, weights);
        }
        let mut sum = [0.0f32; 4];
        for k in 0..4 {
            let channels = texels[k].to_le_bytes();
            for i in 0..4 {
                sum[i] += weights[k] * f32::from(channels[i]);
            }
        }
        [sum[0], sum[1], sum[2]]
    }

    /// The mean linear radiance of texels.
    fn linear_mean(&self, texels: [u32; 4], weights: [f32; 4]) -> [f32; 3] {
        let mut sum = [0.0; 3];
        for (texel, weight) in texels.into_iter().zip(weights) {
            let channels = texel.to_le_bytes();
            sum.iter_mut()
                .zip(channels)
                .for_each(|(sum, channel)| *sum += weight * self.radiance[usize::from(channel)]);
        }
        sum
    }
}

/// The images of a view, a value a sub-pixel.
#[derive(Debug, Default)]
pub(crate) struct HostImages {
    /// sRGB, a byte a channel, and the source in the highest byte.
    srgb: Vec<u32>,
    /// Linear radiance, where sub-pixels are averaged.
    linear: Vec<[f32; 3]>,
    /// Metres; 0 without a surface.
    range: Vec<f32>,
    confidence: Vec<u32>,
}

/// Some rows of the images.
pub(super) struct Rows<'a> {
    srgb: &'a mut [u32],
    linear: &'a mut [[f32; 3]],
    range: &'a mut [f32],
    confidence: &'a mut [u32],
}

impl Rows<'_> {
    /// Stores a pixel. Images that no output needs are empty.
    #[inline(always)]
    pub(super) fn store(&mut self, at: usize, pixel: &Pixel) {
        let Pixel { color, source, confidence, range } = *pixel;
        let [r, g, b] = color;
        if let Some(linear) = self.linear.get_mut(at) {
            *linear = [r.clamp(0.0, 65504.0), g.clamp(0.0, 65504.0), b.clamp(0.0, 65504.0)];
            self.srgb[at] = source << 24;
        } else {
            let (r, g, b) = ((r + 0.5) as u32, (g + 0.5) as u32, (b + 0.5) as u32);
            self.srgb[at] = r | g << 8 | b << 16 | source << 24;
        }
        if let Some(stored) = self.range.get_mut(at) {
            *stored = range;
        }
        if let Some(stored) = self.confidence.get_mut(at) {
            *stored = confidence;
        }
    }

    /// The first `count` values, and the rest.
    fn split(self, count: usize) -> (Self, Self) {
        fn at<T>(all: &mut [T], count: usize) -> (&mut [T], &mut [T]) {
            let count = count.min(all.len());
            all.split_at_mut(count)
        }
        let Self { srgb, linear, range, confidence } = self;
        let (srgb, linear) = (at(srgb, count), at(linear, count));
        let (range, confidence) = (at(range, count), at(confidence, count));
        (
            Self { srgb: srgb.0, linear: linear.0, range: range.0, confidence: confidence.0 },
            Self { srgb: srgb.1, linear: linear.1, range: range.1, confidence: confidence.1 },
        )
    }
}

/// A band of rows of cells, and the pixels in it.
struct Band<'a> {
    first_cell_row: usize,
    cell_rows: usize,
    first_pixel_row: usize,
    rows: Rows<'a>,
}

impl HostInputs<'_> {
    /// Computes the view. Its bytes do not depend on how many threads share the work.
    pub(crate) fn compose(&self) -> ChunkImages {
        let (columns, all_rows) = (self.fill.columns as usize, self.fill.rows as usize);
        let mut cells = vec![0u32; columns * all_rows];
        splat_all(self, &mut cells);
        let [width, height] = self.view.piece_size.map(|side| side as usize);
        let confident = self.outputs.has(Output::Confidence);
        let count = |wanted: bool| if wanted { width * height } else { 0 };
        let mut images = HostImages {
            srgb: vec![0; width * height],
            linear: vec![[0.0; 3]; count(self.linear)],
            range: vec![0.0; count(self.outputs.has(Output::Range))],
            confidence: vec![0; count(confident)],
        };
        let exposure = self.view.lighting.exposure;
        let radiance = |byte| argus_scene::tone::linear_from_srgb(byte as f32 / 255.0) / exposure;
        let view = View {
            of: &self.view,
            sources: &self.sources,
            columns,
            linear: self.linear,
            confident,
            ranged: self.outputs.has(Output::Range),
            lighting: self.lighting,
            radiance: if self.linear { std::array::from_fn(radiance) } else { [0.0; 256] },
        };
        self.bands(&mut images, all_rows).into_par_iter().for_each(|band| compose_band(&view, &cells, band));
        self.resolved(&images)
    }

    /// The view in bands.
    fn bands<'a>(&self, images: &'a mut HostImages, all_rows: usize) -> Vec<Band<'a>> {
        let [width, height] = self.view.piece_size.map(|side| side as usize);
        let HostImages { srgb, linear, range, confidence } = images;
        let mut rest = Rows { srgb, linear, range, confidence };
        let side = sky_block(self.view.cell as u32);
        let mut bands = Vec::new();
        for first_cell_row in (0..all_rows).step_by(BAND.next_multiple_of(side)) {
            let cell_rows = BAND.next_multiple_of(side).min(all_rows - first_cell_row);
            let pixel_row = |cell_row: usize| {
                let row = (cell_row as i64 + i64::from(self.view.cell_origin[1])) * self.view.cell as i64;
                row.clamp(0, height as i64) as usize
            };
            let [first_pixel_row, end] = [first_cell_row, first_cell_row + cell_rows].map(pixel_row);
            let (rows, others) = rest.split((end - first_pixel_row) * width);
            rest = others;
            bands.push(Band { first_cell_row, cell_rows, first_pixel_row, rows });
        }
        bands
    }

    /// The images in the form of a chunk that was read back: `shaders/compositor/resolve.wgsl`.
    fn resolved(&self, images: &HostImages) -> ChunkImages {
        let bytes = |words: &[u32]| Bytes::copy_from_slice(bytemuck::cast_slice(words));
        let floats = |floats: &[f32]| Bytes::copy_from_slice(bytemuck::cast_slice(floats));
        let none = Bytes::new();
        if !self.linear {
            let HostImages { srgb, range, confidence, .. } = images;
            return ChunkImages {
                srgb: bytes(srgb),
                linear: none,
                range: floats(range),
                confidence: bytes(confidence),
            };
        }
        let side = self.side as usize;
        let width = self.view.piece_size[0] as usize;
        let [columns, rows] = self.view.piece_size.map(|sub_pixels| sub_pixels as usize / side);
        let pixels = || (0..columns * rows).map(|at| (at / columns * side) * width + at % columns * side);
        let middle = side / 2 * width + side / 2;
        let exposure = self.view.lighting.exposure;
        let shown = |first: usize| {
            let mut sum = [0.0; 3];
            for row in (0..side).map(|row| &images.linear[first + row * width..][..side]) {
                row.iter().for_each(|sub| sum.iter_mut().zip(sub).for_each(|(sum, sub)| *sum += sub));
            }
            let [r, g, b] =
                sum.map(|sum| (encoded(sum / (side * side) as f32 * exposure) * 255.0 + 0.5).floor() as u32);
            r | g << 8 | b << 16 | images.srgb[first + middle] & 0xff00_0000
        };
        let at_middle = |image: &[u32]| -> Bytes {
            if image.is_empty() {
                return Bytes::new();
            }
            bytes(&pixels().map(|first| image[first + middle]).collect::<Vec<_>>())
        };
        let half = |channel: f32| half::f16::from_f32(channel).to_le_bytes();
        let texel = |sub: &[f32; 3]| sub.map(half).into_iter().chain([[0, 0]]).flatten();
        let linear = match self.outputs.has(Output::Radiance) {
            true => images.linear.iter().flat_map(texel).collect(),
            false => none,
        };
        ChunkImages {
            srgb: bytes(&pixels().map(shown).collect::<Vec<_>>()),
            linear,
            range: at_middle(bytemuck::cast_slice(&images.range)),
            confidence: at_middle(&images.confidence),
        }
    }
}

/// Splats all calls of a view.
fn splat_all(inputs: &HostInputs<'_>, cells: &mut [u32]) {
    #[inline(always)]
    fn all(inputs: &HostInputs<'_>, cells: &mut [u32]) {
        for call in &inputs.splats {
            splat::splat(call, &inputs.blocks, inputs.sources[call.splat.source as usize].frame, cells);
        }
    }
    #[cfg(target_arch = "x86_64")]
    {
        #[target_feature(enable = "avx2")]
        fn with_avx2(inputs: &HostInputs<'_>, cells: &mut [u32]) {
            all(inputs, cells);
        }
        if is_x86_feature_detected!("avx2") {
            // SAFETY: the processor has what the function is compiled for.
            return unsafe { with_avx2(inputs, cells) };
        }
    }
    all(inputs, cells);
}

/// Computes the pixels of a band.
fn compose_band(view: &View<'_>, cells: &[u32], band: Band<'_>) {
    #[inline(always)]
    fn compose(view: &View<'_>, cells: &[u32], band: Band<'_>) {
        let Band { first_cell_row, cell_rows, first_pixel_row, mut rows } = band;
        let width = view.of.piece_size[0] as usize;
        let mut depths = vec![0; cell_rows * view.columns];
        fill(cells, view.columns, first_cell_row, &mut depths);
        mask_sky(view, view.columns, first_cell_row, &mut depths);
        for row in 0..rows.srgb.len() / width {
            warp::row(
                view,
                cells,
                (&depths, first_cell_row),
                first_pixel_row + row,
                (&mut rows, row * width),
            );
        }
    }
    #[cfg(target_arch = "x86_64")]
    {
        #[target_feature(enable = "avx2")]
        fn with_avx2(view: &View<'_>, cells: &[u32], band: Band<'_>) {
            compose(view, cells, band);
        }
        if is_x86_feature_detected!("avx2") {
            // SAFETY: the processor has what the function is compiled for.
            return unsafe { with_avx2(view, cells, band) };
        }
    }
    compose(view, cells, band);
}
