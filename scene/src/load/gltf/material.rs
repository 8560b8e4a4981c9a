//! Reads materials, their extensions, and their textures.

use glam::{Vec2, Vec3, Vec4};
use gltf::json;
use json::material::AlphaMode as JsonAlphaMode;
use json::texture::WrappingMode;
use json::validation::Checked;

use super::accessor::Reader;
use super::{fetch, name};
use crate::load::Warnings;
use crate::load::bundle::Bundle;
use crate::load::images::{Textures, Wanted};
use crate::material::{Filter, Wrap};
use crate::{AlphaMode, Material, TextureRef};

/// Reads all materials of the document in its order, and the textures they use.
pub(super) fn read(reader: &Reader, bundle: &Bundle, warnings: &mut Warnings) -> (Vec<Material>, Textures) {
    let mut slots = Slots {
        reader,
        bundle,
        textures: Textures::default(),
        images: vec![None; reader.root.images.len()],
        warnings,
    };
    let materials = reader.root.materials.iter().map(|material| slots.material(material)).collect();
    (materials, slots.textures)
}

/// The set of texture coordinates that a material uses; 0 if there is no such material.
pub(super) fn uv_set(root: &json::Root, material: Option<json::Index<json::Material>>) -> u32 {
    material.and_then(|index| root.materials.get(index.value())).map_or(0, set_of_first)
}

/// The set that a material's first texture uses.
fn set_of_first(material: &json::Material) -> u32 {
    let glossiness = material.extensions.as_ref().and_then(|e| e.pbr_specular_glossiness.as_ref());
    let pbr = &material.pbr_metallic_roughness;
    let infos = [
        glossiness.and_then(|g| g.diffuse_texture.as_ref()),
        pbr.base_color_texture.as_ref(),
        pbr.metallic_roughness_texture.as_ref(),
        material.emissive_texture.as_ref(),
    ];
    let normal = material.normal_texture.as_ref().map(|normal| normal.tex_coord);
    infos.into_iter().flatten().map(set_of).next().or(normal).unwrap_or(0)
}

fn set_of(info: &json::texture::Info) -> u32 {
    let transform = info.extensions.as_ref().and_then(|e| e.texture_transform.as_ref());
    transform.and_then(|transform| transform.tex_coord).unwrap_or(info.tex_coord)
}

struct Slots<'a, 'w> {
    reader: &'a Reader<'a>,
    bundle: &'a Bundle,
    textures: Textures,
    /// For each image of the document, its number among the textures' images once it is used.
    images: Vec<Option<Result<usize, ()>>>,
    warnings: &'w mut Warnings,
}

impl Slots<'_, '_> {
    fn material(&mut self, json: &json::Material) -> Material {
        let pbr = &json.pbr_metallic_roughness;
        let set = set_of_first(json);
        let mut material = Material {
            name: name(&json.name),
            base_color: Vec4::from(pbr.base_color_factor.0),
            base_color_texture: self.info(&pbr.base_color_texture, true, set),
            metallic: pbr.metallic_factor.0,
            roughness: pbr.roughness_factor.0,
            metallic_roughness_texture: self.info(&pbr.metallic_roughness_texture, false, set),
            emissive: Vec3::from(json.emissive_factor.0),
            emissive_texture: self.info(&json.emissive_texture, true, set),
            double_sided: json.double_sided,
            ..Material::default()
        };
        if let Some(normal) = &json.normal_texture {
            let reference = self.texture(normal.index, false);
            if normal.tex_coord == set {
                material.normal_texture = reference;
                material.normal_scale = normal.scale;
            } else {
                self.other_set();
            }
        }
        if json.occlusion_texture.is_some() {
            let name = &material.name;
            self.warnings
                .add(format!("material {name:?}: occlusion textures are not supported: shown without"));
        }
        let cutoff = json.alpha_cutoff.map_or(0.5, |cutoff| cutoff.0);
        material.alpha = match json.alpha_mode {
            Checked::Valid(JsonAlphaMode::Mask) => AlphaMode::Mask(cutoff),
            Checked::Valid(JsonAlphaMode::Blend) => AlphaMode::Blend,
            _ => AlphaMode::Opaque,
        };
        self.extensions(json, &mut material, set);
        sanitise(&mut material);
        material
    }

    fn extensions(&mut self, json: &json::Material, material: &mut Material, set: u32) {
        let Some(extensions) = &json.extensions else { return };
        if let Some(glossy) = &extensions.pbr_specular_glossiness {
            self.warnings
                .add(format!("material {:?}: specular-glossiness is shown as a dielectric", material.name));
            material.base_color = Vec4::from(glossy.diffuse_factor.0);
            material.base_color_texture = self.info(&glossy.diffuse_texture, true, set);
            material.metallic = 0.0;
            material.roughness = 1.0 - glossy.glossiness_factor.0;
            material.metallic_roughness_texture = None;
        }
        if let Some(strength) = &extensions.emissive_strength {
            material.emissive *= strength.emissive_strength.0;
        }
        if let Some(ior) = &extensions.ior {
            material.ior = ior.ior.0;
        }
        if let Some(transmission) = &extensions.transmission {
            material.transmission = transmission.transmission_factor.0;
        }
        if extensions.unlit.is_some() {
            material.unlit = true;
            (material.emissive, material.emissive_texture) = (Vec3::ZERO, None);
            (material.metallic, material.roughness, material.transmission) = (0.0, 1.0, 0.0);
            (material.metallic_roughness_texture, material.normal_texture) = (None, None);
        }
    }

    fn info(&mut self, info: &Option<json::texture::Info>, srgb: bool, set: u32) -> Option<TextureRef> {
        let info = info.as_ref()?;
        if set_of(info) != set {
            self.other_set();
            return None;
        }
        let reference = self.texture(info.index, srgb)?;
        let transform = info.extensions.as_ref().and_then(|e| e.texture_transform.as_ref());
        let placed = transform.map_or(reference, |t| TextureRef {
            offset: Vec2::from(t.offset.0),
            scale: Vec2::from(t.scale.0),
            rotation: t.rotation.0,
            ..reference
        });
        let finite = placed.offset.is_finite() && placed.scale.is_finite() && placed.rotation.is_finite();
        finite.then_some(placed)
    }

    fn other_set(&mut self) {
        self.warnings
            .add("a material with textures on several sets of coordinates: only the first set is shown");
    }

    fn texture(&mut self, index: json::Index<json::Texture>, srgb: bool) -> Option<TextureRef> {
        let root = self.reader.root;
        let Some(texture) = root.textures.get(index.value()) else {
            self.warnings.add(format!("texture {} does not exist: left out", index.value()));
            return None;
        };
        let image = self.image(texture.source.value())?;
        let sampler = texture.sampler.and_then(|sampler| root.samplers.get(sampler.value()));
        let wrap = sampler.map_or([Wrap::Repeat; 2], |s| [wrap(s.wrap_s), wrap(s.wrap_t)]);
        Some(TextureRef::new(self.textures.texture(Wanted { image, srgb, wrap, filter: Filter::Linear })))
    }

    fn image(&mut self, index: usize) -> Option<usize> {
        let Some(known) = self.images.get(index).copied() else {
            self.warnings.add("a texture without an image that can be read: left out");
            return None;
        };
        let result = known.unwrap_or_else(|| {
            let image = &self.reader.root.images[index];
            let (label, bytes) = match (&image.uri, image.buffer_view) {
                (Some(uri), _) if uri.starts_with("data:") => (None, fetch(self.bundle, uri)),
                (Some(uri), _) => (Some(uri.clone()), fetch(self.bundle, uri)),
                (None, Some(view)) => (None, self.reader.view(view).map(|(bytes, _)| bytes)),
                (None, None) => (None, Err("it has neither a URI nor a buffer view".to_owned())),
            };
            let label = image.name.clone().or(label).unwrap_or_else(|| format!("image {index}"));
            match bytes {
                Ok(bytes) => Ok(self.textures.add_image(label, bytes)),
                Err(reason) => {
                    self.warnings.add(format!("texture {label}: {reason}: left out"));
                    Err(())
                }
            }
        });
        self.images[index] = Some(result);
        result.ok()
    }
}

fn wrap(mode: Checked<WrappingMode>) -> Wrap {
    match mode {
        Checked::Valid(WrappingMode::ClampToEdge) => Wrap::Clamp,
        Checked::Valid(WrappingMode::MirroredRepeat) => Wrap::Mirror,
        _ => Wrap::Repeat,
    }
}

/// Clamps factors to the ranges that shading supports.
fn sanitise(material: &mut Material) {
    let unit = |x: f32, default: f32| if x.is_finite() { x.clamp(0.0, 1.0) } else { default };
    material.metallic = unit(material.metallic, 0.0);
    material.roughness = unit(material.roughness, 1.0);
    material.transmission = unit(material.transmission, 0.0);
    if !material.base_color.is_finite() {
        material.base_color = Vec4::ONE;
    }
    material.base_color = material.base_color.clamp(Vec4::ZERO, Vec4::ONE);
    material.emissive =
        if material.emissive.is_finite() { material.emissive.max(Vec3::ZERO) } else { Vec3::ZERO };
    // Zero stands for an infinite index: full reflection in KHR_materials_ior.
    material.ior = match material.ior {
        0.0 => 1e3,
        ior if ior >= 1.0 && ior.is_finite() => ior,
        _ => 1.5,
    };
    if !material.normal_scale.is_finite() {
        material.normal_scale = 1.0;
    }
    if let AlphaMode::Mask(cutoff) = material.alpha {
        material.alpha = AlphaMode::Mask(if cutoff.is_finite() { cutoff } else { 0.5 });
    }
}
