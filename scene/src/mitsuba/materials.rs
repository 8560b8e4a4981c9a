//! Materials as Mitsuba's BSDFs.

use std::io;

use glam::{Vec3, Vec4};

use super::bitmaps::Bitmaps;
use super::xml::{Xml, rgb};
use crate::{AlphaMode, Material};

/// A material as one mesh needs it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(super) struct Look {
    /// Index of the material.
    pub(super) material: u32,
    /// Whether the bitangent is reversed, so that the normal map's green points the other way.
    pub(super) flipped: bool,
    pub(super) colors: Colors,
}

/// The part of vertex colours in a material.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(super) enum Colors {
    /// The mesh has none.
    None,
    /// The mesh's attribute has the whole base colour, since there is no texture.
    Attribute,
    /// The mean colour of the mesh with this index multiplies the texture.
    Mean(u32),
}

impl Look {
    /// The name of the BSDF.
    pub(super) fn id(&self) -> String {
        let flipped = if self.flipped { "-flipped" } else { "" };
        let colors = match self.colors {
            Colors::None => String::new(),
            Colors::Attribute => "-colors".to_owned(),
            Colors::Mean(mesh) => format!("-mesh-{mesh}"),
        };
        format!("material-{}{flipped}{colors}", self.material)
    }
}

/// Writes the BSDF of a look; `tint` is the mean colour for [`Colors::Mean`], else white.
pub(super) fn write(
    xml: &mut Xml,
    bitmaps: &mut Bitmaps,
    material: &Material,
    look: &Look,
    tint: Vec3,
) -> io::Result<()> {
    let id = look.id();
    // The outermost BSDF has the name.
    let mut name = Some(id.as_str());
    let mut open = |xml: &mut Xml, kind: &str| match name.take() {
        Some(id) => xml.open("bsdf", &[("type", kind), ("id", id)]),
        None => xml.open("bsdf", &[("type", kind)]),
    };
    if material.passes_light() {
        open(xml, "null");
        xml.close();
        return Ok(());
    }
    let mut depth = 1;
    let (alpha, opacity) = (material.base_color.w, format!("{id}-opacity"));
    match (material.alpha, material.base_color_texture) {
        (AlphaMode::Mask(cutoff), Some(texture)) => {
            open(xml, "mask");
            bitmaps.cutout(xml, &opacity, texture, [alpha, cutoff])?;
            depth += 1;
        }
        (AlphaMode::Blend, Some(texture)) => {
            open(xml, "mask");
            let blend = Material { alpha: AlphaMode::Blend, ..Material::default() };
            bitmaps.number(xml, ["opacity", &opacity], texture, move |t| blend.coverage(t.w * alpha))?;
            depth += 1;
        }
        (AlphaMode::Blend, None) if material.coverage(alpha) < 1.0 => {
            open(xml, "mask");
            xml.value("float", "opacity", &alpha.to_string());
            depth += 1;
        }
        _ => (),
    }
    if material.double_sided {
        open(xml, "twosided");
        depth += 1;
    }
    if let Some(texture) = material.normal_texture {
        open(xml, "normalmap");
        // Argus bends normals without a correction.
        xml.value("boolean", "flip_invalid_normals", "false");
        xml.value("boolean", "use_shadowing_function", "false");
        let (scale, green) = (material.normal_scale, if look.flipped { -1.0 } else { 1.0 });
        let bend = move |texel: Vec4| {
            let normal = (texel.truncate() * 2.0 - 1.0) * Vec3::new(scale, scale * green, 1.0);
            (normal.normalize_or(Vec3::Z) * 0.5 + 0.5).extend(1.0)
        };
        bitmaps.vector(xml, ["normalmap", &format!("{id}-normal")], texture, bend)?;
        depth += 1;
    }
    if material.is_glossy() {
        open(xml, "principled");
        write_base_color(xml, bitmaps, material, look, ["base_color", &id], tint)?;
        write_gloss(xml, bitmaps, material, &id)?;
    } else {
        open(xml, "diffuse");
        write_base_color(xml, bitmaps, material, look, ["reflectance", &id], tint)?;
    }
    (0..depth).for_each(|_| xml.close());
    Ok(())
}

/// Writes the base colour. A matt material is never metallic ([`Material::is_glossy`]), so that it is the albedo, too.
fn write_base_color(
    xml: &mut Xml,
    bitmaps: &mut Bitmaps,
    material: &Material,
    look: &Look,
    [parameter, id]: [&str; 2],
    tint: Vec3,
) -> io::Result<()> {
    let factor = material.base_color.truncate() * tint;
    if look.colors == Colors::Attribute {
        xml.open("texture", &[("type", "mesh_attribute"), ("name", parameter)]);
        xml.value("string", "name", "vertex_color");
        xml.close();
        return Ok(());
    }
    match material.base_color_texture {
        Some(texture) => bitmaps.color(xml, [parameter, &format!("{id}-color")], texture, factor),
        None => {
            xml.value("rgb", parameter, &rgb(factor.clamp(Vec3::ZERO, Vec3::ONE)));
            Ok(())
        }
    }
}

/// Writes roughness, metallic and index of refraction of the principled BSDF.
fn write_gloss(xml: &mut Xml, bitmaps: &mut Bitmaps, material: &Material, id: &str) -> io::Result<()> {
    // Mitsuba refuses an index of refraction of 1 and below.
    xml.value("float", "eta", &material.ior.max(1.0001).to_string());
    let Some(texture) = material.metallic_roughness_texture else {
        xml.value("float", "roughness", &material.roughness.to_string());
        xml.value("float", "metallic", &material.metallic.to_string());
        return Ok(());
    };
    let (roughness, metallic) = (material.roughness, material.metallic);
    bitmaps.number(xml, ["roughness", &format!("{id}-roughness")], texture, move |t| t.y * roughness)?;
    bitmaps.number(xml, ["metallic", &format!("{id}-metallic")], texture, move |t| t.z * metallic)
}
