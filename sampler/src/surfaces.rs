//! Surface properties that paths need: position, reflectance and emission.
//!
//! Textures are read from a coarse level, because a VPL represents its neighbourhood.

use std::sync::Arc;

use argus_scene::texture::{MipChain, mip_chains, transform_uv};
use argus_scene::{Material, Mesh, Scene, TextureRef};
use glam::{DMat3, DVec3, Vec2, Vec3, Vec4};

use crate::packets::Hit;
use crate::resident::Placement;

/// Texels on the longer side of that level.
const LEVEL_SIDE: f32 = 64.0;

/// A scene's materials on the CPU.
#[derive(Clone)]
pub struct Surfaces {
    scene: Arc<Scene>,
    textures: Vec<MipChain>,
    /// One entry an instance; `None` if it is not placed.
    placements: Vec<Option<Placement>>,
}

/// A surface point, on the side that is hit.
#[derive(Debug, Clone, Copy)]
pub struct Point {
    /// Unit normal of the triangle.
    pub side: DVec3,
    /// Unit interpolated normal.
    pub normal: DVec3,
    /// Diffuse albedo.
    pub albedo: Vec3,
    /// Base colour: the albedo of a matt surface, and about the reflectance of a metal. Zero if it is unlit.
    pub base: Vec3,
    /// Emitted radiance.
    pub emissive: Vec3,
}

impl Surfaces {
    /// The surfaces of a scene with these instances.
    pub fn new(scene: &Arc<Scene>, placements: &[Placement]) -> Self {
        let mut surfaces =
            Self { scene: Arc::clone(scene), textures: mip_chains(scene), placements: Vec::new() };
        surfaces.place(scene, placements);
        surfaces
    }

    /// Moves instances of a posed scene.
    pub fn place(&mut self, scene: &Arc<Scene>, placements: &[Placement]) {
        self.scene = Arc::clone(scene);
        self.placements = vec![None; self.scene.instances.len()];
        for placement in placements {
            self.placements[placement.instance as usize] = Some(*placement);
        }
    }

    /// A hash of the scene and of where its instances are; `None` if meshes change shape, which it does not cover.
    pub(crate) fn pose_hash(&self) -> Option<[u8; 32]> {
        if self.scene.meshes.iter().any(|mesh| mesh.deformation.is_some()) {
            return None;
        }
        let mut hasher = blake3::Hasher::new();
        hasher.update(&self.scene.hash.0);
        for Placement { instance, mesh, world_from_mesh, origin, .. } in self.placements() {
            hasher.update(bytemuck::bytes_of(&[*instance, *mesh]));
            hasher.update(bytemuck::bytes_of(&world_from_mesh.to_cols_array()));
            hasher.update(bytemuck::bytes_of(&origin.to_array()));
        }
        Some(hasher.finalize().into())
    }

    /// The visible instances.
    pub fn placements(&self) -> impl Iterator<Item = &Placement> {
        self.placements.iter().flatten()
    }

    /// The placement of a visible instance.
    pub fn placement(&self, instance: u32) -> Option<&Placement> {
        self.placements.get(instance as usize)?.as_ref()
    }

    /// The textures, with all levels.
    pub fn textures(&self) -> &[MipChain] {
        &self.textures
    }

    /// The posed scene.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// Corners of all visible triangles, world space. Some may not be finite.
    pub fn triangles(&self) -> impl Iterator<Item = [DVec3; 3]> + '_ {
        self.placements()
            .flat_map(|placement| placement.triangles(&self.scene.meshes[placement.mesh as usize]))
    }

    /// The material of a hit.
    pub fn material(&self, hit: &Hit) -> Option<&Material> {
        let placement = self.placement(hit.instance)?;
        Some(&self.scene.materials[self.scene.meshes[placement.mesh as usize].material as usize])
    }

    /// Whether light passes straight through the surface of a hit: [`Material::passes_light`].
    pub fn passes_light(&self, hit: &Hit) -> bool {
        let Some(placement) = self.placement(hit.instance) else { return false };
        let mesh = &self.scene.meshes[placement.mesh as usize];
        let material = &self.scene.materials[mesh.material as usize];
        if !material.passes_light_in_parts() {
            return material.passes_light();
        }
        let found =
            material.transmission_texture.and_then(|r| Some((r, self.textures.get(r.texture as usize)?)));
        let (Some((reference, chain)), Some(corners)) = (found, corners(mesh, hit.primitive)) else {
            return true;
        };
        let [beta, gamma] = hit.weights.map(|w| w as f32);
        let uv = blend(mesh.uvs_of(reference.uv_set), corners, [1.0 - beta - gamma, beta, gamma]);
        let red = chain.red(transform_uv(&reference, uv.unwrap_or(Vec2::ZERO)));
        material.transmission * red >= 0.5
    }

    /// The surface of a hit of a ray along `direction`. `None` for a degenerate triangle.
    pub fn hit(&self, hit: &Hit, direction: DVec3) -> Option<Point> {
        let placement = self.placement(hit.instance)?;
        let side = self.normal(placement, hit.primitive)?;
        // Towards the ray's origin, whatever the winding.
        let away = side.dot(direction) > 0.0;
        self.point(placement, hit.primitive, hit.weights, if away { -side } else { side })
    }

    /// Unit normal of a triangle's front.
    pub fn normal(&self, placement: &Placement, primitive: u32) -> Option<DVec3> {
        front(placement, &self.scene.meshes[placement.mesh as usize], primitive)
    }

    /// A point of a triangle by the weights of its second and third corner, on the side of a unit normal.
    pub fn point(
        &self,
        placement: &Placement,
        primitive: u32,
        [beta, gamma]: [f64; 2],
        side: DVec3,
    ) -> Option<Point> {
        let mesh = &self.scene.meshes[placement.mesh as usize];
        let material = &self.scene.materials[mesh.material as usize];
        let corners = corners(mesh, primitive)?;
        let weights = [1.0 - beta - gamma, beta, gamma].map(|w| w as f32);
        let uv = |set| blend(mesh.uvs_of(set), corners, weights).unwrap_or(Vec2::ZERO);
        let color = blend(&mesh.colors, corners, weights).unwrap_or(Vec4::ONE);
        let base = material.base_color * self.texel(material.base_color_texture, uv) * color;
        let metallic = material.metallic * self.texel(material.metallic_roughness_texture, uv).z;
        let base = if material.unlit { Vec3::ZERO } else { sound(base.truncate()).min(Vec3::ONE) };
        Some(Point {
            side,
            normal: normal_at(placement, mesh, corners, weights, side),
            albedo: base * (1.0 - metallic.clamp(0.0, 1.0)),
            base,
            emissive: sound(material.emissive * self.texel(material.emissive_texture, uv).truncate()),
        })
    }

    /// Unit interpolated normal of a triangle by the weights of its second and third corner, on the side of a unit normal.
    pub fn shading_normal(
        &self,
        placement: &Placement,
        primitive: u32,
        [beta, gamma]: [f64; 2],
        side: DVec3,
    ) -> Option<DVec3> {
        let mesh = &self.scene.meshes[placement.mesh as usize];
        let weights = [1.0 - beta - gamma, beta, gamma].map(|w| w as f32);
        Some(normal_at(placement, mesh, corners(mesh, primitive)?, weights, side))
    }

    /// `uv` gives the texture coordinates of a set.
    fn texel(&self, reference: Option<TextureRef>, uv: impl Fn(u8) -> Vec2) -> Vec4 {
        let found = reference.and_then(|r| Some((r, self.textures.get(r.texture as usize)?)));
        let Some((reference, chain)) = found else { return Vec4::ONE };
        let level = (chain.size().max_element() / LEVEL_SIDE).log2();
        chain.sample(transform_uv(&reference, uv(reference.uv_set)), level)
    }
}

/// Unit normal of a triangle's front, world space.
pub(crate) fn front(placement: &Placement, mesh: &Mesh, primitive: u32) -> Option<DVec3> {
    let [a, b, c] = corners(mesh, primitive)?.map(|i| mesh.positions[i]);
    let edges = [b - a, c - a].map(|e| (placement.world_from_mesh * e.as_dvec3()).normalize_or_zero());
    let mirrored = placement.world_from_mesh.determinant() < 0.0;
    let normal = edges[0].cross(edges[1]).try_normalize()?;
    Some(if mirrored { -normal } else { normal })
}

/// Unit interpolated normal on the side of `side`, which it is without normals.
pub(crate) fn normal_at(
    placement: &Placement,
    mesh: &Mesh,
    corners: [usize; 3],
    weights: [f32; 3],
    side: DVec3,
) -> DVec3 {
    let normal = interpolated_normal(placement, mesh, corners, weights).unwrap_or(side);
    if normal.dot(side) < 0.0 { -normal } else { normal }
}

/// Unit interpolated normal, as the mesh has it; `None` without normals.
pub(crate) fn interpolated_normal(
    placement: &Placement,
    mesh: &Mesh,
    corners: [usize; 3],
    weights: [f32; 3],
) -> Option<DVec3> {
    let normal = blend(&mesh.normals, corners, weights)?;
    let world_from_normal: DMat3 = placement.mesh_from_world.transpose();
    (world_from_normal * normal.as_dvec3()).try_normalize()
}

/// Clamps negative values and NaN to 0.
fn sound(color: Vec3) -> Vec3 {
    let channel = |x: f32| if x > 0.0 && x.is_finite() { x } else { 0.0 };
    Vec3::new(channel(color.x), channel(color.y), channel(color.z))
}

pub(crate) fn corners(mesh: &Mesh, primitive: u32) -> Option<[usize; 3]> {
    let first = 3 * primitive as usize;
    let corners: [u32; 3] = mesh.indices.get(first..first + 3)?.try_into().ok()?;
    let corners = corners.map(|i| i as usize);
    corners.iter().all(|&i| i < mesh.positions.len()).then_some(corners)
}

fn blend<T>(attribute: &[T], corners: [usize; 3], weights: [f32; 3]) -> Option<T>
where
    T: Copy + std::ops::Mul<f32, Output = T> + std::ops::Add<Output = T>,
{
    let [a, b, c] = corners.map(|i| attribute.get(i).copied());
    Some(a? * weights[0] + b? * weights[1] + c? * weights[2])
}
