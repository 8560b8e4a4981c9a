//! Reflection and refraction of the scene in glossy and transparent objects. Each such object has a reflection probe: a
//! map of all directions around it (ManyLoDs, Holländer et al. 2011, section 5 and figure 3). Its pixels look the probe
//! up along their reflected and refracted directions. Probes are rendered from an octree of the scene, or filled with points
//! (Gavane and Watson, "Eye-Based Point Rendering for Dynamic Multiview Effects", 2022), or by rays. From the last two, direct
//! views need no probes: what their own pixels reflect is found and shaded.

mod cost;
mod eye;
mod lobe;

use std::fmt;

use glam::{DVec3, Vec3};
use serde::{Deserialize, Serialize};

pub use self::cost::ReflectionCost;
pub use self::eye::ProbeEye;
pub use self::lobe::{half_vector, refracted};
pub use crate::probe_map::{level_sides, map_size};
use crate::tone::linear_from_srgb;
use crate::{Bounds, Instance, InvalidField, Material, Rig, Scene, Texture, TextureRef};

/// Most reflections one after another on the way to an eye, as in figure 5 of Gavane and Watson.
pub const BOUNCES: u32 = 3;

/// Settings of the reflection probes, the same for all samples of a set.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Reflections {
    /// Texels on a side of a probe's finest level: a power of two, 16 to 256. More texels show finer detail; cost grows
    /// with the square of the side.
    pub side: u32,
    /// Largest number of probes of a scene, 1 to 1024. The largest reflectors have one; the rest reflect only the sky.
    pub most: u32,
    /// What probes are rendered from.
    pub source: ProbeSource,
}

/// What reflection probes are rendered from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum ProbeSource {
    /// An octree of the scene.
    Octree {
        /// Levels below the root: 1 to 10.
        levels: u32,
    },
    /// Points on the scene's triangles, as dense as viewers see them in reflections.
    Points {
        /// Most points that are made at once, 1024 to 2²⁷, of 8 bytes each. Where more are wanted, points are less dense.
        budget: u32,
    },
    /// A ray for each texel.
    Rays,
}

impl ProbeSource {
    /// Levels of an octree unless a user says otherwise: cells of 1/250 of the scene.
    pub const USUAL_LEVELS: u32 = 8;
    /// A budget of points unless a user says otherwise: 32 MiB.
    pub const USUAL_BUDGET: u32 = 1 << 22;
    /// The usual octree.
    pub const OCTREE: Self = Self::Octree { levels: Self::USUAL_LEVELS };
    /// Points with the usual budget.
    pub const POINTS: Self = Self::Points { budget: Self::USUAL_BUDGET };
    /// The name that users give it.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Octree { .. } => "maps",
            Self::Points { .. } => "points",
            Self::Rays => "rays",
        }
    }

    /// Whether direct views look probes up, as views from samples do. Otherwise they find what their own pixels reflect.
    pub fn serves_direct_views(&self) -> bool {
        matches!(self, Self::Octree { .. })
    }

    /// The bounds of a budget of points.
    const BUDGETS: std::ops::RangeInclusive<u32> = 1 << 10..=1 << 27;
}

/// Largest roughness of a reflector of metal or glass, as a mean over its texture. A rougher one reflects light and dark, but
/// no image.
const ROUGHEST: f32 = 0.6;
/// Largest roughness of other reflectors, which reflect a twentieth of the light that meets them head-on.
const ROUGHEST_DIELECTRIC: f32 = 0.3;

/// Most bytes of all probes of a scene. Every sampler renders them, and every compositor holds them.
const MOST_BYTES: u64 = 256 << 20;

impl Default for Reflections {
    /// Texels of three degrees, and cells of 1/250 of the scene.
    fn default() -> Self {
        Self::USUAL[0]
    }
}

impl fmt::Display for Reflections {
    /// All settings, short, as in a frame's provenance.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { side, most, source } = self;
        match source {
            ProbeSource::Octree { levels } => write!(f, "of {side} from {levels} levels, at most {most}"),
            ProbeSource::Points { budget } => write!(f, "of {side} from {budget} points, at most {most}"),
            ProbeSource::Rays => write!(f, "of {side} by rays, at most {most}"),
        }
    }
}

impl Reflections {
    /// The smallest side that a probe's finest level may have, texels.
    pub const LEAST_SIDE: u32 = 16;

    /// The usual settings, from each source.
    pub const USUAL: [Self; 3] = {
        let usual = Self { side: 64, most: 256, source: ProbeSource::OCTREE };
        [usual, Self { source: ProbeSource::POINTS, ..usual }, Self { source: ProbeSource::Rays, ..usual }]
    };

    /// Rejects settings that are out of range.
    ///
    /// # Errors
    /// `reflections` and the setting's name.
    pub fn validate(&self) -> Result<(), InvalidField> {
        if !(self.side.is_power_of_two() && (Self::LEAST_SIDE..=256).contains(&self.side)) {
            let reason = format!("must be 16, 32, 64, 128 or 256 texels, not {}", self.side);
            return Err(InvalidField::new("reflections.side", reason));
        }
        match self.source {
            ProbeSource::Octree { levels } => InvalidField::within("reflections.levels", levels, 1..=10)?,
            ProbeSource::Points { budget } => {
                InvalidField::within("reflections.points", budget, ProbeSource::BUDGETS)?
            }
            ProbeSource::Rays => 0,
        };
        InvalidField::within("reflections.most", self.most, 1..=1024).map(drop)
    }
}

/// The reflection probes of a scene: their settings and number.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ReflectionProbeSet {
    /// Settings of every probe.
    pub settings: Reflections,
    /// Number of probes, at least 1.
    pub count: u32,
    /// Viewers whose pixels set the density of points; `None` for probes without points, which do not depend on viewers.
    pub eye: Option<ProbeEye>,
}

impl ReflectionProbeSet {
    /// The probes of a scene that is sampled by a rig; `None` if it has no reflector.
    ///
    /// # Errors
    /// The setting that is out of range, or `reflections.side` if all probes together take too much memory.
    pub fn of(scene: &Scene, rig: &Rig, settings: Reflections) -> Result<Option<Self>, InvalidField> {
        settings.validate()?;
        let eye = match settings.source {
            ProbeSource::Octree { .. } | ProbeSource::Rays => None,
            ProbeSource::Points { .. } => ProbeEye::of(rig, &scene.extent()),
        };
        let maps = Self { settings, count: scene.reflectors(settings.most).len() as u32, eye };
        if maps.count == 0 {
            return Ok(None);
        }
        maps.validate()?;
        Ok(Some(maps))
    }

    /// Rejects values that [`ReflectionProbeSet::of`] never makes.
    ///
    /// # Errors
    /// The field, by name.
    pub fn validate(&self) -> Result<(), InvalidField> {
        self.settings.validate()?;
        match (self.settings.source, self.eye) {
            (ProbeSource::Points { .. }, None) => {
                return Err(InvalidField::new("reflections.viewpoints", "must be given for points"));
            }
            (ProbeSource::Octree { .. } | ProbeSource::Rays, Some(_)) => {
                let reason = "are of no use to probes without points";
                return Err(InvalidField::new("reflections.viewpoints", reason));
            }
            (_, eye) => eye.map_or(Ok(()), |eye| eye.validate())?,
        }
        InvalidField::within("reflections.count", self.count, 1..=self.settings.most)?;
        let bytes = self.bytes();
        if bytes > MOST_BYTES {
            let (mib, most) = (bytes >> 20, MOST_BYTES >> 20);
            let (count, side) = (self.count, self.settings.side);
            let reason = format!(
                "{count} probes of {side} texels take {mib} MiB; the limit is {most} MiB: lower their number or side"
            );
            return Err(InvalidField::new("reflections.side", reason));
        }
        Ok(())
    }

    /// Bytes of all probes: radiance and range.
    fn bytes(&self) -> u64 {
        let texels: u64 = map_size(self.settings.side).map(u64::from).iter().product();
        texels * 8 * u64::from(self.count)
    }
}

impl fmt::Display for ReflectionProbeSet {
    /// All that the probes are a function of, beside scene and time.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} maps {}", self.count, self.settings)?;
        self.eye.map_or(Ok(()), |eye| write!(f, ", {eye}"))
    }
}

/// An instance with a reflection probe.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reflector {
    /// Index into [`Scene::instances`].
    pub instance: u32,
    /// The middle of its bounds, metres, world space: the viewpoint of its probe.
    pub center: DVec3,
    /// Half the diagonal of its bounds, metres.
    pub radius: f64,
}

impl Material {
    /// Whether the material reflects an image of the scene around it, and not only light and dark. A textured roughness
    /// counts by its mean.
    fn mirrors(&self, scene: &Scene) -> bool {
        let mean = |reference: Option<TextureRef>, channel: usize| {
            let texture = reference.and_then(|at| scene.textures.get(at.texture as usize));
            texture.map_or(1.0, |texture| texture.mean(channel))
        };
        let roughness = self.roughness * mean(self.metallic_roughness_texture, 1);
        let metallic = self.metallic * mean(self.metallic_roughness_texture, 2);
        let channels = [0, 1, 2].map(|channel| mean(self.specular_color_texture, channel));
        let f0 = self.dielectric_f0() * Vec3::from(channels) * mean(self.specular_texture, 3);
        let is_strong = metallic >= 0.5 || self.transmission > 0.0 || f0.max_element() >= 0.5;
        let roughest = if is_strong { ROUGHEST } else { ROUGHEST_DIELECTRIC };
        self.is_glossy() && roughness <= roughest
    }
}

impl Texture {
    /// Mean of a channel, 0 to 1, of a few thousand texels that stand for all; linear.
    pub fn mean(&self, channel: usize) -> f32 {
        let step = (self.rgba.len() / 4 / 4096).max(1);
        let mut count = [0u32; 256];
        for value in self.rgba.iter().skip(channel).step_by(4 * step) {
            count[usize::from(*value)] += 1;
        }
        let all: u32 = count.iter().sum();
        let value = |byte: usize| {
            let value = byte as f32 / 255.0;
            if self.srgb && channel < 3 { linear_from_srgb(value) } else { value }
        };
        (0..256).map(|byte| value(byte) * count[byte] as f32).sum::<f32>() / all.max(1) as f32
    }
}

impl Scene {
    /// The instances with a probe, ascending: all reflectors, or the `most` largest ones. They are chosen at time zero, so
    /// that they are the same at all times.
    pub fn reflectors(&self, most: u32) -> Vec<u32> {
        let mirrors: Vec<bool> = self.materials.iter().map(|material| material.mirrors(self)).collect();
        let mut found: Vec<Reflector> = (0u32..)
            .zip(&self.instances)
            .filter(|(_, i)| mirrors[self.meshes[i.mesh as usize].material as usize])
            .filter_map(|(index, instance)| self.reflector(index, instance))
            .collect();
        found.sort_by(|a, b| b.radius.total_cmp(&a.radius).then(a.instance.cmp(&b.instance)));
        let mut chosen: Vec<u32> = found.iter().take(most as usize).map(|r| r.instance).collect();
        chosen.sort_unstable();
        chosen
    }

    /// An instance as a reflector at its pose; `None` if its mesh is empty.
    pub fn reflector(&self, index: u32, instance: &Instance) -> Option<Reflector> {
        let mesh = &self.meshes[instance.mesh as usize];
        let mut bounds = Bounds::EMPTY;
        for &vertex in &mesh.indices {
            let position = mesh.positions.get(vertex as usize)?.as_dvec3();
            bounds.extend(instance.world_from_mesh.transform_point3(mesh.origin + position));
        }
        let (center, radius) = (bounds.center(), 0.5 * bounds.size().length());
        (!bounds.is_empty() && radius > 0.0 && radius.is_finite()).then_some(Reflector {
            instance: index,
            center,
            radius,
        })
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::{DAffine3, Vec3};

    use super::*;
    use crate::material::{Filter, Wrap};
    use crate::{Mesh, Texture, TextureRef};

    fn ball(size: f32, material: u32) -> Mesh {
        Mesh {
            positions: vec![Vec3::ZERO, Vec3::X * size, Vec3::Y * size, Vec3::Z * size],
            indices: vec![0, 1, 2, 0, 2, 3],
            material,
            ..Mesh::default()
        }
    }

    fn scene() -> Scene {
        let chrome = Material { metallic: 1.0, roughness: 0.1, ..Material::default() };
        let matt = Material::default();
        let textured =
            Material { metallic_roughness_texture: Some(TextureRef::new(0)), ..Material::default() };
        let texture = Texture {
            name: "rough in the mean".to_owned(),
            width: 2,
            height: 1,
            rgba: Arc::from([0, 255, 0, 255, 0, 200, 0, 255]),
            srgb: false,
            wrap: [Wrap::Repeat; 2],
            filter: Filter::Linear,
        };
        let at = |mesh, x| Instance {
            mesh,
            node: None,
            world_from_mesh: DAffine3::from_translation(DVec3::X * x),
        };
        Scene {
            meshes: vec![ball(1.0, 0), ball(2.0, 0), ball(4.0, 1), ball(4.0, 2), Mesh::default()],
            instances: vec![at(0, 0.0), at(2, 1.0), at(1, 1e6), at(3, 2.0), at(0, 5.0), at(4, 0.0)],
            materials: vec![chrome, matt, textured],
            textures: vec![texture],
            ..Scene::default()
        }
    }

    #[test]
    fn every_reflector_has_a_probe_up_to_the_limit_and_the_largest_come_first() {
        let scene = scene();
        assert_eq!(scene.reflectors(10), [0, 2, 4], "neither matt nor rough in the mean, nor nowhere");
        assert_eq!(scene.reflectors(2), [0, 2], "of two of one size the first");
        assert_eq!(scene.reflectors(1), [2]);
    }

    #[test]
    fn a_probe_is_seen_from_the_middle_of_its_reflector() {
        let scene = scene();
        let far = scene.reflector(2, &scene.instances[2]).unwrap();
        assert!((far.center - DVec3::new(1e6 + 1.0, 1.0, 1.0)).length() < 1e-6, "{far:?}");
        assert!((far.radius - 3f64.sqrt()).abs() < 1e-9);
        assert_eq!(scene.reflector(5, &scene.instances[5]), None, "a mesh without triangles");
    }

    #[test]
    fn levels_end_at_four_texels_and_lie_below_one_another() {
        assert_eq!(level_sides(64).collect::<Vec<_>>(), [64, 32, 16, 8, 4]);
        assert_eq!(map_size(64), [66, 66 + 34 + 18 + 10 + 6]);
        assert_eq!(map_size(16), [18, 18 + 10 + 6]);
    }

    #[test]
    fn every_setting_out_of_range_is_named() {
        let field = |reflections: Reflections| reflections.validate().unwrap_err().field;
        let default = Reflections::default();
        assert_eq!(default.validate(), Ok(()));
        assert_eq!(field(Reflections { side: 48, ..default }), "reflections.side");
        assert_eq!(field(Reflections { side: 512, ..default }), "reflections.side");
        let of = |source| Reflections { source, ..default };
        assert_eq!(field(of(ProbeSource::Octree { levels: 11 })), "reflections.levels");
        assert_eq!(of(ProbeSource::POINTS).validate(), Ok(()));
        for budget in [0, 1023, u32::MAX] {
            assert_eq!(field(of(ProbeSource::Points { budget })), "reflections.points");
        }
        assert_eq!(field(Reflections { most: 0, ..default }), "reflections.most");
    }

    #[test]
    fn too_large_probes_and_a_wrong_number_of_them_are_refused() {
        let field = |maps: ReflectionProbeSet| maps.validate().unwrap_err().field;
        let few = ReflectionProbeSet {
            settings: Reflections { most: 1024, ..Reflections::default() },
            count: 1024,
            eye: None,
        };
        assert_eq!(few.validate(), Ok(()));
        assert_eq!(field(ReflectionProbeSet { count: 1025, ..few }), "reflections.count");
        assert_eq!(field(ReflectionProbeSet { count: 0, ..few }), "reflections.count");
        let large = ReflectionProbeSet { settings: Reflections { side: 256, ..few.settings }, ..few };
        assert_eq!(field(large), "reflections.side");
        let found = ReflectionProbeSet::of(&scene(), &cells(), Reflections::default()).unwrap().unwrap();
        assert_eq!((found.count, found.eye), (3, None));
    }

    fn cells() -> Rig {
        Rig::Cell { origin: DVec3::ZERO, spacing: 1.0, face: 384 }
    }

    #[test]
    fn points_follow_the_viewers_of_the_rig() {
        let settings = Reflections { source: ProbeSource::POINTS, ..Reflections::default() };
        let set = ReflectionProbeSet::of(&scene(), &cells(), settings).unwrap().unwrap();
        assert_eq!(set.eye, Some(ProbeEye { viewpoints: scene().extent(), pixels: 192.0 }));
        let bounds = scene().bounds();
        let above = Rig::TileCorners { bounds, tiles: [3, 2], height: 1.0, size: [400, 300] };
        let eye = ReflectionProbeSet::of(&scene(), &above, settings).unwrap().unwrap().eye.unwrap();
        for index in 0..24 {
            let at = above.camera(index).unwrap().center();
            assert!(eye.viewpoints.contains(at) && at.y > bounds.max.y, "{at} {eye}");
        }
        assert_ne!(set.to_string(), ReflectionProbeSet { eye: Some(eye), ..set }.to_string());
    }

    #[test]
    fn points_need_viewers_and_an_octree_has_none() {
        let points = Reflections { source: ProbeSource::POINTS, ..Reflections::default() };
        let eye = ProbeEye { viewpoints: Bounds { min: DVec3::ZERO, max: DVec3::ONE }, pixels: 100.0 };
        let set = ReflectionProbeSet { settings: points, count: 1, eye: Some(eye) };
        let field = |set: ReflectionProbeSet| set.validate().unwrap_err().field;
        assert_eq!(set.validate(), Ok(()));
        assert_eq!(field(ReflectionProbeSet { eye: None, ..set }), "reflections.viewpoints");
        let octree = Reflections::default();
        assert_eq!(field(ReflectionProbeSet { settings: octree, ..set }), "reflections.viewpoints");
        let nowhere = ProbeEye { viewpoints: Bounds::EMPTY, ..eye };
        assert_eq!(field(ReflectionProbeSet { eye: Some(nowhere), ..set }), "reflections.viewpoints");
        for pixels in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            let eye = Some(ProbeEye { pixels, ..eye });
            assert_eq!(field(ReflectionProbeSet { eye, ..set }), "reflections.pixels");
        }
    }
}
