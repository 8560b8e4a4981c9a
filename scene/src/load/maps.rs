//! Textures of OBJ and PLY files, whose images may have to be composed: a mask and a colour are one texture here.

use std::collections::{BTreeMap, HashMap};
use std::ops::RangeInclusive;
use std::sync::Arc;

use bytes::Bytes;
use glam::{Vec2, Vec4};
use rayon::prelude::*;

use super::images::{Pixels, Size, decode_used};
use super::parts::Warnings;
use crate::material::{Filter, Wrap};
use crate::{AlphaMode, Texture, TextureRef};

/// Limit of the bytes of composed textures: a factor on those of the decoded images, and a number for small ones.
const MOST_COMPOSED: (u64, u64) = (4, 64 << 20);
/// Texels with these alphas are partly transparent, rather than the smooth edge or the noise of a cut-out.
const PARTLY: RangeInclusive<u8> = 16..=239;
/// A texture is blended if this share of its texels is partly transparent, or this many times as many as are opaque.
const FAIR_SHARE: (f64, f64) = (0.2, 2.0);

/// Distance from a texel's middle, in texels, within which an image is not blended: less than one step of a byte.
const ON_TEXEL: f32 = 1.0 / 512.0;

/// Decoded images by the names of their files, and the textures made of them.
#[derive(Default)]
pub(super) struct Maps {
    images: BTreeMap<String, Pixels>,
    pub(super) textures: Vec<Texture>,
    /// Textures by how they were made.
    made: HashMap<String, u32>,
    /// Bytes that may still be composed.
    left: u64,
    /// What has been found out of textures' alpha.
    alpha: HashMap<u32, AlphaMode>,
    /// Whether images are masks in their alpha, by name.
    alpha_masks: HashMap<String, bool>,
}

/// How a texture reads an image.
#[derive(Debug, Clone, Copy)]
pub(super) struct Reading {
    /// Whether colours are sRGB-encoded.
    pub(super) srgb: bool,
    pub(super) wrap: Wrap,
    pub(super) filter: Filter,
}

/// An image as it lies on a surface.
#[derive(Clone)]
pub(super) struct Placed {
    pub(super) pixels: Pixels,
    /// `uv · scale + offset` is the position on the image, whose v points down.
    pub(super) scale: Vec2,
    pub(super) offset: Vec2,
    pub(super) wrap: Wrap,
}

impl Maps {
    /// Decodes images in parallel. One that cannot be decoded costs a warning.
    pub(super) fn decode(files: BTreeMap<String, Bytes>, warnings: &mut Warnings) -> Self {
        let files: Vec<(String, Bytes)> = files.into_iter().collect();
        let decoded = decode_used(&files, &vec![true; files.len()]);
        let mut images = BTreeMap::new();
        for ((name, _), result) in files.into_iter().zip(decoded) {
            match result {
                Some(Ok(pixels)) => drop(images.insert(name, pixels)),
                Some(Err(reason)) => warnings.add(format!("texture {name}: {reason}: left out")),
                None => {}
            }
        }
        let bytes: u64 = images.values().map(|pixels| pixels.rgba.len() as u64).sum();
        let left = bytes.saturating_mul(MOST_COMPOSED.0).saturating_add(MOST_COMPOSED.1);
        Self { images, left, ..Self::default() }
    }

    /// An image by the name of its file, if it could be decoded.
    pub(super) fn image(&self, name: &str) -> Option<&Pixels> {
        self.images.get(name)
    }

    /// The texture that shows an image as it is.
    pub(super) fn plain(&mut self, name: &str, reading: Reading) -> Option<u32> {
        let pixels = self.images.get(name)?.clone();
        let recipe = format!("{name}\n{reading:?}");
        Some(*self.made.entry(recipe).or_insert_with(|| push(&mut self.textures, name, pixels, reading)))
    }

    /// The texture that `texel` gives for each column and row of a size. There is one for each `recipe`, whose first line
    /// is its name. `None`, with a warning, if there are too many.
    pub(super) fn composed(
        &mut self,
        recipe: String,
        size: [u32; 2],
        reading: Reading,
        warnings: &mut Warnings,
        texel: impl Fn(u32, u32) -> [u8; 4] + Sync,
    ) -> Option<u32> {
        let recipe = format!("{recipe}\n{reading:?}");
        if let Some(texture) = self.made.get(&recipe) {
            return Some(*texture);
        }
        let name = recipe.lines().next().unwrap_or_default();
        let [width, height] = size;
        let bytes = u64::from(width) * u64::from(height) * 4;
        let Some(left) = self.left.checked_sub(bytes) else {
            warnings.add(format!("texture {name}: too many textures to compose: left out"));
            return None;
        };
        self.left = left;
        let mut rgba = vec![0; bytes as usize];
        rgba.par_chunks_exact_mut(width as usize * 4).enumerate().for_each(|(y, row)| {
            row.chunks_exact_mut(4)
                .enumerate()
                .for_each(|(x, out)| out.copy_from_slice(&texel(x as u32, y as u32)));
        });
        let pixels = Pixels { size: Size { width, height }, rgba: Arc::from(rgba) };
        let texture = push(&mut self.textures, name, pixels, reading);
        self.made.insert(recipe, texture);
        Some(texture)
    }

    /// The meaning of a texture's alpha: none if it is opaque, a cut-out if it is hardly anywhere partly transparent, else
    /// blending.
    pub(super) fn alpha(&mut self, texture: u32) -> AlphaMode {
        *self.alpha.entry(texture).or_insert_with(|| alpha_of(&self.textures[texture as usize].rgba))
    }

    /// Whether an image is a mask in its alpha: it varies, or nothing else does and it is not opaque.
    pub(super) fn is_alpha_mask(&mut self, name: &str) -> bool {
        let Some(pixels) = self.images.get(name) else { return false };
        *self.alpha_masks.entry(name.to_owned()).or_insert_with(|| {
            let first = &pixels.rgba[..4];
            let (mut alpha_varies, mut color_varies) = (false, false);
            for texel in pixels.rgba.chunks_exact(4) {
                alpha_varies |= texel[3] != first[3];
                color_varies |= texel[..3] != first[..3];
            }
            alpha_varies || (!color_varies && first[3] < 255)
        })
    }
}

fn alpha_of(rgba: &[u8]) -> AlphaMode {
    let (mut all, mut partly, mut solid, mut is_opaque) = (0u64, 0u64, 0u64, true);
    for texel in rgba.chunks_exact(4) {
        all += 1;
        is_opaque &= texel[3] == 255;
        partly += u64::from(PARTLY.contains(&texel[3]));
        solid += u64::from(texel[3] > *PARTLY.end());
    }
    let (of_all, of_solid) = (FAIR_SHARE.0 * all as f64, FAIR_SHARE.1 * solid as f64);
    if is_opaque {
        AlphaMode::Opaque
    } else if partly as f64 > of_all.min(of_solid) {
        AlphaMode::Blend
    } else {
        AlphaMode::Mask(0.5)
    }
}

fn push(textures: &mut Vec<Texture>, name: &str, pixels: Pixels, reading: Reading) -> u32 {
    let (Pixels { size: Size { width, height }, rgba }, Reading { srgb, wrap, filter }) = (pixels, reading);
    textures.push(Texture { name: name.to_owned(), width, height, rgba, srgb, wrap: [wrap; 2], filter });
    textures.len() as u32 - 1
}

impl Placed {
    /// Columns and rows.
    pub(super) fn size(&self) -> [u32; 2] {
        [self.pixels.size.width, self.pixels.size.height]
    }

    /// A texture in this image's place.
    pub(super) fn place(&self, texture: u32) -> TextureRef {
        TextureRef { scale: self.scale, offset: self.offset, ..TextureRef::new(texture) }
    }

    /// The surface's uv at the middle of a texel of an image of this size in this place.
    pub(super) fn uv(&self, [x, y]: [u32; 2], [width, height]: [u32; 2]) -> Vec2 {
        let on_image = Vec2::new((x as f32 + 0.5) / width as f32, (y as f32 + 0.5) / height as f32);
        (on_image - self.offset) / self.scale
    }

    /// RGBA 0..1 as it is encoded, bilinear, at the surface's uv.
    pub(super) fn at(&self, uv: Vec2) -> Vec4 {
        let on_image = uv * self.scale + self.offset;
        let position =
            on_image * Vec2::new(self.pixels.size.width as f32, self.pixels.size.height as f32) - 0.5;
        let position = if position.is_finite() { position } else { Vec2::ZERO };
        // Most masks lie texel on texel on their colours.
        let nearest = position.round();
        if (position - nearest).abs().max_element() < ON_TEXEL {
            return self.texel(nearest.x as i64, nearest.y as i64);
        }
        let (first, blend) = (position.floor(), position - position.floor());
        let (x, y) = (first.x as i64, first.y as i64);
        let row = |y| self.texel(x, y).lerp(self.texel(x + 1, y), blend.x);
        row(y).lerp(row(y + 1), blend.y)
    }

    /// RGBA 0..1 of a texel; outside of the image it is that of its addressing.
    pub(super) fn texel(&self, x: i64, y: i64) -> Vec4 {
        let [x, y] =
            [(x, self.pixels.size.width), (y, self.pixels.size.height)].map(|(at, side)| match self.wrap {
                Wrap::Clamp => at.clamp(0, i64::from(side) - 1) as usize,
                _ => at.rem_euclid(i64::from(side)) as usize,
            });
        let at = (y * self.pixels.size.width as usize + x) * 4;
        Vec4::from_array([0, 1, 2, 3].map(|k| f32::from(self.pixels.rgba[at + k]) / 255.0))
    }
}
