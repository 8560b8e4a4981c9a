//! Composes the textures of a material from the images that its MTL statements name.

use glam::{Vec2, Vec3, Vec4};

use super::mtl::Reference;
use crate::TextureRef;
use crate::load::maps::{Maps, Placed, Reading};
use crate::load::parts::Warnings;
use crate::material::{Filter, Wrap};

/// Height of a bump map's white above its black, as a share of the texture's width. The format gives no unit.
const RELIEF: f32 = 0.01;
/// sRGB luminance of encoded colours.
const LUMA: Vec3 = Vec3::new(0.2126, 0.7152, 0.0722);

/// A texture statement and its image.
pub(super) struct Layer {
    pub(super) name: String,
    pub(super) reference: Reference,
    placed: Placed,
}

impl Layer {
    /// The statement's image, if it could be decoded.
    pub(super) fn new(name: &str, reference: &Reference, maps: &Maps) -> Option<Self> {
        let pixels = maps.image(name)?.clone();
        let wrap = if reference.clamp { Wrap::Clamp } else { Wrap::Repeat };
        // With v flipped: 1 − ((1 − v)·s + o) = v·s + (1 − s − o).
        let Reference { scale, offset, .. } = *reference;
        let offset = Vec2::new(offset.x, 1.0 - scale.y - offset.y);
        let placed = Placed { pixels, scale, offset, wrap };
        Some(Self { name: name.to_owned(), reference: reference.clone(), placed })
    }

    fn reading(&self, srgb: bool) -> Reading {
        let filter = if self.reference.is_nearest { Filter::Nearest } else { Filter::Linear };
        Reading { srgb, wrap: self.placed.wrap, filter }
    }

    /// What sets its texels apart from those of other statements.
    fn recipe(&self) -> String {
        let Reference { base, gain, channel, bump, .. } = self.reference;
        let Placed { scale, offset, .. } = self.placed;
        format!("{}\n{scale} {offset} {base} {gain} {channel:?} {bump}", self.name)
    }

    /// Whether the image is shown without a change of its colours.
    fn is_plain(&self) -> bool {
        self.reference.base == 0.0 && self.reference.gain == 1.0
    }

    fn ranged(&self, value: f32) -> f32 {
        (self.reference.base + self.reference.gain * value).clamp(0.0, 1.0)
    }

    /// Reads a scalar from a texel: the channel that the statement names, else luminance.
    fn scalar(&self, default: u8) -> impl Fn(Vec4) -> f32 + '_ {
        let channel = self.reference.channel.unwrap_or(default);
        move |texel| {
            self.ranged(match channel {
                b'r' => texel.x,
                b'g' => texel.y,
                b'b' => texel.z,
                b'm' | b'a' => texel.w,
                _ => texel.truncate().dot(LUMA),
            })
        }
    }
}

/// One texture in the place of the first layer, with as many texels as the largest. `texel` gets the surface's uv.
fn over(
    layers: &[&Layer],
    (kind, srgb): (&str, bool),
    maps: &mut Maps,
    warnings: &mut Warnings,
    texel: impl Fn(Vec2) -> Vec4 + Sync,
) -> Option<TextureRef> {
    let lead = layers.first()?;
    let area = |layer: &&&Layer| layer.placed.size().map(u64::from).iter().product::<u64>();
    let size = layers.iter().max_by_key(area)?.placed.size();
    for other in &layers[1..] {
        let ratio = other.placed.scale / lead.placed.scale;
        if (ratio - ratio.round()).abs().max_element() > 1e-3 {
            let names = (&other.name, &lead.name);
            warnings.add(format!(
                "texture {} is repeated with {}, at another scale than its own",
                names.0, names.1
            ));
        }
    }
    let recipes: Vec<String> = layers.iter().map(|layer| layer.recipe()).collect();
    let recipe = format!("{}\n{kind}", recipes.join("\n"));
    let make = |x: u32, y: u32| {
        let value = texel(lead.placed.uv([x, y], size)) * 255.0 + 0.5;
        value.to_array().map(|channel| channel as u8)
    };
    let texture = maps.composed(recipe, size, lead.reading(srgb), warnings, make)?;
    Some(lead.placed.place(texture))
}

/// A colour texture. Its alpha is the mask's, if there is one, else the image's own.
pub(super) fn color(
    color: Option<&Layer>,
    mask: Option<&Layer>,
    maps: &mut Maps,
    warnings: &mut Warnings,
) -> Option<TextureRef> {
    let rgb =
        |layer: &Layer, texel: Vec4| texel.truncate().to_array().map(|value| layer.ranged(value)).into();
    match (color, mask) {
        (Some(layer), None) if layer.is_plain() => {
            let texture = maps.plain(&layer.name, layer.reading(true))?;
            Some(layer.placed.place(texture))
        }
        (Some(layer), None) => over(&[layer], ("colour", true), maps, warnings, |uv| {
            let texel = layer.placed.at(uv);
            let color: Vec3 = rgb(layer, texel);
            color.extend(texel.w)
        }),
        (None, None) => None,
        (color, Some(mask)) => {
            let opacity = mask.scalar(if maps.is_alpha_mask(&mask.name) { b'm' } else { b'l' });
            let layers: Vec<&Layer> = color.into_iter().chain([mask]).collect();
            over(&layers, ("masked", true), maps, warnings, |uv| {
                let color: Vec3 = color.map_or(Vec3::ONE, |layer| rgb(layer, layer.placed.at(uv)));
                color.extend(opacity(mask.placed.at(uv)))
            })
        }
    }
}

/// What a material's maps say of its roughness and metallicity.
#[derive(Default)]
pub(super) struct GlossMaps {
    /// Factors of roughness.
    pub(super) roughness: Option<Layer>,
    /// Factors of metallicity.
    pub(super) metallic: Option<Layer>,
    /// Factors of the highlight's exponent.
    pub(super) exponent: Option<Layer>,
}

/// A metallic-roughness texture. Where no map gives the roughness, it is that of `exponent`, if there is a highlight.
pub(super) fn gloss(
    of: &GlossMaps,
    exponent: Option<f32>,
    maps: &mut Maps,
    warnings: &mut Warnings,
) -> Option<TextureRef> {
    let GlossMaps { roughness, metallic, exponent: exponents } = of;
    let all = [roughness, metallic, exponents];
    let layers: Vec<&Layer> = all.into_iter().flatten().collect();
    let at =
        |layer: &Option<Layer>, uv: Vec2| layer.as_ref().map(|layer| layer.scalar(b'l')(layer.placed.at(uv)));
    let kind = format!("gloss {exponent:?} {:?}", all.map(Option::is_some));
    over(&layers, (&kind, false), maps, warnings, |uv| {
        let of_highlight = || Some(roughness_of(exponent? * at(exponents, uv).unwrap_or(1.0)));
        let green = at(roughness, uv).or_else(of_highlight).unwrap_or(1.0);
        Vec4::new(1.0, green, at(metallic, uv).unwrap_or(1.0), 1.0)
    })
}

/// The roughness that gives GGX the lobe of a Phong exponent.
pub(super) fn roughness_of(exponent: f32) -> f32 {
    (2.0 / (exponent + 2.0)).sqrt().sqrt()
}

/// A normal map as it is, and its scale.
pub(super) fn normals(layer: &Layer, maps: &mut Maps) -> Option<(TextureRef, f32)> {
    let texture = maps.plain(&layer.name, layer.reading(false))?;
    Some((layer.placed.place(texture), layer.reference.bump))
}

/// The normal map of a bump statement, and its scale. Many files name a normal map there; an image of heights is turned
/// into one.
pub(super) fn bumps(layer: &Layer, maps: &mut Maps, warnings: &mut Warnings) -> Option<(TextureRef, f32)> {
    if is_normal_map(&layer.placed.pixels.rgba) {
        return normals(layer, maps);
    }
    let [width, height] = layer.placed.size();
    let scalar = layer.scalar(b'l');
    let at = |x: i64, y: i64| scalar(layer.placed.texel(x, y));
    let slope = 0.5 * RELIEF * layer.reference.bump * width as f32;
    let make = |x: u32, y: u32| {
        let (x, y) = (i64::from(x), i64::from(y));
        // The image's rows go down, while a normal map's green points up.
        let across = at(x + 1, y) - at(x - 1, y);
        let up = at(x, y - 1) - at(x, y + 1);
        let normal = Vec3::new(-across * slope, -up * slope, 1.0).normalize();
        let [r, g, b] = ((normal * 0.5 + 0.5) * 255.0 + 0.5).to_array().map(|value| value as u8);
        [r, g, b, 255]
    };
    let recipe = format!("{}\nbump", layer.recipe());
    let texture = maps.composed(recipe, [width, height], layer.reading(false), warnings, make)?;
    Some((layer.placed.place(texture), 1.0))
}

/// Whether an image holds normals rather than heights: most of its texels are coloured, and are unit vectors that point
/// outwards.
fn is_normal_map(rgba: &[u8]) -> bool {
    let is_normal = |texel: &&[u8]| {
        let is_grey = texel[0].abs_diff(texel[1]).max(texel[1].abs_diff(texel[2])) < 16;
        let n = Vec3::new(texel[0].into(), texel[1].into(), texel[2].into()) / 127.5 - 1.0;
        !is_grey && n.z > 0.2 && (n.length() - 1.0).abs() < 0.15
    };
    let count = rgba.len() / 4;
    // A few thousand texels, spread over the image, tell.
    let step = (count / 4096).max(1);
    let seen = rgba.chunks_exact(4).step_by(step);
    let normals = seen.clone().filter(is_normal).count();
    normals * 10 > seen.count() * 9
}
