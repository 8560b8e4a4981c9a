//! A scene's surfaces as a list of triangles.

use argus_scene::tone::linear_from_srgb;
use argus_scene::{Bounds, Pose, Scene, Texture};
use glam::{DVec3, Vec3};

use super::Triangle;

/// The triangles of a posed scene, world space. A triangle has its material's reflectance with the mean of its texture.
/// Cut-outs count as whole triangles.
pub fn triangles<'a>(scene: &'a Scene, pose: &'a Pose) -> impl Iterator<Item = Triangle> + 'a {
    let colors: Vec<Vec3> = scene
        .materials
        .iter()
        .map(|material| {
            let texture = material.base_color_texture.and_then(|t| scene.textures.get(t.texture as usize));
            material.base_color.truncate() * texture.map_or(Vec3::ONE, mean_color)
        })
        .collect();
    pose.instances.iter().flat_map(move |instance| {
        let mesh = &scene.meshes[instance.mesh as usize];
        let color = colors.get(mesh.material as usize).copied().unwrap_or(Vec3::ONE);
        let corner = move |index: u32| {
            let position = mesh.positions.get(index as usize).map_or(DVec3::NAN, |p| p.as_dvec3());
            instance.world_from_mesh.transform_point3(mesh.origin + position)
        };
        let triangle = move |indices: &[u32]| {
            let corners = [corner(indices[0]), corner(indices[1]), corner(indices[2])];
            Triangle { corners, color }
        };
        mesh.indices.chunks_exact(3).map(triangle)
    })
}

/// The smallest box around the triangles that have an area.
pub fn bounds(triangles: impl IntoIterator<Item = Triangle>) -> Bounds {
    let mut bounds = Bounds::EMPTY;
    for triangle in triangles.into_iter().filter(Triangle::is_surface) {
        triangle.corners.into_iter().for_each(|corner| bounds.extend(corner));
    }
    bounds
}

/// Mean linear colour of an image.
fn mean_color(texture: &Texture) -> Vec3 {
    let linear = |byte: u8| {
        let value = f32::from(byte) / 255.0;
        if texture.srgb { linear_from_srgb(value) } else { value }
    };
    let table: Vec<f32> = (0..=255).map(linear).collect();
    let texels = texture.rgba.len() / 4;
    let sum = texture.rgba.chunks_exact(4).fold(glam::DVec3::ZERO, |sum, texel| {
        sum + DVec3::from_array([0, 1, 2].map(|i| f64::from(table[usize::from(texel[i])])))
    });
    (sum / texels.max(1) as f64).as_vec3()
}
