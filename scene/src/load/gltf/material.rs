//! Reads materials, their extensions, and their textures.

use std::collections::BTreeSet;

use glam::{Vec2, Vec3, Vec4};
use gltf::json;
use json::texture::{MagFilter, WrappingMode};
use json::validation::Checked;

use super::accessor::Reader;
use super::lookup::fetch;
use super::object::Object;
use crate::load::images::{Channels, Textures, Wanted, label, named};
use crate::load::parts::Warnings;
use crate::load::scene_files::SceneFiles;
use crate::material::{Filter, TextureUse, Wrap};
use crate::shading::dielectric_f0;
use crate::{AlphaMode, Material, TextureRef};

/// The materials of a document in its order, with what their textures need.
pub(super) struct Materials {
    pub(super) all: Vec<Material>,
    /// The sets of texture coordinates (`TEXCOORD_n`) that become a mesh's first and second for each material.
    pub(super) sets: Vec<[Option<u32>; 2]>,
    pub(super) textures: Textures,
}

/// Reads the materials that are `used`; the rest keep their place and are plain.
pub(super) fn read(
    reader: &Reader,
    bundle: &SceneFiles,
    used: &[bool],
    warnings: &mut Warnings,
) -> Materials {
    let mut slots = Slots {
        reader,
        bundle,
        textures: Textures::default(),
        images: vec![None; reader.root.images.len()],
        lacks: Vec::new(),
    };
    let none = Object::new(None);
    let (mut all, mut sets) = (Vec::new(), Vec::new());
    for (index, used) in used.iter().enumerate() {
        let json = if *used { Object::new(reader.document.materials.get(index)) } else { none };
        let (material, of_material) = slots.material(json, index);
        all.push(material);
        sets.push(of_material);
    }
    for (what, labels) in &slots.lacks {
        warnings.add(format!("{} shown {what}", named(labels)));
    }
    Materials { all, sets, textures: slots.textures }
}

/// A texture of a material as the file has it.
struct Use<'a> {
    of: TextureUse,
    info: Object<'a>,
    channels: Channels,
}

impl<'a> Use<'a> {
    fn new(of: TextureUse, info: Object<'a>) -> Self {
        Self { of, info, channels: Channels::Same }
    }

    /// `TEXCOORD_n` that it reads.
    fn set(&self) -> u32 {
        let own = self.info.index("texCoord").unwrap_or(0);
        let set = self.info.extension("KHR_texture_transform").index("texCoord").unwrap_or(own);
        u32::try_from(set).unwrap_or(u32::MAX)
    }
}

struct Slots<'a> {
    reader: &'a Reader<'a>,
    bundle: &'a SceneFiles,
    textures: Textures,
    /// For each image of the document, its number among the textures' images once it is used.
    images: Vec<Option<usize>>,
    /// What pictures of materials lack, and the labels of those materials.
    lacks: Vec<(&'static str, Vec<String>)>,
}

impl<'a> Slots<'a> {
    fn material(&mut self, json: Object<'a>, index: usize) -> (Material, [Option<u32>; 2]) {
        let mut material = Material {
            name: json.text("name").to_owned(),
            emissive: Vec3::from(json.numbers("emissiveFactor", [0.0; 3])),
            double_sided: json.is_true("doubleSided"),
            ..Material::default()
        };
        let glossy = json.extension("KHR_materials_pbrSpecularGlossiness");
        let mut uses = match glossy.exists() {
            true => specular_glossiness(glossy, &mut material),
            false => metallic_roughness(json, &mut material),
        };
        material.normal_scale = json.get("normalTexture").number("scale", 1.0);
        uses.push(Use::new(TextureUse::Normal, json.get("normalTexture")));
        uses.push(Use::new(TextureUse::Emissive, json.get("emissiveTexture")));
        uses.extend(extensions(json, glossy.exists(), &mut material));
        if json.extension("KHR_materials_unlit").exists() {
            uses.retain(|texture| texture.of == TextureUse::BaseColor);
            unlit(&mut material);
        } else {
            lacks(json).for_each(|what| self.lack(what, index, &material));
        }
        match json.text("alphaMode") {
            "MASK" => material.alpha = AlphaMode::Mask(json.number("alphaCutoff", 0.5)),
            "BLEND" => material.alpha = AlphaMode::Blend,
            _ => (),
        }
        uses.retain(|texture| texture.info.exists());
        let sets = self.place(&uses, &mut material, index);
        sanitise(&mut material);
        let tinted = material.specular != 1.0 || material.specular_color != Vec3::ONE;
        if material.transmission > 0.0 && tinted {
            // Refraction reads the index of refraction from F0.
            (material.specular, material.specular_color) = (1.0, Vec3::ONE);
            (material.specular_texture, material.specular_color_texture) = (None, None);
            self.lack("with the reflection of plain glass, not with its specular factors", index, &material);
        }
        (material, sets)
    }

    fn lack(&mut self, what: &'static str, index: usize, material: &Material) {
        let label = label(index, material);
        match self.lacks.iter_mut().find(|(known, _)| *known == what) {
            Some((_, labels)) => labels.push(label),
            None => self.lacks.push((what, vec![label])),
        }
    }

    /// Gives a material its textures. Returns the sets of texture coordinates that they read, two at most.
    fn place(&mut self, uses: &[Use], material: &mut Material, index: usize) -> [Option<u32>; 2] {
        let read: BTreeSet<u32> = uses.iter().map(Use::set).collect();
        let mut sets = read.iter().copied();
        let sets = [sets.next(), sets.next()];
        for texture in uses {
            let set = sets.iter().position(|set| *set == Some(texture.set()));
            let reference = set.and_then(|set| self.reference(texture, set as u8));
            *material.texture_mut(texture.of) = reference;
            if reference.is_none() {
                material.lose(texture.of);
                let what = match set {
                    Some(_) => "without a texture whose transform is not finite",
                    None => "without the textures of a third set of coordinates: two are supported",
                };
                self.lack(what, index, material);
            }
        }
        sets
    }

    /// A texture by the first or second set of texture coordinates; `None` if its transform is not finite.
    fn reference(&mut self, texture: &Use, uv_set: u8) -> Option<TextureRef> {
        let Use { of, info, channels } = *texture;
        let srgb = matches!(of, TextureUse::BaseColor | TextureUse::Emissive | TextureUse::SpecularColor);
        let transform = info.extension("KHR_texture_transform");
        let placed = TextureRef {
            texture: self.texture(info.index("index").unwrap_or(usize::MAX), srgb, channels),
            offset: Vec2::from(transform.numbers("offset", [0.0; 2])),
            scale: Vec2::from(transform.numbers("scale", [1.0; 2])),
            rotation: transform.number("rotation", 0.0),
            uv_set,
        };
        let finite = placed.offset.is_finite() && placed.scale.is_finite() && placed.rotation.is_finite();
        finite.then_some(placed)
    }

    fn texture(&mut self, index: usize, srgb: bool, channels: Channels) -> u32 {
        let root = self.reader.root;
        let texture = root.textures.get(index);
        let image = match texture {
            Some(texture) => self.image(texture.source.value()),
            None => self.textures.add_lost_image(format!("{index}"), "does not exist".to_owned()),
        };
        let sampler = texture.and_then(|texture| root.samplers.get(texture.sampler?.value()));
        let wrap = sampler.map_or([Wrap::Repeat; 2], |s| [wrap(s.wrap_s), wrap(s.wrap_t)]);
        let nearest = sampler.is_some_and(|s| s.mag_filter == Some(Checked::Valid(MagFilter::Nearest)));
        let filter = if nearest { Filter::Nearest } else { Filter::Linear };
        self.textures.texture(Wanted { image, srgb, wrap, filter, channels })
    }

    fn image(&mut self, index: usize) -> usize {
        let Some(known) = self.images.get(index).copied() else {
            return self
                .textures
                .add_lost_image(format!("{index}"), "has no image that can be read".to_owned());
        };
        known.unwrap_or_else(|| {
            let image = &self.reader.root.images[index];
            let (label, bytes) = match (&image.uri, image.buffer_view) {
                (Some(uri), _) if uri.starts_with("data:") => (None, fetch(self.bundle, uri)),
                (Some(uri), _) => (Some(uri.clone()), fetch(self.bundle, uri)),
                (None, Some(view)) => (None, self.reader.view(view).map(|(bytes, _)| bytes)),
                (None, None) => (None, Err("it has neither a URI nor a buffer view".to_owned())),
            };
            let label = image.name.clone().or(label).unwrap_or_else(|| format!("image {index}"));
            let added = match bytes {
                Ok(bytes) => self.textures.add_image(label, bytes),
                Err(reason) => self.textures.add_lost_image(label, reason),
            };
            self.images[index] = Some(added);
            added
        })
    }
}

fn metallic_roughness<'a>(json: Object<'a>, material: &mut Material) -> Vec<Use<'a>> {
    let pbr = json.get("pbrMetallicRoughness");
    material.base_color = Vec4::from(pbr.numbers("baseColorFactor", [1.0; 4]));
    material.metallic = pbr.number("metallicFactor", 1.0);
    material.roughness = pbr.number("roughnessFactor", 1.0);
    vec![
        Use::new(TextureUse::BaseColor, pbr.get("baseColorTexture")),
        Use::new(TextureUse::MetallicRoughness, pbr.get("metallicRoughnessTexture")),
    ]
}

/// KHR_materials_pbrSpecularGlossiness: a dielectric whose F0 is the specular colour. Its diffuse colour is weakened by a
/// specular colour that has no texture.
fn specular_glossiness<'a>(glossy: Object<'a>, material: &mut Material) -> Vec<Use<'a>> {
    let specular = Vec3::from(glossy.numbers("specularFactor", [1.0; 3]));
    let gloss = glossy.number("glossinessFactor", 1.0).clamp(0.0, 1.0);
    let texture = glossy.get("specularGlossinessTexture");
    let [r, g, b, a] = glossy.numbers("diffuseFactor", [1.0; 4]);
    let left = if texture.exists() { 1.0 } else { 1.0 - specular.max_element().clamp(0.0, 1.0) };
    material.base_color = (Vec3::new(r, g, b) * left).extend(a);
    material.metallic = 0.0;
    material.specular_color = specular / dielectric_f0(material.ior);
    material.roughness = if texture.exists() { 1.0 } else { 1.0 - gloss };
    let channels = Channels::RoughnessOfGloss((gloss * 255.0 + 0.5) as u8);
    vec![
        Use::new(TextureUse::BaseColor, glossy.get("diffuseTexture")),
        Use::new(TextureUse::SpecularColor, texture),
        Use { channels, ..Use::new(TextureUse::MetallicRoughness, texture) },
    ]
}

/// Reads the extensions that are shown, and returns their textures.
fn extensions<'a>(json: Object<'a>, glossy: bool, material: &mut Material) -> Vec<Use<'a>> {
    let strength = json.extension("KHR_materials_emissive_strength");
    material.emissive *= strength.number("emissiveStrength", 1.0);
    let transmission = json.extension("KHR_materials_transmission");
    material.transmission = transmission.number("transmissionFactor", 0.0);
    let mut uses = vec![Use::new(TextureUse::Transmission, transmission.get("transmissionTexture"))];
    if !glossy {
        material.ior = json.extension("KHR_materials_ior").number("ior", 1.5);
        let specular = json.extension("KHR_materials_specular");
        material.specular = specular.number("specularFactor", 1.0);
        material.specular_color = Vec3::from(specular.numbers("specularColorFactor", [1.0; 3]));
        uses.push(Use::new(TextureUse::Specular, specular.get("specularTexture")));
        uses.push(Use::new(TextureUse::SpecularColor, specular.get("specularColorTexture")));
    }
    uses
}

/// KHR_materials_unlit: a surface that shows its colour and reflects nothing.
fn unlit(material: &mut Material) {
    material.unlit = true;
    material.emissive = Vec3::ZERO;
    (material.metallic, material.roughness, material.transmission) = (0.0, 1.0, 0.0);
}

/// How a material is shown because of extensions that it uses, and that are not shown.
fn lacks(json: Object<'_>) -> impl Iterator<Item = &'static str> {
    let factor = |name: &str, key: &str| json.extension(name).number(key, 0.0) != 0.0;
    let sheen = json.extension("KHR_materials_sheen").numbers("sheenColorFactor", [0.0; 3]);
    let is_glass = factor("KHR_materials_transmission", "transmissionFactor")
        || factor("KHR_materials_diffuse_transmission", "diffuseTransmissionFactor");
    let has_volume = is_glass && factor("KHR_materials_volume", "thicknessFactor");
    [
        (
            factor("KHR_materials_clearcoat", "clearcoatFactor"),
            "without its clear coat: the second, sharp highlight of varnish is missing",
        ),
        (sheen != [0.0; 3], "without its sheen: the soft shine of cloth at its edges is missing"),
        (has_volume, "without its volume: thick parts do not tint or bend light more than thin ones"),
        (
            factor("KHR_materials_anisotropy", "anisotropyStrength"),
            "without its anisotropy: highlights are round, not stretched as on brushed metal",
        ),
        (
            factor("KHR_materials_iridescence", "iridescenceFactor"),
            "without its iridescence: colours do not change with the angle",
        ),
        (
            has_volume && factor("KHR_materials_dispersion", "dispersion"),
            "without its dispersion: light is not split into colours",
        ),
        (
            factor("KHR_materials_diffuse_transmission", "diffuseTransmissionFactor"),
            "without its diffuse transmission: light from behind does not shine through",
        ),
    ]
    .into_iter()
    .filter_map(|(lacks, what)| lacks.then_some(what))
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
    let color = |c: Vec3, default: Vec3| if c.is_finite() { c.max(Vec3::ZERO) } else { default };
    material.metallic = unit(material.metallic, 0.0);
    material.roughness = unit(material.roughness, 1.0);
    material.transmission = unit(material.transmission, 0.0);
    material.specular = unit(material.specular, 1.0);
    material.specular_color = color(material.specular_color, Vec3::ONE);
    if !material.base_color.is_finite() {
        material.base_color = Vec4::ONE;
    }
    material.base_color = material.base_color.clamp(Vec4::ZERO, Vec4::ONE);
    material.emissive = color(material.emissive, Vec3::ZERO);
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
