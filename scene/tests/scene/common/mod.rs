//! Scenes whose radiance and ranges are known exactly.

use std::sync::Arc;

use argus_scene::{Instance, Light, Lighting, Material, Mesh, Scene, SceneHash, Sky, Texture, TextureRef};
use glam::{DAffine3, DVec3, Vec2, Vec3, Vec4};

/// White light from everywhere, no lights: a white surface has radiance 1.
pub(crate) fn furnace() -> Lighting {
    let sky = Sky { zenith: Vec3::ONE, horizon: Vec3::ONE, ground: Vec3::ONE, map: None, reach: None };
    Lighting { lights: Vec::new(), sky, exposure: 1.0 }
}

/// A black sky and one sun along `direction` of irradiance π: a white surface that faces it has radiance 1.
pub(crate) fn sun(direction: DVec3) -> Lighting {
    let irradiance = Vec3::splat(std::f32::consts::PI);
    Lighting {
        lights: vec![Light::Directional { direction, irradiance, angular_radius: 0.0 }],
        sky: Sky::BLACK,
        exposure: 1.0,
    }
}

pub(crate) fn white() -> Material {
    Material { base_color: Vec4::ONE, ..Material::default() }
}

/// A scene of meshes, each placed once where it is; mesh i has material i, or the last one.
pub(crate) fn scene(meshes: Vec<Mesh>, materials: Vec<Material>, lighting: Lighting) -> Scene {
    let last = materials.len() as u32 - 1;
    let meshes: Vec<Mesh> =
        (0..).zip(meshes).map(|(i, mesh)| Mesh { material: last.min(i), ..mesh }).collect();
    let place = |mesh| Instance { mesh, node: None, world_from_mesh: DAffine3::IDENTITY };
    Scene {
        name: "test".to_owned(),
        hash: SceneHash([7; 32]),
        instances: (0..meshes.len() as u32).map(place).collect(),
        meshes,
        materials,
        lighting,
        ..Scene::default()
    }
}

pub(crate) fn tracer(scene: Scene) -> argus_scene::reference::Tracer {
    argus_scene::reference::Tracer::new(Arc::new(scene))
}

/// A patch of the plane z = 0 from (−1, −1) to (1, 1) that faces +z, of `cells`² squares; uv runs from (0, 0)
/// at its top left to (1, 1).
pub(crate) fn patch(cells: u32) -> Mesh {
    let side = cells + 1;
    let at = |i: u32| Vec2::new((i % side) as f32, (i / side) as f32) / cells as f32;
    let points = side * side;
    let corner = |x: u32, y: u32| y * side + x;
    let cell = |i: u32| {
        let (x, y) = (i % cells, i / cells);
        let [a, b, c, d] = [corner(x, y), corner(x + 1, y), corner(x, y + 1), corner(x + 1, y + 1)];
        [a, c, b, b, c, d]
    };
    Mesh {
        positions: (0..points).map(|i| Vec3::new(2.0 * at(i).x - 1.0, 1.0 - 2.0 * at(i).y, 0.0)).collect(),
        normals: vec![Vec3::Z; points as usize],
        tangents: vec![Vec4::new(1.0, 0.0, 0.0, 1.0); points as usize],
        uvs: (0..points).map(at).collect(),
        indices: (0..cells * cells).flat_map(cell).collect(),
        ..Mesh::default()
    }
}

/// A unit sphere of `2·rings²` quads, counter-clockwise from outside.
pub(crate) fn sphere(rings: u32) -> Mesh {
    let columns = 2 * rings;
    let point = |i: u32| {
        let (polar, azimuth) = (
            f64::from(i / (columns + 1)) / f64::from(rings) * std::f64::consts::PI,
            f64::from(i % (columns + 1)) / f64::from(columns) * std::f64::consts::TAU,
        );
        DVec3::new(polar.sin() * azimuth.cos(), polar.cos(), -polar.sin() * azimuth.sin()).as_vec3()
    };
    let quad = |i: u32| {
        let a = i / columns * (columns + 1) + i % columns;
        let (b, c, d) = (a + 1, a + columns + 1, a + columns + 2);
        [a, c, b, b, c, d]
    };
    let positions: Vec<Vec3> = (0..(rings + 1) * (columns + 1)).map(point).collect();
    Mesh {
        normals: positions.clone(),
        positions,
        indices: (0..rings * columns).flat_map(quad).collect(),
        ..Mesh::default()
    }
}

/// An image with one texel a pixel of `texel`, as an sRGB texture.
pub(crate) fn texture(side: u32, texel: impl Fn(u32, u32) -> [u8; 4]) -> Texture {
    let rgba: Vec<u8> =
        (0..side).flat_map(|y| (0..side).map(move |x| (x, y))).flat_map(|(x, y)| texel(x, y)).collect();
    let (wrap, filter) = ([argus_scene::material::Wrap::Repeat; 2], argus_scene::material::Filter::Linear);
    Texture { name: String::new(), width: side, height: side, rgba: rgba.into(), srgb: true, wrap, filter }
}

pub(crate) fn textured(material: Material) -> Material {
    Material { base_color_texture: Some(TextureRef::new(0)), ..material }
}
