//! The scene on the device. It is uploaded once; instances are moved, and meshes deformed, for each epoch.

mod geometry;
mod materials;
mod texels;

use std::sync::Arc;

use crate::{Indirect, SamplerSettings};
use argus_gpu::{EnvironmentTexture, Gpu, wgpu};
use argus_scene::{Bounds, Effect, Instance, Mesh, RenderError, Scene};
use argus_shaders::layout::sampler::{reads, role};
use bytemuck::{NoUninit, Zeroable};
use glam::{DMat3, DVec3, Vec3};

pub(crate) use geometry::{Chunk, MeshRun, octahedral};

/// Buffers and textures that passes read, by the names that `shaders/shared/geometry.wgsl` and
/// `shaders/shared/texture.wgsl` give them, and what the CPU needs to draw them.
pub struct Resident {
    pub(crate) vertices: wgpu::Buffer,
    pub(crate) attributes: wgpu::Buffer,
    pub(crate) indices: wgpu::Buffer,
    pub(crate) meshes: wgpu::Buffer,
    pub(crate) materials: wgpu::Buffer,
    pub(crate) slots: wgpu::Buffer,
    pub(crate) texel_levels: wgpu::Buffer,
    pub(crate) texels: wgpu::TextureView,
    pub(crate) texels_srgb: wgpu::TextureView,
    /// The sky's map.
    pub environment: EnvironmentTexture,
    /// Where the textures are in the array, by which materials address them.
    textures: Vec<texels::InstanceTransform>,
    /// One a mesh of the scene.
    pub(crate) runs: Vec<MeshRun>,
    /// Visible instances at the time of the last pose, in drawing order: by class, then by mesh.
    pub instances: Vec<Placement>,
    /// Largest instance index + 1.
    pub(crate) instance_count: usize,
    /// Box around the scene at all times, world space.
    pub(crate) bounds: Bounds,
    /// What programs are specialised to.
    pub features: Features,
}

/// Shading features that the scene needs. Programs are specialised to them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Features {
    pub(crate) srgb_textures: bool,
    pub(crate) linear_textures: bool,
    pub(crate) normal_maps: bool,
    pub(crate) vertex_colors: bool,
    pub(crate) specular: bool,
    pub(crate) specular_textures: bool,
    pub(crate) transmission_textures: bool,
    pub(crate) nearest_textures: bool,
    pub(crate) second_uvs: bool,
    /// The sky is an environment map.
    pub environment: bool,
}

impl Features {
    fn new(scene: &Scene, materials: &materials::Materials) -> Self {
        let effects = scene.effects();
        let has_role = |roles: &[u32]| materials.slots.iter().any(|slot| roles.contains(&slot.usage[2]));
        let reads = |bit: u32| materials.slots.iter().any(|slot| slot.usage[3] & bit != 0);
        Self {
            srgb_textures: materials.data.iter().any(|m| m.textures[1] > 0),
            linear_textures: materials.data.iter().any(|m| m.textures[3] > 0),
            normal_maps: effects.contains(&Effect::NormalMap),
            vertex_colors: scene.meshes.iter().any(|mesh| !mesh.colors.is_empty()),
            specular: effects.contains(&Effect::Specular),
            specular_textures: has_role(&[role::SPECULAR, role::SPECULAR_COLOR]),
            transmission_textures: has_role(&[role::TRANSMISSION]),
            nearest_textures: reads(reads::NEAREST),
            second_uvs: reads(reads::SECOND_UVS),
            environment: scene.lighting.sky.map.is_some(),
        }
    }

    /// The `override` of programs that look at the sky and not at surfaces.
    pub fn sky_constant(self) -> (&'static str, f64) {
        ("has_environment", f64::from(u8::from(self.environment)))
    }

    /// Values of the `override`s of programs that test alpha.
    pub(crate) fn alpha_constants(self) -> [(&'static str, f64); 2] {
        [("has_nearest_textures", self.nearest_textures), ("has_second_uvs", self.second_uvs)]
            .map(|(name, has)| (name, f64::from(u8::from(has))))
    }

    /// Values of the shading programs' `override`s.
    pub fn constants(self, g_buffer: GBufferUse) -> [(&'static str, f64); 12] {
        [
            ("has_nearest_textures", self.nearest_textures),
            ("has_second_uvs", self.second_uvs),
            ("has_specular_textures", self.specular_textures),
            ("has_transmission_textures", self.transmission_textures),
            ("has_srgb_textures", self.srgb_textures),
            ("has_linear_textures", self.linear_textures),
            ("has_normal_maps", self.normal_maps),
            ("has_vertex_colors", self.vertex_colors),
            ("has_specular", self.specular),
            ("has_environment", self.environment),
            ("keeps_g_buffer", g_buffer != GBufferUse::None),
            ("lit_by_rays", g_buffer == GBufferUse::AllLight),
        ]
        .map(|(name, has)| (name, f64::from(u8::from(has))))
    }
}

/// What passes after shading do with the G-buffer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum GBufferUse {
    /// Nothing: shading writes none.
    None,
    /// Indirect light is added to what is shaded.
    IndirectLight,
    /// Lights and sky are added, too: shading leaves emission and what reflection probes show.
    AllLight,
}

impl GBufferUse {
    /// The use of a sampler with these settings.
    pub fn of(settings: &SamplerSettings) -> Self {
        match (settings.effects.any(), settings.indirect) {
            (true, _) => Self::AllLight,
            (false, Indirect::Off) => Self::None,
            (false, _) => Self::IndirectLight,
        }
    }

    /// The same use, with a G-buffer in any case.
    pub fn at_least_kept(self) -> Self {
        if self == Self::None { Self::IndirectLight } else { self }
    }
}

/// The pipeline of an instance.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct DrawClass {
    /// Whether fragments test alpha.
    pub cutout: bool,
    /// The side that is culled.
    pub cull: Cull,
}

/// The side of triangles that is culled.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Cull {
    /// No side.
    None,
    /// The back side.
    Back,
    /// The back side under a mirroring transform, which reverses winding.
    MirroredBack,
}

/// A visible instance.
#[derive(Debug, Clone, Copy)]
pub struct Placement {
    /// Index into [`Scene::instances`].
    pub instance: u32,
    /// Index into [`Scene::meshes`].
    pub mesh: u32,
    /// Its pipeline.
    pub class: DrawClass,
    /// Linear part of the transform.
    pub world_from_mesh: DMat3,
    /// Its inverse.
    pub mesh_from_world: DMat3,
    /// World space position of the mesh's origin.
    pub origin: DVec3,
}

impl Placement {
    /// Corners of all triangles of its mesh, world space. Some may not be finite.
    pub fn triangles<'a>(&self, mesh: &'a Mesh) -> impl Iterator<Item = [DVec3; 3]> + use<'a> {
        let (origin, world_from_mesh) = (self.origin, self.world_from_mesh);
        let corner = move |i: u32| {
            let p = mesh.positions.get(i as usize).copied().unwrap_or(Vec3::NAN);
            origin + world_from_mesh * p.as_dvec3()
        };
        mesh.indices.as_chunks::<3>().0.iter().map(move |indices| indices.map(corner))
    }
}

impl Resident {
    /// Uploads a scene.
    ///
    /// # Errors
    /// [`RenderError::OutOfMemory`] if a part of it is larger than the device can bind.
    pub(crate) fn new(gpu: &Arc<Gpu>, scene: &Scene) -> Result<Self, RenderError> {
        let (arena, runs) = geometry::Arena::new(scene);
        let texels = texels::Texels::new(gpu, scene)?;
        let materials = materials::Materials::new(scene, &texels.textures);
        let storage = wgpu::BufferUsages::STORAGE;
        let vertex = storage | wgpu::BufferUsages::VERTEX;
        let index = storage | wgpu::BufferUsages::INDEX;
        Ok(Self {
            vertices: upload(gpu, "vertices", &arena.vertices, vertex)?,
            attributes: upload(gpu, "vertex attributes", &arena.attributes, storage)?,
            indices: upload(gpu, "indices", &arena.indices, index)?,
            meshes: upload(gpu, "meshes", &arena.layouts, storage)?,
            features: Features::new(scene, &materials),
            materials: upload(gpu, "materials", &materials.data, storage)?,
            slots: upload(gpu, "texture slots", &materials.slots, storage)?,
            texel_levels: upload(gpu, "texture levels", &texels.levels, storage)?,
            texels: texels.linear,
            texels_srgb: texels.srgb,
            environment: EnvironmentTexture::new(gpu, &scene.lighting.sky)?,
            textures: texels.textures,
            instances: placements(scene, &scene.at(0.0).instances, |mesh| is_filled(&runs[mesh])),
            runs,
            instance_count: scene.instances.len(),
            bounds: scene.bounds(),
        })
    }

    /// Takes over what light changes of the same scene: emission, and the sky. Triangles and textures stay.
    ///
    /// # Errors
    /// Those of [`Self::new`].
    pub(crate) fn relight(&mut self, gpu: &Arc<Gpu>, scene: &Scene) -> Result<(), RenderError> {
        let materials = materials::Materials::new(scene, &self.textures);
        let storage = wgpu::BufferUsages::STORAGE;
        self.features = Features::new(scene, &materials);
        self.materials = upload(gpu, "materials", &materials.data, storage)?;
        self.slots = upload(gpu, "texture slots", &materials.slots, storage)?;
        self.environment = EnvironmentTexture::new(gpu, &scene.lighting.sky)?;
        Ok(())
    }

    /// Uploads the vertices of the meshes of a posed scene that deform.
    pub(crate) fn reshape(&mut self, gpu: &Gpu, scene: &Scene) {
        let deforming = scene.deforming_meshes();
        for (at, mesh) in scene.meshes.iter().enumerate().filter(|(at, _)| deforming[*at]) {
            let run = &mut self.runs[at];
            let mut arena = geometry::Arena::default();
            let shaped = arena.push(mesh, !run.chunks.is_empty(), false);
            let write = |to: &wgpu::Buffer, first: u32, records: &[[u32; 4]]| {
                let offset = u64::from(first) * size_of::<[u32; 4]>() as u64;
                gpu.queue.write_buffer(to, offset, bytemuck::cast_slice(records));
            };
            write(&self.vertices, run.first_vertex, &arena.vertices);
            write(&self.attributes, run.first_attribute, &arena.attributes);
            (run.chunks, run.whole) = (shaped.chunks, shaped.whole);
        }
    }

    /// Moves instances. Triangles, materials and textures stay.
    pub(crate) fn place(&mut self, scene: &Scene, instances: &[Instance]) {
        self.instances = placements(scene, instances, |mesh| is_filled(&self.runs[mesh]));
    }
}

/// A buffer of `data`, or of one zero if there is none, because an empty buffer cannot be bound.
///
/// # Errors
/// [`RenderError::OutOfMemory`] if it is larger than the device can bind.
pub fn upload<T: NoUninit + Zeroable>(
    gpu: &Gpu,
    label: &str,
    data: &[T],
    usage: wgpu::BufferUsages,
) -> Result<wgpu::Buffer, RenderError> {
    let limits = gpu.device.limits();
    let most = limits.max_buffer_size.min(limits.max_storage_buffer_binding_size);
    let bytes = size_of_val(data) as u64;
    if bytes > most {
        let (mib, most) = (bytes.div_ceil(1 << 20), most >> 20);
        let message =
            format!("{label} of this scene take {mib} MiB, and this device binds at most {most} MiB");
        return Err(RenderError::OutOfMemory(message));
    }
    Ok(if data.is_empty() {
        gpu.upload(label, &[T::zeroed()], usage)
    } else {
        gpu.upload(label, data, usage)
    })
}

/// Inverse scale at which an instance counts as shrunk to nothing.
const MOST_SHRUNK: f64 = 1e15;

fn is_filled(run: &MeshRun) -> bool {
    !run.chunks.is_empty()
}

/// A scene's instances like [`Resident::instances`], without a device.
pub fn placed(scene: &Scene, instances: &[Instance]) -> Vec<Placement> {
    placements(scene, instances, |mesh| scene.meshes[mesh].triangles() > 0)
}

/// Instances with triangles and an invertible transform, in drawing order. `is_filled` has for each mesh whether it has
/// triangles.
fn placements(scene: &Scene, instances: &[Instance], is_filled: impl Fn(usize) -> bool) -> Vec<Placement> {
    let mut placements: Vec<Placement> = (0u32..)
        .zip(instances)
        .filter_map(|(index, instance)| {
            let mesh = &scene.meshes[instance.mesh as usize];
            let material = &scene.materials[mesh.material as usize];
            let world_from_mesh = instance.world_from_mesh.matrix3;
            let mesh_from_world = world_from_mesh.inverse();
            let origin = instance.world_from_mesh.transform_point3(mesh.origin);
            // What has shrunk to nothing is not seen: the squares of such an inverse overflow in f32.
            let seen = mesh_from_world.is_finite()
                && mesh_from_world.to_cols_array().iter().all(|x| x.abs() < MOST_SHRUNK)
                && origin.is_finite();
            let cull = match (material.double_sided, world_from_mesh.determinant() < 0.0) {
                (true, _) => Cull::None,
                (false, false) => Cull::Back,
                (false, true) => Cull::MirroredBack,
            };
            let class = DrawClass { cutout: material.alpha_cutoff().is_some(), cull };
            (seen && is_filled(instance.mesh as usize)).then_some(Placement {
                instance: index,
                mesh: instance.mesh,
                class,
                world_from_mesh,
                mesh_from_world,
                origin,
            })
        })
        .collect();
    placements.sort_by_key(|p| (p.class, p.mesh, p.instance));
    placements
}
