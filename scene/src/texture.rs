//! Texture filtering: mip chains, and the sampling rule of every renderer.
//!
//! The reference calls [`MipChain::sample`]. The GPU uploads the same levels and follows the same rule, so that a texel's
//! colour is the same in every renderer:
//!
//! 1. `uv` is transformed by [`transform_uv`], its derivatives by the linear part of the same transform.
//! 2. The level is isotropic: `log2(max(|∂(uv·size)/∂x|, |∂(uv·size)/∂y|))`, `size` in texels of level 0,
//!    clamped to the chain ([`MipChain::level`]). Magnification and NaN read level 0, infinity the last one.
//! 3. The two levels around it are each read bilinearly and blended by its fraction (trilinear).
//! 4. Texels are decoded to linear before they are blended, as GPUs do with sRGB formats.
//! 5. Texel centres lie at half integers. `Repeat` reduces a coordinate to its fraction and wraps texel
//!    indices; `Mirror` folds it into 0..1, `Clamp` clamps it, and both clamp texel indices. A coordinate that
//!    is not finite counts as 0.
//! 6. **Alpha tests read level 0**, bilinearly ([`MipChain::alpha`]), at any distance: a cut-out's coverage must not
//!    depend on its distance. Supersampling removes the aliasing. Light rays test transmission likewise ([`MipChain::red`]).
//! 7. A texture with [`Filter::Nearest`] reads the texel of **level 0** that the coordinate lies in: the weight of the second
//!    texel of a row or column is rounded to 0 or 1, half up. Coarser levels are bilinear, whatever filter a file asks of
//!    minification: texels smaller than a pixel are averaged.
//!
//! Level l has max(1, ⌊size / 2ˡ⌋) texels a side. Levels are box-filtered by area from the unrounded level above, so that
//! odd sides lose nothing. Colours of cut-outs are weighted by alpha, and fully transparent texels take the colour of the
//! coarser level: an artist's colour under alpha 0 never bleeds into an edge as a dark fringe.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, LazyLock};

use glam::{Vec2, Vec4};

use crate::material::{Filter, Wrap};
use crate::tone::linear_from_srgb;
use crate::{Scene, Texture, TextureRef};

/// Meaning of a texture's alpha channel for the materials that use it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AlphaUse {
    /// No meaning: one more channel.
    Ignored,
    /// Coverage: the weight of the colour.
    Cutout,
}

/// One size of a texture.
#[derive(Debug, Clone, PartialEq)]
pub struct Level {
    /// Texels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// RGBA, row 0 first, `width * height * 4` bytes, encoded like the texture (sRGB or linear).
    pub rgba: Arc<[u8]>,
}

/// A texture at every size down to one texel, ready for filtering and upload.
#[derive(Debug, Clone, PartialEq)]
pub struct MipChain {
    /// Level 0 first; at least one.
    pub levels: Vec<Level>,
    /// Whether the colour channels are sRGB-encoded.
    pub srgb: bool,
    /// Addressing of u and v.
    pub wrap: [Wrap; 2],
    /// Filter of level 0.
    pub filter: Filter,
}

/// Texels of a level: max(1, ⌊size / 2^level⌋) a side.
pub fn level_size(size: [u32; 2], level: u32) -> [u32; 2] {
    size.map(|side| side.checked_shr(level).unwrap_or(0).max(1))
}

/// Number of levels of a full chain.
pub fn level_count(size: [u32; 2]) -> u32 {
    32 - size[0].max(size[1]).max(1).leading_zeros()
}

/// Position of a mesh's `uv` on the texture: scale, then rotation, then offset (KHR_texture_transform). The rotation is
/// counter-clockwise on the image, whose v points down.
pub fn transform_uv(reference: &TextureRef, uv: Vec2) -> Vec2 {
    transform_duv(reference, uv) + reference.offset
}

/// The linear part of [`transform_uv`], for derivatives of `uv`.
pub fn transform_duv(reference: &TextureRef, duv: Vec2) -> Vec2 {
    let (sin, cos) = reference.rotation.sin_cos();
    let scaled = duv * reference.scale;
    Vec2::new(cos * scaled.x + sin * scaled.y, cos * scaled.y - sin * scaled.x)
}

/// The chains of a scene's textures, in their order. A texture counts as a cut-out if a material with an
/// alpha cutoff uses it as its base colour.
pub fn mip_chains(scene: &Scene) -> Vec<MipChain> {
    let mut uses = vec![AlphaUse::Ignored; scene.textures.len()];
    for material in scene.materials.iter().filter(|m| m.alpha_cutoff().is_some()) {
        if let Some(slot) = material.base_color_texture.and_then(|r| uses.get_mut(r.texture as usize)) {
            *slot = AlphaUse::Cutout;
        }
    }
    // The largest first, each by the next free thread.
    let mut jobs: Vec<usize> = (0..uses.len()).collect();
    jobs.sort_by_key(|&index| std::cmp::Reverse(scene.textures[index].rgba.len()));
    let next = AtomicUsize::new(0);
    let build = || -> Vec<(usize, MipChain)> {
        let indices = std::iter::from_fn(|| jobs.get(next.fetch_add(1, Ordering::Relaxed)).copied());
        indices.map(|index| (index, MipChain::new(&scene.textures[index], uses[index]))).collect()
    };
    let threads = std::thread::available_parallelism().map_or(1, |n| n.get()).min(jobs.len());
    let mut chains: Vec<(usize, MipChain)> = std::thread::scope(|scope| {
        let handles: Vec<_> = (0..threads).map(|_| scope.spawn(build)).collect();
        let joined = handles.into_iter().map(|handle| handle.join());
        joined.flat_map(|part| part.unwrap_or_else(|panic| std::panic::resume_unwind(panic))).collect()
    });
    chains.sort_by_key(|&(index, _)| index);
    chains.into_iter().map(|(_, chain)| chain).collect()
}

impl MipChain {
    /// Filters `texture` down to one texel. A texture without texels, or whose bytes do not match its size,
    /// becomes one white texel.
    pub fn new(texture: &Texture, alpha: AlphaUse) -> Self {
        let mut levels = Self::first_level(texture).levels;
        let size = [levels[0].width, levels[0].height];
        let mut image: Option<Linear> = None;
        for l in 1..level_count(size) {
            let next = match &image {
                Some(image) => halved(image.size, |i| image.texels[i], level_size(size, l), alpha),
                None => {
                    // Decoded as it is read: the largest level would take four times its bytes.
                    let color = if texture.srgb { &SRGB.linear } else { &UNIT };
                    let texels = levels[0].rgba.as_chunks::<4>().0;
                    halved(size, |i| decode(texels[i], color), level_size(size, l), alpha)
                }
            };
            levels.push(next.encode(texture.srgb));
            image = Some(next);
        }
        if alpha == AlphaUse::Cutout {
            fill_transparent(&mut levels);
        }
        Self { levels, srgb: texture.srgb, wrap: texture.wrap, filter: texture.filter }
    }

    /// Only level 0, unfiltered: enough for tests of alpha and transmission.
    pub fn first_level(texture: &Texture) -> Self {
        let bytes = u128::from(texture.width) * u128::from(texture.height) * 4;
        let level = if bytes == 0 || texture.rgba.len() as u128 != bytes {
            Level { width: 1, height: 1, rgba: Arc::from([255u8; 4]) }
        } else {
            Level { width: texture.width, height: texture.height, rgba: Arc::clone(&texture.rgba) }
        };
        Self { levels: vec![level], srgb: texture.srgb, wrap: texture.wrap, filter: texture.filter }
    }

    /// Texels of level 0.
    pub fn size(&self) -> Vec2 {
        Vec2::new(self.levels[0].width as f32, self.levels[0].height as f32)
    }

    /// The level for a pixel across which the transformed `uv` changes by `duv_dx` and `duv_dy`: rule 2.
    pub fn level(&self, duv_dx: Vec2, duv_dy: Vec2) -> f32 {
        let last = (self.levels.len() - 1) as f32;
        let (x, y) = ((duv_dx * self.size()).length(), (duv_dy * self.size()).length());
        // f32::max ignores a NaN beside a number, and no comparison below holds for one.
        let texels = x.max(y);
        if texels > 1.0 { texels.log2().min(last) } else { 0.0 }
    }

    /// Linear colour and alpha at the transformed `uv`, trilinear: rules 3 to 5, and 7. A level that is NaN counts
    /// as 0.
    pub fn sample(&self, uv: Vec2, level: f32) -> Vec4 {
        let last = self.levels.len() - 1;
        let level = if level > 0.0 { level.min(last as f32) } else { 0.0 };
        let fine = level as usize;
        let fraction = level - fine as f32;
        let color = self.bilinear(uv, fine);
        if fraction > 0.0 { color.lerp(self.bilinear(uv, (fine + 1).min(last)), fraction) } else { color }
    }

    /// Alpha for an alpha test at the transformed `uv`: rule 6.
    pub fn alpha(&self, uv: Vec2) -> f32 {
        self.blend(uv, 0, |texel| f32::from(texel[3]) / 255.0)
    }

    /// The red channel of a linear texture at the transformed `uv`, for tests of transmission: rule 6.
    pub fn red(&self, uv: Vec2) -> f32 {
        self.blend(uv, 0, |texel| f32::from(texel[0]) / 255.0)
    }

    fn bilinear(&self, uv: Vec2, level: usize) -> Vec4 {
        let color = if self.srgb { &SRGB.linear } else { &UNIT };
        self.blend(uv, level, |texel| {
            let [r, g, b] = [texel[0], texel[1], texel[2]].map(|byte| color[usize::from(byte)]);
            Vec4::new(r, g, b, UNIT[usize::from(texel[3])])
        })
    }

    /// The four texels around `uv`, decoded and blended, or the one that it lies in: rule 7.
    fn blend<T>(&self, uv: Vec2, level: usize, decode: impl Fn(&[u8]) -> T) -> T
    where
        T: std::ops::Mul<f32, Output = T> + std::ops::Add<Output = T>,
    {
        let Level { width, height, rgba } = &self.levels[level];
        let nearest = self.filter == Filter::Nearest && level == 0;
        let taps = |coordinate, side, wrap| {
            let (texels, fraction) = taps(coordinate, side, wrap);
            (texels, if nearest { f32::from(u8::from(fraction >= 0.5)) } else { fraction })
        };
        let ([x0, x1], fx) = taps(uv.x, *width, self.wrap[0]);
        let ([y0, y1], fy) = taps(uv.y, *height, self.wrap[1]);
        let texel = |x: u32, y: u32| {
            let at = (y as usize * *width as usize + x as usize) * 4;
            decode(&rgba[at..at + 4])
        };
        let row = |y| texel(x0, y) * (1.0 - fx) + texel(x1, y) * fx;
        row(y0) * (1.0 - fy) + row(y1) * fy
    }
}

/// The two texels of a row or column around a coordinate, and the weight of the second.
fn taps(coordinate: f32, side: u32, wrap: Wrap) -> ([u32; 2], f32) {
    let c = if coordinate.is_finite() { coordinate } else { 0.0 };
    let c = match wrap {
        Wrap::Repeat => c - c.floor(),
        Wrap::Clamp => c.clamp(0.0, 1.0),
        Wrap::Mirror => {
            let in_two_tiles = c - 2.0 * (c * 0.5).floor();
            if in_two_tiles > 1.0 { 2.0 - in_two_tiles } else { in_two_tiles }
        }
    };
    let x = c * side as f32 - 0.5;
    let first = x.floor();
    let index = |i: i64| match wrap {
        Wrap::Repeat => i.rem_euclid(i64::from(side)) as u32,
        Wrap::Clamp | Wrap::Mirror => i.clamp(0, i64::from(side) - 1) as u32,
    };
    ([index(first as i64), index(first as i64 + 1)], x - first)
}

/// An image in linear light, not rounded.
struct Linear {
    size: [u32; 2],
    texels: Vec<Vec4>,
}

impl Linear {
    fn encode(&self, srgb: bool) -> Level {
        let unit = |x: f32| (x * 255.0 + 0.5) as u8;
        let color = |x: f32| if srgb { SRGB.encode(x) } else { unit(x) };
        let texel = |t: &Vec4| [color(t.x), color(t.y), color(t.z), unit(t.w)];
        let rgba = self.texels.iter().flat_map(texel).collect();
        Level { width: self.size[0], height: self.size[1], rgba }
    }
}

/// A texel in linear light; `color` decodes a byte of its colour.
fn decode(texel: [u8; 4], color: &[f32; 256]) -> Vec4 {
    let [r, g, b] = [texel[0], texel[1], texel[2]].map(|byte| color[usize::from(byte)]);
    Vec4::new(r, g, b, UNIT[usize::from(texel[3])])
}

/// Averages by area from an image of size `from` onto `size`, of which no side is longer.
fn halved(from: [u32; 2], texel: impl Fn(usize) -> Vec4, size: [u32; 2], alpha: AlphaUse) -> Linear {
    let [columns, rows] = [0, 1].map(|axis| box_weights(from[axis], size[axis]));
    let width = from[0] as usize;
    let mut texels = Vec::with_capacity(columns.len() * rows.len());
    let mut average = |x0: usize, y0: usize, column_weights: &[f32], row_weights: &[f32]| {
        let (mut plain, mut weighted) = (Vec4::ZERO, Vec4::ZERO);
        for (y, wy) in row_weights.iter().enumerate() {
            for (x, wx) in column_weights.iter().enumerate() {
                let texel = texel((y0 + y) * width + x0 + x);
                plain += texel * (wx * wy);
                weighted += texel * (wx * wy * texel.w);
            }
        }
        let color = if alpha == AlphaUse::Cutout && plain.w > 0.0 { weighted / plain.w } else { plain };
        texels.push(color.truncate().extend(plain.w));
    };
    let even = from[0] == 2 * size[0] && from[1] == 2 * size[1];
    for (y0, row_weights) in &rows {
        for (x0, column_weights) in &columns {
            if even {
                // Of a known number, so that the loops are unrolled.
                average(*x0, *y0, &[0.5; 2], &[0.5; 2]);
            } else {
                average(*x0, *y0, column_weights, row_weights);
            }
        }
    }
    Linear { size, texels }
}

/// For each of `to` texels of a side: the index of the first of the `from` texels under it, and the weights of those.
fn box_weights(from: u32, to: u32) -> Vec<(usize, Vec<f32>)> {
    let scale = f64::from(from) / f64::from(to);
    (0..to)
        .map(|i| {
            let (begin, end) = (f64::from(i) * scale, f64::from(i + 1) * scale);
            let (first, last) = (begin as u32, (end.ceil() as u32).min(from));
            let covered = |t: u32| (f64::from(t + 1).min(end) - f64::from(t).max(begin)) / scale;
            (first as usize, (first..last).map(|t| covered(t) as f32).collect())
        })
        .collect()
}

/// Gives fully transparent texels the colour of the coarser level, coarse to fine.
fn fill_transparent(levels: &mut [Level]) {
    for l in (0..levels.len().saturating_sub(1)).rev() {
        if levels[l].rgba.chunks_exact(4).all(|texel| texel[3] > 0) {
            continue;
        }
        let mut rgba = levels[l].rgba.to_vec();
        let (fine, coarse) = (&levels[l], &levels[l + 1]);
        for (i, texel) in rgba.chunks_exact_mut(4).enumerate().filter(|(_, texel)| texel[3] == 0) {
            let (x, y) = (i as u32 % fine.width, i as u32 / fine.width);
            let (cx, cy) = ((x / 2).min(coarse.width - 1), (y / 2).min(coarse.height - 1));
            let from = (cy as usize * coarse.width as usize + cx as usize) * 4;
            texel[..3].copy_from_slice(&coarse.rgba[from..from + 3]);
        }
        levels[l].rgba = rgba.into();
    }
}

/// Bytes as fractions.
static UNIT: LazyLock<[f32; 256]> = LazyLock::new(|| std::array::from_fn(|byte| byte as f32 / 255.0));

static SRGB: LazyLock<SrgbTable> = LazyLock::new(SrgbTable::new);

/// sRGB both ways without a power function a texel: large scenes have 10⁸ of them.
struct SrgbTable {
    /// Linear value of each byte.
    linear: [f32; 256],
    /// The least linear value that rounds to each byte.
    least: [f32; 256],
    /// The byte of the smallest linear value in each of 4096 equal intervals.
    guess: Vec<u8>,
}

impl SrgbTable {
    fn new() -> Self {
        let linear = std::array::from_fn(|byte| linear_from_srgb(byte as f32 / 255.0));
        let least = std::array::from_fn(|byte| match byte {
            0 => f32::NEG_INFINITY,
            _ => linear_from_srgb((byte as f32 - 0.5) / 255.0),
        });
        let byte = |x: f32| least.partition_point(|&l| l <= x).saturating_sub(1) as u8;
        let guess = (0..4096).map(|i| byte(i as f32 / 4096.0)).collect();
        Self { linear, least, guess }
    }

    fn encode(&self, linear: f32) -> u8 {
        let mut byte = self.guess[((linear * 4096.0) as usize).min(4095)];
        while byte < 255 && self.least[usize::from(byte) + 1] <= linear {
            byte += 1;
        }
        byte
    }
}

#[cfg(test)]
mod tests;
