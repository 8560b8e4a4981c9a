//! Writes a loaded scene for Mitsuba 3, which judges Argus' light from outside.
//!
//! Geometry, textures, materials, lights and sky come from the [`Scene`] as Argus loaded or generated it, so that only light
//! is judged, not a loader. [`write()`] makes a folder with `scene.xml`, a PLY file for each instance, and linear bitmaps. What
//! Mitsuba cannot express is returned as [`Exported::differences`]; `docs/mitsuba.md` explains them.
//!
//! - A matt material is `diffuse` with the base colour as its reflectance. A glossy one ([`crate::Material::is_glossy`]) is
//!   `principled`: the same GGX lobe, but with Burley's diffuse lobe and with Fresnel's equations for dielectrics.
//! - A double-sided material is `twosided`. A single-sided one is black from behind, where Argus sees through it.
//! - A cut-out is `mask` over a bitmap of zeros and ones.
//! - An emitting material is an `area` emitter on its front. A double-sided one gets a second, reversed layer of triangles a
//!   hundred-thousandth of its coordinates behind the first, since Mitsuba's emitters shine to one side.
//! - Transmission is left out: Argus keeps the diffuse lobe of such materials.

mod bitmaps;
mod lights;
mod materials;
mod matt;
mod ply;
mod xml;

use std::collections::BTreeMap;
use std::fs;
use std::io;
use std::path::Path;

use glam::{DVec3, Vec3, Vec4};
use serde::Serialize;

use self::bitmaps::Bitmaps;
pub use self::lights::SkyLight;
use self::lights::{Space, write_area, write_light, write_sky};
use self::materials::{Colors, Look};
pub use self::matt::matt;
use self::ply::Triangles;
use self::xml::Xml;
use crate::shading::dielectric_f0;
use crate::{Bounds, Camera, Instance, Material, Mesh, Pose, Scene};

/// Coordinates beyond which a scene is moved to the eye, since Mitsuba computes with 32-bit floats; metres.
const FAR_FROM_ZERO: f64 = 1e4;
/// Distance between the two layers of a double-sided emitter, as a share of its coordinates.
const LAYER: f32 = 1e-5;

/// A view to export.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// A camera that passed [`Camera::validate`].
    pub camera: Camera,
    /// Width and height in pixels.
    pub size: [u32; 2],
    /// Time of the scene, seconds.
    pub time_secs: f64,
    /// Radiance of the sky.
    pub sky: SkyLight,
}

/// What was written.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize)]
pub struct Exported {
    /// PLY files.
    pub shapes: usize,
    /// Triangles in all of them.
    pub triangles: usize,
    /// BSDFs.
    pub materials: usize,
    /// Bitmaps of materials.
    pub bitmaps: usize,
    /// Lights, emitting shapes, and the sky unless it is black.
    pub emitters: usize,
    /// What Mitsuba shows otherwise, one line each.
    pub differences: Vec<String>,
}

/// Writes `scene.xml` and its files into a folder, which is made if it is missing.
///
/// The XML has two parameters: `spp` (samples a pixel) and `depth` (Mitsuba's `max_depth`; −1 for no limit).
///
/// # Errors
/// A file cannot be written, or a material names a texture that the scene lacks.
pub fn write(scene: &Scene, settings: &Settings, folder: &Path) -> io::Result<Exported> {
    fs::create_dir_all(folder)?;
    let reshaped = scene.reshaped(settings.time_secs);
    let scene = reshaped.as_ref().unwrap_or(scene);
    let pose = scene.at(settings.time_secs);
    let space = space(scene, &settings.camera);
    let mut bitmaps = Bitmaps::new(scene, folder);
    let mut exported = Exported::default();
    let mut xml = Xml::new();
    xml.open("scene", &[("version", "3.0.0")]);
    write_view(&mut xml, settings, space);
    let placed = place(scene, &pose, &mut bitmaps);
    exported.materials = write_materials(&mut xml, scene, &placed, &mut bitmaps)?;
    for part in &placed {
        write_part(&mut xml, scene, part, space, folder, &mut bitmaps, &mut exported)?;
    }
    for (index, light) in pose.lighting.lights.iter().enumerate() {
        bitmaps.differences.extend(write_light(&mut xml, light, index, space, folder)?);
        exported.emitters += 1;
    }
    let sky = &pose.lighting.sky;
    if sky.reach.is_some() {
        let text =
            "the light of interiors is blocked by what is near; Mitsuba blocks it whatever the distance";
        bitmaps.differences.insert(text.to_owned());
    }
    write_sky(&mut xml, sky, settings.sky, folder)?;
    exported.emitters += usize::from([sky.zenith, sky.horizon, sky.ground] != [Vec3::ZERO; 3]);
    exported.bitmaps = bitmaps.written.len();
    exported.differences = bitmaps.differences.into_iter().collect();
    fs::write(folder.join("scene.xml"), xml.finish())?;
    Ok(exported)
}

/// Triangles of an instance with one look.
struct Part {
    instance: Instance,
    /// Index of the instance in the scene.
    index: usize,
    look: Look,
}

/// The scene's middle and size, and the exported zero.
fn space(scene: &Scene, camera: &Camera) -> Space {
    let bounds = scene.bounds();
    let bounds = if bounds.is_empty() { Bounds { min: camera.eye, max: camera.eye } } else { bounds };
    let far = bounds.max.abs().max(bounds.min.abs()).max(camera.eye.abs()).max_element() > FAR_FROM_ZERO;
    let reach = bounds.size().length().max((camera.eye - bounds.center()).length());
    Space {
        origin: if far { camera.eye } else { DVec3::ZERO },
        center: bounds.center(),
        diameter: reach.max(1e-3),
    }
}

/// Integrator and camera.
fn write_view(xml: &mut Xml, settings: &Settings, space: Space) {
    let Settings { camera, size: [width, height], .. } = settings;
    xml.leaf("default", &[("name", "spp"), ("value", "64")]);
    xml.leaf("default", &[("name", "depth"), ("value", "-1")]);
    xml.open("integrator", &[("type", "path")]);
    xml.value("integer", "max_depth", "$depth");
    xml.close();
    xml.open("sensor", &[("type", "perspective")]);
    xml.value("string", "fov_axis", "y");
    xml.value("float", "fov", &camera.fov_deg.to_string());
    xml.value("float", "near_clip", &(space.diameter * 1e-5).to_string());
    xml.value("float", "far_clip", &(space.diameter * 1e4).to_string());
    xml.open("transform", &[("name", "to_world")]);
    let (eye, target) = (camera.eye - space.origin, camera.target - space.origin);
    lights::look_at_element(xml, eye, target, camera.up);
    xml.close();
    xml.open("sampler", &[("type", "independent")]);
    xml.value("integer", "sample_count", "$spp");
    xml.close();
    xml.open("film", &[("type", "hdrfilm")]);
    xml.value("integer", "width", &width.to_string());
    xml.value("integer", "height", &height.to_string());
    xml.value("string", "pixel_format", "rgb");
    xml.value("string", "component_format", "float32");
    xml.leaf("rfilter", &[("type", "box")]);
    xml.close();
    xml.close();
}

/// The parts of all instances that can be seen.
fn place(scene: &Scene, pose: &Pose, bitmaps: &mut Bitmaps) -> Vec<Part> {
    let mut parts = Vec::new();
    for (index, instance) in pose.instances.iter().enumerate() {
        let mesh = &scene.meshes[instance.mesh as usize];
        let material = &scene.materials[mesh.material as usize];
        note_differences(material, mesh, bitmaps);
        let vanishes =
            material.base_color_texture.is_none() && material.coverage(material.base_color.w) == 0.0;
        if vanishes || instance.world_from_mesh.matrix3.determinant() == 0.0 {
            continue;
        }
        let colors = match (mesh.colors.is_empty(), material.base_color_texture) {
            (true, _) => Colors::None,
            (false, None) => Colors::Attribute,
            (false, Some(_)) => Colors::Mean(instance.mesh),
        };
        let bent = material.normal_texture.is_some() && !mesh.tangents.is_empty();
        for flipped in [false, true] {
            if !flipped || bent {
                let look = Look { material: mesh.material, flipped, colors };
                parts.push(Part { instance: *instance, index, look });
            }
        }
    }
    parts
}

/// Notes what the export of a material leaves out.
fn note_differences(material: &Material, mesh: &Mesh, bitmaps: &mut Bitmaps) {
    let mut note = |text: &str| {
        bitmaps.differences.insert(format!("material {:?}: {text}", material.name));
    };
    if material.unlit {
        note("it is unlit; Mitsuba lights its colour");
    }
    if !material.double_sided {
        note("seen from behind it is black and casts shadows; Argus culls it");
    }
    if material.passes_light() {
        note("it is invisible glass; Argus shows its surface, and lets light pass as well");
    } else if material.transmission > 0.0 {
        note("its transmission is left out");
    }
    if material.is_glossy() {
        if material.dielectric_f0() != Vec3::splat(dielectric_f0(material.ior)) {
            note("its specular factors are left out");
        }
        note("its diffuse lobe is Burley's, and its Fresnel term a dielectric's, not Schlick's");
    }
    if material.normal_texture.is_some() {
        note("its normal map follows the texture's derivatives, not the mesh's tangents");
    }
    if !mesh.colors.is_empty() && material.base_color_texture.is_some() {
        note("the mean of its vertex colours multiplies its texture");
    }
    if material.alpha_cutoff().is_some() && mesh.colors.iter().any(|color| color.w < 1.0) {
        note("alpha of vertex colours is left out");
    }
}

/// Writes each look's BSDF once, and returns their number.
fn write_materials(xml: &mut Xml, scene: &Scene, parts: &[Part], bitmaps: &mut Bitmaps) -> io::Result<usize> {
    let looks: BTreeMap<Look, ()> = parts.iter().map(|part| (part.look, ())).collect();
    for look in looks.keys() {
        let tint = match look.colors {
            Colors::Mean(mesh) => mean(&scene.meshes[mesh as usize].colors),
            Colors::None | Colors::Attribute => Vec3::ONE,
        };
        materials::write(xml, bitmaps, &scene.materials[look.material as usize], look, tint)?;
    }
    Ok(looks.len())
}

/// Mean of vertex colours.
fn mean(colors: &[Vec4]) -> Vec3 {
    colors.iter().sum::<Vec4>().truncate() / colors.len().max(1) as f32
}

/// Writes a part's triangles and the shape that names them; nothing if no triangle has the part's look.
fn write_part(
    xml: &mut Xml,
    scene: &Scene,
    part: &Part,
    space: Space,
    folder: &Path,
    bitmaps: &mut Bitmaps,
    exported: &mut Exported,
) -> io::Result<()> {
    let mesh = &scene.meshes[part.instance.mesh as usize];
    let material = &scene.materials[mesh.material as usize];
    let bent = material.normal_texture.is_some() && !mesh.tangents.is_empty();
    let chosen =
        |corners: &[u32; 3]| !bent || (mesh.tangents[corners[0] as usize].w < 0.0) == part.look.flipped;
    let mut triangles = Triangles::of(mesh, &part.instance, space.origin, chosen);
    if triangles.corners.is_empty() {
        return Ok(());
    }
    if part.look.colors == Colors::Attribute {
        let factor = material.base_color.truncate();
        triangles.colors.iter_mut().for_each(|color| *color *= factor);
    } else {
        triangles.colors.clear();
    }
    let name = format!("shape-{}{}", part.index, if part.look.flipped { "-flipped" } else { "" });
    let shines = material.emissive.max_element() > 0.0;
    let mut layers = vec![(name.clone(), triangles)];
    if shines && material.double_sided {
        let distance = LAYER * (1.0 + layers[0].1.reach());
        let back = layers[0].1.reversed(distance);
        layers.push((format!("{name}-back"), back));
    }
    for (name, layer) in layers {
        let file = format!("{name}.ply");
        layer.write(&folder.join(&file))?;
        xml.open("shape", &[("type", "ply"), ("id", &name)]);
        xml.value("string", "filename", &file);
        xml.leaf("ref", &[("name", "bsdf"), ("id", &part.look.id())]);
        if shines {
            write_emission(xml, material, bitmaps)?;
            exported.emitters += 1;
        }
        xml.close();
        exported.shapes += 1;
        exported.triangles += layer.corners.len();
    }
    Ok(())
}

/// Writes the emitter of a shape's front.
fn write_emission(xml: &mut Xml, material: &Material, bitmaps: &mut Bitmaps) -> io::Result<()> {
    let Some(texture) = material.emissive_texture else {
        write_area(xml, material.emissive);
        return Ok(());
    };
    xml.open("emitter", &[("type", "area")]);
    // Materials that differ in nothing else share the file.
    let [r, g, b] = material.emissive.to_array().map(f32::to_bits);
    let file = format!("emission-{}-{r:x}-{g:x}-{b:x}", texture.texture);
    bitmaps.radiance(xml, ["radiance", &file], texture, material.emissive)?;
    xml.close();
    Ok(())
}

#[cfg(test)]
mod tests;
