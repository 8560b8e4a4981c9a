//! MTL: converts Phong materials to metallic-roughness.

use std::collections::BTreeSet;

use bytes::Bytes;
use glam::{Vec2, Vec3, Vec4};

use super::text::{lines, number, numbers, words};
use crate::load::Warnings;
use crate::load::bundle::{Bundle, relative};
use crate::load::images::{Textures, Wanted};
use crate::material::{Filter, Wrap};
use crate::{AlphaMode, Material, Texture, TextureRef};

/// A material of an MTL file.
#[derive(Debug, Clone, Default)]
struct Phong {
    name: String,
    diffuse: Option<Vec3>,
    specular: Vec3,
    exponent: Option<f32>,
    emission: Vec3,
    dissolve: Option<f32>,
    transparency: Option<f32>,
    ior: Option<f32>,
    illumination: Option<i64>,
    roughness: Option<f32>,
    metallic: Option<f32>,
    maps: Vec<(Map, Reference)>,
}

/// The use of a texture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Map {
    Diffuse,
    Emission,
    Normal,
    Dissolve,
}

/// A texture statement.
#[derive(Debug, Clone, PartialEq)]
struct Reference {
    file: String,
    /// OBJ's v points up: `uv · scale + offset`.
    scale: Vec2,
    offset: Vec2,
    clamp: bool,
}

/// The textures named by a library within the scene's folder.
pub(super) fn textures(library: &str, bytes: &[u8]) -> BTreeSet<String> {
    let materials = parse(bytes);
    let files = materials.iter().flat_map(|material| &material.maps).map(|(_, reference)| &reference.file);
    files.filter_map(|file| relative(folder_of(library), file).ok()).collect()
}

fn folder_of(library: &str) -> &str {
    library.rsplit_once('/').map_or("", |(folder, _)| folder)
}

/// Reads the materials of a library, by name.
pub(super) fn read(
    library: &str,
    bytes: &Bytes,
    bundle: &Bundle,
    images: &mut Textures,
    warnings: &mut Warnings,
) -> Vec<(String, Material)> {
    let mut texture = |reference: &Reference, srgb: bool| -> Option<TextureRef> {
        let name = relative(folder_of(library), &reference.file);
        match name.and_then(|name| Ok((bundle.get(&name)?.clone(), name))) {
            Ok((bytes, name)) => {
                let wrap = if reference.clamp { Wrap::Clamp } else { Wrap::Repeat };
                let image = images.add_image(name, bytes);
                // With v flipped: 1 − ((1 − v)·s + o) = v·s + (1 − s − o).
                let Reference { scale, offset, .. } = *reference;
                let offset = Vec2::new(offset.x, 1.0 - scale.y - offset.y);
                let wanted = Wanted { image, srgb, wrap: [wrap; 2], filter: Filter::Linear };
                Some(TextureRef { offset, scale, ..TextureRef::new(images.texture(wanted)) })
            }
            Err(reason) => {
                warnings.add(format!("texture {reason}: left out"));
                None
            }
        }
    };
    let materials = parse(bytes);
    materials.iter().map(|phong| (phong.name.clone(), convert(phong, &mut texture))).collect()
}

/// Converts Phong to metallic-roughness.
///
/// - A highlight is kept if the file intends one: a specular colour above 1%, an exponent, and an illumination model that
///   shows it. Roughness = (2/(n + 2))^¼ gives GGX the lobe of exponent n.
/// - A specular colour over black is a metal of that colour.
/// - A dissolve below one is transmission: as a cut-out, glass would be a hole.
fn convert(phong: &Phong, texture: &mut impl FnMut(&Reference, bool) -> Option<TextureRef>) -> Material {
    let unit = |v: Vec3| if v.is_finite() { v.clamp(Vec3::ZERO, Vec3::ONE) } else { Vec3::ZERO };
    let map = |kind| phong.maps.iter().rev().find(|(k, _)| *k == kind).map(|(_, reference)| reference);
    let diffuse =
        unit(phong.diffuse.unwrap_or(if map(Map::Diffuse).is_some() { Vec3::ONE } else { Vec3::splat(0.8) }));
    let specular = unit(phong.specular);
    let shows_highlights = phong.illumination.is_none_or(|model| model >= 2);
    let exponent = phong.exponent.filter(|n| n.is_finite() && *n > 0.0);
    let mut material = Material {
        name: phong.name.clone(),
        base_color: diffuse.extend(1.0),
        base_color_texture: map(Map::Diffuse).and_then(|reference| texture(reference, true)),
        normal_texture: map(Map::Normal).and_then(|reference| texture(reference, false)),
        emissive_texture: map(Map::Emission).and_then(|reference| texture(reference, true)),
        emissive: if phong.emission.is_finite() { phong.emission.max(Vec3::ZERO) } else { Vec3::ZERO },
        ..Material::default()
    };
    if material.emissive_texture.is_some() && material.emissive == Vec3::ZERO {
        material.emissive = Vec3::ONE;
    }
    if let (true, true, Some(n)) = (shows_highlights, specular.max_element() > 0.01, exponent) {
        material.roughness = (2.0 / (n + 2.0)).sqrt().sqrt();
        if diffuse.max_element() < 0.01 && material.base_color_texture.is_none() {
            material.metallic = 1.0;
            material.base_color = specular.extend(1.0);
        }
    }
    let factor = |x: Option<f32>| x.filter(|x| x.is_finite()).map(|x| x.clamp(0.0, 1.0));
    if let Some(roughness) = factor(phong.roughness) {
        material.roughness = roughness;
    }
    if let Some(metallic) = factor(phong.metallic) {
        material.metallic = metallic;
    }
    if let Some(ior) = phong.ior.filter(|ior| *ior > 1.0 && *ior < 10.0) {
        material.ior = ior;
    }
    // If a file has both, d is the one that the format defines.
    let opaque =
        factor(phong.dissolve).or_else(|| factor(phong.transparency).map(|t| 1.0 - t)).unwrap_or(1.0);
    if map(Map::Dissolve).is_none() {
        material.transmission = 1.0 - opaque;
    }
    material
}

/// Cuts materials out along the alpha of their base colour's texture, if it has any.
pub(super) fn cut_out(materials: &mut [Material], textures: &[Texture]) {
    for material in materials {
        let Some(reference) = material.base_color_texture else { continue };
        let rgba = &textures[reference.texture as usize].rgba;
        if rgba.chunks_exact(4).any(|texel| texel[3] < 255) {
            material.alpha = AlphaMode::Mask(0.5);
            material.base_color =
                Vec4::new(material.base_color.x, material.base_color.y, material.base_color.z, 1.0);
        }
    }
}

fn parse(bytes: &[u8]) -> Vec<Phong> {
    let mut materials: Vec<Phong> = Vec::new();
    lines(bytes, |keyword, rest| {
        if keyword.eq_ignore_ascii_case(b"newmtl") {
            let name = String::from_utf8_lossy(rest).trim().to_owned();
            materials.push(Phong { name, ..Phong::default() });
            return;
        }
        let Some(material) = materials.last_mut() else { return };
        let ([a, b, c], count) = numbers::<3>(rest);
        // One number stands for three. Spectral files and other colour spaces are not supported.
        let color =
            || if count == 1 { Vec3::splat(a as f32) } else { Vec3::new(a as f32, b as f32, c as f32) };
        let value = (count > 0).then_some(a as f32);
        match keyword.to_ascii_lowercase().as_slice() {
            b"kd" => material.diffuse = Some(color()),
            b"ks" => material.specular = color(),
            b"ke" => material.emission = color(),
            b"ns" => material.exponent = value,
            b"ni" => material.ior = value,
            b"d" => material.dissolve = value,
            b"tr" => material.transparency = value,
            b"pr" => material.roughness = value,
            b"pm" => material.metallic = value,
            b"illum" => material.illumination = Some(a as i64),
            b"map_kd" => material.maps.extend(reference(rest).map(|r| (Map::Diffuse, r))),
            b"map_ke" => material.maps.extend(reference(rest).map(|r| (Map::Emission, r))),
            b"map_d" => material.maps.extend(reference(rest).map(|r| (Map::Dissolve, r))),
            b"norm" | b"map_kn" => material.maps.extend(reference(rest).map(|r| (Map::Normal, r))),
            _ => {}
        }
    });
    materials
}

/// A texture statement: options, then a file name that may contain spaces. `None` without a name.
fn reference(rest: &[u8]) -> Option<Reference> {
    let mut reference = Reference { file: String::new(), scale: Vec2::ONE, offset: Vec2::ZERO, clamp: false };
    let mut left = rest.trim_ascii();
    while left.starts_with(b"-") {
        let (option, mut after) = split_word(left);
        let (least, most) = match option {
            b"-o" | b"-s" | b"-t" => (1, 3),
            b"-mm" => (2, 2),
            b"-blendu" | b"-blendv" | b"-cc" | b"-clamp" | b"-imfchan" | b"-type" | b"-texres" | b"-bm"
            | b"-boost" | b"-colorspace" => (1, 1),
            // A file name that begins with a dash.
            _ => break,
        };
        let mut values = Vec::new();
        while values.len() < most {
            let (word, more) = split_word(after);
            if word.is_empty() || (values.len() >= least && number(word).is_nan()) {
                break;
            }
            values.push(word);
            after = more;
        }
        let first = values.first().map_or(f64::NAN, |word| number(word)) as f32;
        let second = values.get(1).map(|word| number(word) as f32);
        match option {
            b"-o" => reference.offset = Vec2::new(first, second.unwrap_or(0.0)),
            b"-s" => reference.scale = Vec2::new(first, second.unwrap_or(1.0)),
            b"-clamp" => reference.clamp = values.first() == Some(&&b"on"[..]),
            _ => {}
        }
        left = after;
    }
    if !reference.offset.is_finite() {
        reference.offset = Vec2::ZERO;
    }
    if !reference.scale.is_finite() {
        reference.scale = Vec2::ONE;
    }
    reference.file = String::from_utf8_lossy(left).trim().to_owned();
    (!reference.file.is_empty()).then_some(reference)
}

fn split_word(text: &[u8]) -> (&[u8], &[u8]) {
    let word = words(text).next().unwrap_or_default();
    let start = text.len() - text.trim_ascii_start().len();
    (word, text[start + word.len()..].trim_ascii_start())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn only(text: &str) -> Material {
        let phong = parse(text.as_bytes()).pop().unwrap();
        convert(&phong, &mut |_, _| None)
    }

    #[test]
    fn a_highlight_is_kept_only_if_the_file_intends_one() {
        let shiny = only("newmtl a\nKd .5 .5 .5\nKs .2 .2 .2\nNs 30\nillum 2");
        assert!((shiny.roughness - 0.5).abs() < 1e-6 && shiny.metallic == 0.0);
        for matt in ["Ks 0 0 0\nNs 30", "Ks 1 1 1\nNs 30\nillum 1", "Ks 1 1 1", "Ks 1 1 1\nNs nan"] {
            assert!(!only(&format!("newmtl a\nKd 1 1 1\n{matt}")).is_glossy(), "{matt}");
        }
        let mirror = only("newmtl a\nKd 0 0 0\nKs .9 .8 .7\nNs 1000");
        assert_eq!((mirror.metallic, mirror.base_color.truncate()), (1.0, Vec3::new(0.9, 0.8, 0.7)));
    }

    #[test]
    fn emitters_and_glass_are_recognised() {
        assert_eq!(only("newmtl a\nKe 10 10 10").emissive, Vec3::splat(10.0));
        assert_eq!(only("newmtl a\nKd 0.5").base_color, Vec3::splat(0.5).extend(1.0));
        assert!((only("newmtl a\nd 0.3\nTr 0.9").transmission - 0.7).abs() < 1e-6);
        assert!((only("newmtl a\nTr 0.9").transmission - 0.9).abs() < 1e-6);
        assert_eq!(only("newmtl a\nNi 1.33").ior, 1.33);
        assert_eq!(only("newmtl a\nKd nan 0 0\nKe inf 0 0").emissive, Vec3::ZERO);
    }

    #[test]
    fn texture_options_are_told_from_file_names_with_spaces() {
        let read = |text: &str| reference(text.as_bytes()).unwrap();
        let odd = read("-bm 1.0 -o 0.1 -s 2 3 4 -mm 0 1 -clamp on my wood texture.png");
        assert_eq!(odd.file, "my wood texture.png");
        assert_eq!((odd.offset, odd.scale, odd.clamp), (Vec2::new(0.1, 0.0), Vec2::new(2.0, 3.0), true));
        assert_eq!(read("-texres 512 -type sphere a.png").file, "a.png");
        assert_eq!(read("-dash.png").file, "-dash.png");
        assert_eq!(read("-s nan x 7up.png").file, "x 7up.png");
        assert_eq!(reference(b"-o 1 2 3"), None);
        assert_eq!(reference(b""), None);
    }
}
