//! A view from its inputs to its images, in bands of rows.

use argus_scene::Output;
use bytes::Bytes;
use rayon::prelude::*;

use super::fill::{fill, mask_sky, sky_block};
use super::source::encoded;
use super::view::{HostInputs, Rows, View};
use super::{splat, warp};
use crate::frames::ChunkImages;

/// Rows of cells that one thread computes at once; a multiple of every block of the sky's mask.
const BAND: usize = 16;

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

impl Rows<'_> {
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
