//! Converts materials of MTL files to metallic-roughness.

use std::collections::BTreeMap;

use glam::Vec3;

use super::compose::{self, GlossMaps, Layer, roughness_of};
use super::mtl::{Map, Phong, Reference};
use crate::load::maps::Maps;
use crate::load::parts::Warnings;
use crate::load::scene_files::SceneFiles;
use crate::{AlphaMode, Material};

/// Opacities from here on are rounded numbers of opaque materials.
const OPAQUE: f32 = 0.999;
/// The exponent of a highlight whose map comes without one: the largest that the format defines.
const LARGEST_EXPONENT: f32 = 1000.0;

/// A material, and the folder of its library.
#[derive(Debug)]
pub(super) struct Defined {
    pub(super) folder: String,
    pub(super) phong: Phong,
}

impl Defined {
    /// The material without its textures.
    pub(super) fn without_maps(&self) -> Self {
        let phong = Phong { maps: Vec::new(), ..self.phong.clone() };
        Self { folder: self.folder.clone(), phong }
    }
}

/// Decodes the images of all used materials, and warns of what the materials say and the picture lacks.
pub(super) fn decode(used: &[&Defined], bundle: &SceneFiles, warnings: &mut Warnings) -> Maps {
    let mut files = BTreeMap::new();
    let mut missing = BTreeMap::new();
    let mut unshown: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
    for Defined { folder, phong } in used {
        for (kind, reference) in &phong.maps {
            if *kind == Map::Ambient && phong.map(Map::Diffuse).is_some() {
                continue;
            }
            match bundle.get(folder, &reference.file) {
                Ok((name, bytes)) => drop(files.insert(name.to_owned(), bytes.clone())),
                Err(reason) => drop(missing.insert(reference.file.clone(), reason)),
            }
        }
        phong.unshown.iter().for_each(|what| unshown.entry(what).or_default().push(&phong.name));
    }
    for reason in missing.into_values() {
        warnings.add(format!("texture {reason}: left out"));
    }
    for (what, materials) in unshown {
        let more = materials.len().saturating_sub(3);
        let more = if more > 0 { format!(" and {more} more") } else { String::new() };
        let first: Vec<&str> = materials.into_iter().take(3).collect();
        warnings.add(format!("{what} is not shown: material {}{more}", first.join(", ")));
    }
    Maps::decode(files, warnings)
}

/// Converts Phong to metallic-roughness, with the textures that can be had.
///
/// - A texture multiplies its factor. A factor that is absent or zero beside a texture statement counts as one, since
///   exporters write zeros there. A texture that cannot be had leaves the factor as if there were no texture, except that
///   it makes a surface neither glow nor metal.
/// - A highlight is kept if the file intends one: a specular colour above 1%, an exponent, and an illumination model that
///   shows it. Roughness = (2/(n + 2))^¼ gives GGX the lobe of exponent n. A specular map multiplies its reflectance.
/// - A specular colour over black is a metal of that colour.
/// - An opacity below one blends. With a model that refracts (illum 6 and 7) it transmits.
pub(super) fn convert(
    defined: &Defined,
    bundle: &SceneFiles,
    maps: &mut Maps,
    warnings: &mut Warnings,
) -> Material {
    let Defined { folder, phong } = defined;
    let of = |reference: &Reference, maps: &Maps| {
        let (name, _) = bundle.get(folder, &reference.file).ok()?;
        Layer::new(name, reference, maps)
    };
    let layer = |kind: Map, maps: &Maps| of(phong.map(kind)?, maps);
    let mut material = Material { name: phong.name.clone(), ..Material::default() };

    let color_map = if phong.map(Map::Diffuse).is_some() { Map::Diffuse } else { Map::Ambient };
    let (color, mask) = (layer(color_map, maps), layer(Map::Dissolve, maps));
    let stated = beside(phong.diffuse, phong.map(Map::Diffuse).is_some(), Vec3::ZERO).map(unit);
    let plain = if color.is_some() { Vec3::ONE } else { Vec3::splat(0.8) };
    let diffuse = stated.unwrap_or(plain);
    material.base_color_texture = compose::color(color.as_ref(), mask.as_ref(), maps, warnings);
    material.base_color = diffuse.extend(1.0);
    set_highlight(&mut material, phong, &layer, maps, warnings);
    set_opacity(&mut material, phong, maps);

    let glow = layer(Map::Emission, maps);
    if phong.map(Map::Emission).is_none() || glow.is_some() {
        let stated = beside(phong.emission, glow.is_some(), Vec3::ZERO).filter(|color| color.is_finite());
        let plain = if glow.is_some() { Vec3::ONE } else { Vec3::ZERO };
        material.emissive = stated.unwrap_or(plain).max(Vec3::ZERO);
        material.emissive_texture = compose::color(glow.as_ref(), None, maps, warnings);
    }
    let (normal, bump) = (layer(Map::Normal, maps), layer(Map::Bump, maps));
    if let (Some(normal), Some(bump)) = (&normal, &bump)
        && normal.name != bump.name
    {
        warnings.add(format!("texture {} is not shown: {} gives the normals", bump.name, normal.name));
    }
    let normals = match (normal, bump) {
        (Some(normal), _) => compose::normals(&normal, maps),
        (None, bump) => bump.and_then(|bump| compose::bumps(&bump, maps, warnings)),
    };
    if let Some((texture, scale)) = normals {
        (material.normal_texture, material.normal_scale) = (Some(texture), scale);
    }
    if let Some(ior) = phong.ior.filter(|ior| *ior > 1.0 && *ior < 10.0) {
        material.ior = ior;
    }
    material
}

/// A factor; `None` where it is zero beside a texture.
fn beside<T: PartialEq>(factor: Option<T>, has_texture: bool, zero: T) -> Option<T> {
    factor.filter(|factor| !(has_texture && *factor == zero))
}

fn unit(color: Vec3) -> Vec3 {
    if color.is_finite() { color.clamp(Vec3::ZERO, Vec3::ONE) } else { Vec3::ZERO }
}

fn factor(value: Option<f32>) -> Option<f32> {
    value.filter(|value| value.is_finite()).map(|value| value.clamp(0.0, 1.0))
}

/// Roughness and metallicity.
fn set_highlight(
    material: &mut Material,
    phong: &Phong,
    layer: &impl Fn(Map, &Maps) -> Option<Layer>,
    maps: &mut Maps,
    warnings: &mut Warnings,
) {
    let has = |kind| phong.map(kind).is_some();
    let channel = |kind, channel: u8, maps: &Maps| {
        let mut layer = layer(kind, maps)?;
        layer.reference.channel = layer.reference.channel.or(Some(channel));
        Some(layer)
    };
    let roughness = layer(Map::Roughness, maps)
        .or_else(|| channel(Map::Orm, b'g', maps))
        .or_else(|| channel(Map::Rma, b'r', maps));
    let metallic = layer(Map::Metallic, maps)
        .or_else(|| channel(Map::Orm, b'b', maps))
        .or_else(|| channel(Map::Rma, b'g', maps));
    let (exponents, specular_map) = (layer(Map::Exponent, maps), layer(Map::Specular, maps));

    let specular = beside(phong.specular, has(Map::Specular), Vec3::ZERO).map(unit);
    let specular = specular.unwrap_or(if specular_map.is_some() { Vec3::ONE } else { Vec3::ZERO });
    let exponent = beside(phong.exponent, has(Map::Exponent), 0.0).filter(|n| n.is_finite() && *n > 0.0);
    let exponent = exponent.or(exponents.as_ref().map(|_| LARGEST_EXPONENT));
    let shows_highlights = phong.illumination.is_none_or(|model| model >= 2);
    let exponent = exponent.filter(|_| shows_highlights && specular.max_element() > 0.01);
    if let Some(n) = exponent {
        material.roughness = roughness_of(n);
        if material.base_color.truncate().max_element() < 0.01 && material.base_color_texture.is_none() {
            material.metallic = 1.0;
            material.base_color = specular.extend(1.0);
            material.base_color_texture = compose::color(specular_map.as_ref(), None, maps, warnings);
        }
    }
    if specular_map.is_some() && material.metallic == 0.0 {
        material.specular_color_texture = compose::color(specular_map.as_ref(), None, maps, warnings);
    }
    let stated = beside(factor(phong.roughness), roughness.is_some(), 0.0);
    let by_map = roughness.is_some();
    if stated.is_some() || by_map {
        material.roughness = stated.unwrap_or(1.0);
    }
    // A lost map leaves its surface without metal.
    let lost = metallic.is_none() && [Map::Metallic, Map::Orm, Map::Rma].into_iter().any(has);
    let stated = beside(factor(phong.metallic), metallic.is_some(), 0.0);
    if metallic.is_some() || stated.is_some() {
        material.metallic = if lost { 0.0 } else { stated.unwrap_or(1.0) };
    }
    // The exponent's maps count where no statement gives the roughness itself.
    let of_highlight = exponent.filter(|_| !by_map && phong.roughness.is_none());
    let exponent = exponents.filter(|_| of_highlight.is_some());
    let of = GlossMaps { roughness, metallic, exponent };
    let mapped = compose::gloss(&of, of_highlight, maps, warnings);
    if mapped.is_some() && of_highlight.is_some() {
        material.roughness = 1.0;
    }
    material.metallic_roughness_texture = mapped;
}

/// Opacity, by factor and by the alpha of the base colour's texture.
///
/// `d` is opacity. `Tr` is its complement, but some programs write it as opacity: where it alone says that nothing is seen,
/// it is the latter.
fn set_opacity(material: &mut Material, phong: &Phong, maps: &mut Maps) {
    let transparency = factor(phong.transparency).filter(|t| *t < 1.0);
    let stated = factor(phong.dissolve).or(transparency.map(|t| 1.0 - t));
    let opacity = beside(stated, phong.map(Map::Dissolve).is_some(), 0.0).unwrap_or(1.0);
    let texture = material.base_color_texture.map_or(AlphaMode::Opaque, |r| maps.alpha(r.texture));
    if opacity >= OPAQUE {
        material.alpha = texture;
    } else if matches!(phong.illumination, Some(6 | 7)) {
        material.transmission = 1.0 - opacity;
        material.alpha = texture;
        if let Some(filter) = phong.filter.map(unit).filter(|filter| *filter != Vec3::ZERO) {
            material.base_color = filter.extend(1.0);
        }
    } else {
        material.alpha = AlphaMode::Blend;
        material.base_color.w = opacity;
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use bytes::Bytes;

    use super::*;
    use crate::load::paths::InMemory;

    /// The material of a library without images.
    fn only(text: &str) -> Material {
        let phong = super::super::mtl::parse(text.as_bytes()).pop().unwrap();
        let files = BTreeMap::from([("a.obj".to_owned(), Bytes::from_static(b"v 0 0 0"))]);
        let bundle = SceneFiles::collect(&InMemory(&files), "a.obj").unwrap();
        let mut warnings = Warnings::default();
        let defined = Defined { folder: String::new(), phong };
        let mut maps = decode(&[&defined], &bundle, &mut warnings);
        convert(&defined, &bundle, &mut maps, &mut warnings)
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
    fn emitters_and_bad_numbers_are_recognised() {
        assert_eq!(only("newmtl a\nKe 10 10 10").emissive, Vec3::splat(10.0));
        assert_eq!(only("newmtl a\nKd 0.5").base_color, Vec3::splat(0.5).extend(1.0));
        assert_eq!(only("newmtl a\nNi 1.33").ior, 1.33);
        assert_eq!(only("newmtl a\nKd nan 0 0\nKe inf 0 0").emissive, Vec3::ZERO);
    }

    #[test]
    fn opacity_is_read_by_both_conventions() {
        for (text, alpha) in [
            ("d 0.3\nTr 0.9", 0.3),
            ("Tr 0.9", 0.1),
            ("Tr 0", 1.0),
            ("Tr 1", 1.0),
            ("d 1\nTr 1", 1.0),
            ("d 0.9999", 1.0),
            ("d 0", 0.0),
            ("d 0\nmap_d lost.png", 1.0),
            ("d -halo 0.5", 0.5),
            ("d 0.5\nillum 9", 0.5),
        ] {
            let material = only(&format!("newmtl a\n{text}"));
            assert!((material.base_color.w - alpha).abs() < 1e-6, "{text}: {}", material.base_color.w);
            let blends = material.alpha == AlphaMode::Blend;
            assert!(blends == (alpha < 1.0) && material.transmission == 0.0, "{text}");
        }
        let glass = only("newmtl a\nKd 0 0 0\nd 0.25\nTf .5 1 1\nillum 7");
        assert_eq!((glass.transmission, glass.alpha), (0.75, AlphaMode::Opaque));
        assert_eq!(glass.base_color.truncate(), Vec3::new(0.5, 1.0, 1.0));
    }
}
