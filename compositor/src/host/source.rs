//! A frame in memory: colour in sRGB, inverse range, and coarser levels of colour.
//!
//! The levels are those of `shaders/compositor/mips.wgsl`, the bounds of tiles those of `bounds.wgsl`.

use std::sync::OnceLock;

use argus_scene::camera::Face;
use argus_scene::{PlaneData, PlaneFormat, PlaneKind, Sample};
use glam::Vec3;

use crate::cull::{FaceTiles, tile_side};
use crate::radiance::from_half;

/// Most levels of a frame, its own size included.
const MAX_LEVELS: usize = 4;
/// Fewest texels on the shorter side of the coarsest level.
const LEAST_SIDE: usize = 16;
/// Relative difference of inverse range within which two texels belong to one surface.
const ONE_SURFACE: f32 = 0.05;

/// Colours of one size: sRGB, a byte a channel, red first.
#[derive(Debug)]
pub(crate) struct Level {
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) texels: Vec<u32>,
}

/// A frame in memory.
#[derive(Debug)]
pub(crate) struct HostFrame {
    pub(crate) width: usize,
    pub(crate) height: usize,
    /// 1/metres; 0 for the sky.
    pub(crate) inverse_range: Vec<f32>,
    pub(crate) finest: Level,
    /// Made when a view first needs one.
    coarser: OnceLock<Vec<Level>>,
}

impl HostFrame {
    /// The frame of a sample whose planes are in memory; `None` for another sample. `exposure` is the factor from its radiance to
    /// display-linear.
    pub(crate) fn new(sample: &Sample, exposure: f32) -> Option<Self> {
        let host = |kind| match sample.plane(kind) {
            Some(plane) => match &plane.data {
                PlaneData::Host(bytes) => Some((plane, bytes)),
                PlaneData::Device(_) => None,
            },
            None => None,
        };
        let (range, (radiance, texels)) = (host(PlaneKind::InverseRange)?, host(PlaneKind::Radiance)?);
        if radiance.format != PlaneFormat::Rgba16Float || sample.planes.len() != 2 {
            return None;
        }
        let [width, height] = radiance.size.map(|side| side as usize);
        let inverse_range =
            range.1.as_chunks::<4>().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect::<Vec<_>>();
        // A frame has 256 values of a channel, which repeat from texel to texel.
        let mut shown = vec![u16::MAX; 1 << 16];
        let mut byte_of = |bits: u16| {
            let known = &mut shown[usize::from(bits)];
            if *known == u16::MAX {
                *known = (encoded(from_half(bits) * exposure) * 255.0 + 0.5).floor() as u16;
            }
            u32::from(*known)
        };
        let texel = |bytes: &[u8; 8]| {
            let [r, g, b] = [0, 1, 2].map(|i| byte_of(u16::from_le_bytes([bytes[2 * i], bytes[2 * i + 1]])));
            r | g << 8 | b << 16
        };
        let texels: Vec<u32> = texels.as_chunks::<8>().0.iter().map(texel).collect();
        if inverse_range.len() != width * height || texels.len() != width * height {
            return None;
        }
        let finest = Level { width, height, texels };
        Some(Self { width, height, inverse_range, finest, coarser: OnceLock::new() })
    }

    /// Colours of a level; those of the coarsest if there are fewer.
    pub(crate) fn level(&self, level: usize) -> &Level {
        if level == 0 {
            return &self.finest;
        }
        let coarser = self.coarser.get_or_init(|| self.make_coarser());
        coarser.get(level - 1).or(coarser.last()).unwrap_or(&self.finest)
    }

    fn make_coarser(&self) -> Vec<Level> {
        let linear: [f32; 256] =
            std::array::from_fn(|byte| argus_scene::tone::linear_from_srgb(byte as f32 / 255.0));
        let mut finer: Vec<Vec3> =
            self.finest.texels.iter().map(|texel| rgb(*texel).map(|byte| linear[byte]).into()).collect();
        let mut ranges = self.inverse_range.clone();
        let (mut size, shortest) = ([self.width, self.height], self.width.min(self.height));
        let mut levels = Vec::new();
        for level in (1..MAX_LEVELS).take_while(|level| shortest >> level >= LEAST_SIDE) {
            let own = [self.width >> level, self.height >> level];
            let texels = (0..own[0] * own[1]).map(|at| coarsened(&finer, &ranges, size, own, at));
            let (means, means_of_range): (Vec<Vec3>, Vec<f32>) = texels.unzip();
            let shown = |mean: &Vec3| {
                let [r, g, b] = mean.to_array().map(|linear| (encoded(linear) * 255.0 + 0.5).floor() as u32);
                r | g << 8 | b << 16
            };
            levels.push(Level { width: own[0], height: own[1], texels: means.iter().map(shown).collect() });
            (finer, ranges, size) = (means, means_of_range, own);
        }
        levels
    }

    /// Least and greatest inverse range of each tile of its only face.
    pub(crate) fn tiles(&self, face: &Face) -> FaceTiles {
        let side = tile_side(face) as usize;
        let [columns, rows] = [self.width.div_ceil(side), self.height.div_ceil(side)];
        let mut inverse_range = vec![[0f32; 2]; columns * rows];
        for (y, row) in self.inverse_range.chunks_exact(self.width).enumerate() {
            for (tile, texels) in row.chunks(side).enumerate() {
                let [least, most] = &mut inverse_range[y / side * columns + tile];
                for &stored in texels.iter().filter(|stored| is_surface(**stored)) {
                    *least = if *least == 0.0 { stored } else { least.min(stored) };
                    *most = most.max(stored);
                }
            }
        }
        FaceTiles { columns: columns as u32, rows: rows as u32, inverse_range }
    }
}

/// Whether an inverse range is one: positive and finite.
pub(super) fn is_surface(inverse_range: f32) -> bool {
    inverse_range > 0.0 && inverse_range <= f32::MAX
}

/// The channels of a texel.
fn rgb(texel: u32) -> [usize; 3] {
    [texel & 255, texel >> 8 & 255, texel >> 16 & 255].map(|byte| byte as usize)
}

/// A texel of a coarser level: the mean of those of four finer texels that belong to one surface, the one of most of them; of
/// equals the nearer one. Its colour, and its inverse range.
fn coarsened(
    finer: &[Vec3],
    ranges: &[f32],
    [width, height]: [usize; 2],
    own: [usize; 2],
    at: usize,
) -> (Vec3, f32) {
    let [x, y] = [at % own[0], at / own[0]];
    let first = |at: usize, own: usize, of: usize| {
        // Levels of odd sides do not nest.
        let center = (at as f32 + 0.5) * of as f32 / own as f32;
        ((center - 0.5).max(0.0) + 1e-3) as usize
    };
    let [left, top] = [first(x, own[0], width).min(width - 1), first(y, own[1], height).min(height - 1)];
    let [right, bottom] = [(left + 1).min(width - 1), (top + 1).min(height - 1)];
    let places = [top * width + left, top * width + right, bottom * width + left, bottom * width + right];
    let four = places.map(|place| ranges[place]);
    let like = |one: f32| four.map(|other| (other - one).abs() <= ONE_SURFACE * one);
    let count = |mask: &[bool; 4]| mask.iter().filter(|is| **is).count();
    let (mut mask, mut range) = (like(four[0]), four[0]);
    for one in &four[1..] {
        let other = like(*one);
        if count(&other) > count(&mask) || (count(&other) == count(&mask) && *one > range) {
            (mask, range) = (other, *one);
        }
    }
    let (mut color, mut mean) = (Vec3::ZERO, 0.0);
    for ((place, stored), _) in places.iter().zip(four).zip(mask).filter(|(_, is)| *is) {
        color += finer[*place];
        mean += stored;
    }
    let count = count(&mask).max(1) as f32;
    (color / count, mean / count)
}

/// Display-linear 0..1 to sRGB 0..1; clamps, NaN to 0. `encoded` in `shaders/shared/pixel.wgsl`.
#[inline(always)]
pub(super) fn encoded(linear: f32) -> f32 {
    let x = if linear > 0.0 { linear.min(1.0) } else { 0.0 };
    let r = x.sqrt().sqrt();
    let curve =
        -0.064_611_55 + r * (0.196_135_95 + r * (1.122_681_4 + r * (-0.335_501_2 + r * 0.081_329_83)));
    if x <= 0.003_130_8 { 12.92 * x } else { curve }
}
