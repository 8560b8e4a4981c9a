//! Attributes of a visible surface point: normals, textures, reflectance.

use glam::{DVec3, Vec2, Vec3, Vec4};

use super::corners::Corners;
use super::{Hit, Tracer};
use crate::shading::{Surface, dielectric_f0};
use crate::texture::{transform_duv, transform_uv};
use crate::{Material, Mesh, TextureRef};

/// Position of a sample on a mesh's textures, and its differences to the neighbouring samples.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Footprint {
    uv: Vec2,
    dx: Vec2,
    dy: Vec2,
}

impl Tracer {
    /// The surface at `hit`, seen along the unit `direction`; `dx` and `dy` as in
    /// [`Self::radiance_along`].
    ///
    /// Texture derivatives are those of the points at which the neighbouring rays meet the triangle's plane, to
    /// first order (Igehy, "Tracing Ray Differentials", 1999, section 3.1.1), times the gradient of the
    /// texture coordinates. The shading normal is interpolated and perturbed in mesh space and then goes to the
    /// world by the inverse transpose, so that a mirrored instance shows mirrored bumps.
    pub fn surface(&self, hit: &Hit, direction: DVec3, dx: DVec3, dy: DVec3) -> Surface {
        let instance = &self.pose.instances[hit.instance as usize];
        let mesh = &self.scene.meshes[instance.mesh as usize];
        let material = &self.scene.materials[mesh.material as usize];
        let corners = Corners::new(mesh, hit.triangle, hit.barycentric);
        let mesh_from_world = instance.world_from_mesh.matrix3.inverse();

        let positions = corners.each(&mesh.positions).unwrap_or_default().map(|p| p.as_dvec3());
        let edges = [positions[1] - positions[0], positions[2] - positions[0]];
        let geometric = edges[0].cross(edges[1]);
        let rays = [direction, dx, dy].map(|d| mesh_from_world * d);
        let at = [0, 1].map(|set| footprint(mesh.uvs_of(set), &corners, edges, geometric, rays, hit.range));

        let in_mesh = self.shading_normal(mesh, material, &corners, &at).unwrap_or(geometric);
        let normal = (mesh_from_world.transpose() * in_mesh).normalize_or(-direction);
        let side = if hit.front { 1.0 } else { -1.0 };

        let vertex_color = corners.blend(&mesh.colors).unwrap_or(Vec4::ONE);
        let base = material.base_color * self.lookup(material.base_color_texture, &at) * vertex_color;
        let metallic_roughness = self.lookup(material.metallic_roughness_texture, &at);
        let metallic = (material.metallic * metallic_roughness.z).clamp(0.0, 1.0);
        let base = base.truncate();
        let (albedo, emissive) = match material.unlit {
            true => (Vec3::ZERO, Material::unlit_radiance(base, self.pose.lighting.exposure)),
            false => (
                base * (1.0 - metallic),
                material.emissive * self.lookup(material.emissive_texture, &at).truncate(),
            ),
        };
        let f0 = if material.is_glossy() {
            let tint = material.specular_color * self.lookup(material.specular_color_texture, &at).truncate();
            let strength = material.specular * self.lookup(material.specular_texture, &at).w;
            ((tint * dielectric_f0(material.ior)).min(Vec3::ONE) * strength).lerp(base, metallic)
        } else {
            Vec3::ZERO
        };
        Surface {
            position: hit.position,
            normal: (normal * side).as_vec3(),
            albedo,
            emissive,
            f0,
            roughness: (material.roughness * metallic_roughness.y).clamp(0.0, 1.0),
            transmission: material.transmission * self.lookup(material.transmission_texture, &at).x,
        }
    }

    /// Linear texture value; white where there is no texture.
    fn lookup(&self, reference: Option<TextureRef>, at: &[Footprint; 2]) -> Vec4 {
        let found = reference.and_then(|r| Some((r, self.textures.get(r.texture as usize)?)));
        let Some((reference, chain)) = found else { return Vec4::ONE };
        let at = &at[usize::from(reference.uv_set.min(1))];
        let level = chain.level(transform_duv(&reference, at.dx), transform_duv(&reference, at.dy));
        chain.sample(transform_uv(&reference, at.uv), level)
    }

    /// Interpolated, and perturbed by the normal map, on the triangle's front; mesh space, not necessarily a unit vector.
    /// `None` if the mesh has no usable normals.
    fn shading_normal(
        &self,
        mesh: &Mesh,
        material: &Material,
        corners: &Corners,
        at: &[Footprint; 2],
    ) -> Option<DVec3> {
        let normal = corners.blend(&mesh.normals)?.as_dvec3().try_normalize()?;
        if material.normal_texture.is_none() {
            return Some(normal);
        }
        // A normal map without tangents, or with tangents that cancel out, has no effect.
        let Some([first, ..]) = corners.each(&mesh.tangents) else { return Some(normal) };
        let tangent = corners.blend(&mesh.tangents)?.truncate().as_dvec3();
        let Some(tangent) = tangent.try_normalize() else { return Some(normal) };
        let bitangent = normal.cross(tangent) * f64::from(first.w);
        let texel = self.lookup(material.normal_texture, at).truncate() * 2.0 - 1.0;
        let local = (texel * Vec3::new(material.normal_scale, material.normal_scale, 1.0)).as_dvec3();
        let perturbed = tangent * local.x + bitangent * local.y + normal * local.z;
        Some(perturbed.try_normalize().unwrap_or(normal))
    }
}

/// Texture coordinates of a mesh at a point and their derivatives. `rays` are the direction and its two differences in mesh space, where t
/// counts the world's unit direction, so that ranges equal the world's.
fn footprint(
    uvs: &[Vec2],
    corners: &Corners,
    edges: [DVec3; 2],
    geometric: DVec3,
    [direction, dx, dy]: [DVec3; 3],
    range: f64,
) -> Footprint {
    let Some([a, b, c]) = corners.each(uvs) else {
        return Footprint { uv: Vec2::ZERO, dx: Vec2::ZERO, dy: Vec2::ZERO };
    };
    let duv = |difference: DVec3| {
        let along = -range * difference.dot(geometric) / direction.dot(geometric);
        let moved = difference * range + direction * along;
        // Barycentric coordinates are the areas of sub-triangles relative to the whole.
        let area = geometric.length_squared();
        let second = moved.cross(edges[1]).dot(geometric) / area;
        let third = edges[0].cross(moved).dot(geometric) / area;
        (b - a) * second as f32 + (c - a) * third as f32
    };
    Footprint { uv: corners.blend(uvs).unwrap_or(a), dx: duv(dx), dy: duv(dy) }
}
