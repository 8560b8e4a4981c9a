//! Small scenes built in code, one for each difficulty.

use std::sync::Arc;

use argus_scene::{Bounds, Instance, Light, Lighting, Mesh, Rig, RigKind, Scene, SceneHash, Sky};
use glam::{DAffine3, DVec3, Vec2, Vec3, Vec4};

/// A scene and the rig of its sample cameras.
#[derive(Clone)]
pub(super) struct World {
    pub(super) scene: Scene,
    pub(super) rig: Rig,
}

/// Size in texels of a perspective sample.
pub(super) const TEXELS: [u32; 2] = [240, 180];
/// Side in texels of a cube face.
pub(super) const FACE: u32 = 128;

/// A scene with light and no surface.
pub(super) fn empty() -> Scene {
    let sky = Sky {
        zenith: Vec3::new(0.2, 0.4, 0.9),
        horizon: Vec3::new(0.8, 0.8, 0.7),
        ground: Vec3::new(0.3, 0.2, 0.1),
        map: None,
        reach: None,
    };
    Scene {
        name: "hard case".to_owned(),
        hash: SceneHash([0xca; 32]),
        lighting: Lighting { lights: vec![Light::sun()], sky, exposure: 0.7 },
        rig: RigKind::TileCorners,
        ..Scene::default()
    }
}

pub(super) fn place(scene: &mut Scene, mesh: Mesh) {
    let mesh_index = scene.meshes.len() as u32;
    scene.meshes.push(mesh);
    let world_from_mesh = DAffine3::IDENTITY;
    scene.instances.push(Instance { mesh: mesh_index, node: None, world_from_mesh });
}

/// A colour that varies slowly over space: a wrong position shows, a neighbouring one does not.
fn paint(p: Vec3, hue: f32) -> Vec4 {
    let wave = |k: f32| 0.55 + 0.25 * (p.x * k + hue).sin() + 0.2 * (p.z * k * 0.8 + p.y * 0.7).cos();
    Vec4::new(wave(0.35), wave(0.27) * 0.9, 0.25 + 0.6 * (hue * 0.37).fract(), 1.0)
}

/// A rectangle of `cells`² quads in the plane through `center` with the given half axes.
pub(super) fn sheet(center: Vec3, x: Vec3, y: Vec3, cells: u32, hue: f32) -> Mesh {
    let mut mesh = Mesh::default();
    let normal = x.cross(y).normalize();
    for i in 0..=cells {
        for j in 0..=cells {
            let at = |k: u32| 2.0 * k as f32 / cells as f32 - 1.0;
            let p = center + x * at(i) + y * at(j);
            mesh.positions.push(p);
            mesh.normals.push(normal);
            mesh.uvs.push(Vec2::new(at(i), at(j)));
            mesh.colors.push(paint(p, hue));
        }
    }
    for i in 0..cells {
        for j in 0..cells {
            let a = i * (cells + 1) + j;
            let (b, c, d) = (a + cells + 1, a + cells + 2, a + 1);
            mesh.indices.extend([a, b, c, a, c, d]);
        }
    }
    mesh
}

/// Six sheets around a box.
pub(super) fn block(min: Vec3, max: Vec3, cells: u32, hue: f32) -> Vec<Mesh> {
    let (center, half) = ((min + max) * 0.5, (max - min) * 0.5);
    let axes = [Vec3::X, Vec3::Y, Vec3::Z];
    (0..6)
        .map(|i| {
            let axis = axes[i / 2] * if i % 2 == 0 { 1.0 } else { -1.0 };
            let (u, v) = (axes[(i / 2 + 1) % 3], axes[(i / 2 + 2) % 3]);
            sheet(center + axis * half, u * half * axis.element_sum(), v * half, cells, hue + i as f32 * 0.3)
        })
        .collect()
}

/// A ball whose front faces look outwards.
pub(super) fn ball(center: Vec3, radius: f32, hue: f32) -> Mesh {
    const RINGS: u32 = 24;
    let mut mesh = Mesh::default();
    for i in 0..=RINGS {
        for j in 0..=2 * RINGS {
            let (polar, azimuth) = (
                i as f32 / RINGS as f32 * std::f32::consts::PI,
                j as f32 / RINGS as f32 * std::f32::consts::PI,
            );
            let n = Vec3::new(polar.sin() * azimuth.cos(), polar.cos(), -polar.sin() * azimuth.sin());
            mesh.positions.push(center + n * radius);
            mesh.normals.push(n);
            mesh.uvs.push(Vec2::new(azimuth, polar));
            mesh.colors.push(paint(center + n * radius, hue));
        }
    }
    let row = 2 * RINGS + 1;
    for i in 0..RINGS {
        for j in 0..2 * RINGS {
            let (a, b) = (i * row + j, (i + 1) * row + j);
            mesh.indices.extend([a, b, a + 1, a + 1, b, b + 1]);
        }
    }
    mesh
}

fn of(parts: impl IntoIterator<Item = Mesh>) -> Scene {
    let mut scene = empty();
    parts.into_iter().for_each(|mesh| place(&mut scene, mesh));
    scene
}

fn ground() -> Mesh {
    sheet(Vec3::ZERO, Vec3::X * 10.0, Vec3::NEG_Z * 10.0, 32, 0.0)
}

/// Four cameras above a scene's corners.
pub(super) fn corners(scene: Scene) -> World {
    let rig = Rig::TileCorners { bounds: scene.bounds(), tiles: [1, 1], height: 1.0, size: TEXELS };
    World { scene, rig }
}

/// Cube cameras on a lattice about `origin`.
pub(super) fn lattice(scene: Scene, origin: DVec3, spacing: f64) -> World {
    World { scene, rig: Rig::Cell { origin, spacing, face: FACE } }
}

/// Ground of 20 m × 20 m, three balls of one metre and a low wall, with a rig above its corners.
pub(super) fn garden() -> World {
    let balls = [(0.0, 0.0), (4.0, -2.5), (-3.5, 3.0)];
    let balls = balls.iter().enumerate().map(|(i, &(x, z))| ball(Vec3::new(x, 1.0, z), 1.0, 1.0 + i as f32));
    let wall = block(Vec3::new(-6.0, 0.0, -5.0), Vec3::new(-2.0, 2.0, -4.5), 4, 4.0);
    corners(of([ground()].into_iter().chain(balls).chain(wall)))
}

/// A closed room of 12 m × 5 m × 12 m about the point (0, 2.5, 0) with a pillar, a lattice of cubes in it.
pub(super) fn room() -> World {
    let walls = block(Vec3::new(-6.0, 0.0, -6.0), Vec3::new(6.0, 5.0, 6.0), 16, 0.5);
    let pillar = block(Vec3::new(1.0, 0.0, -2.0), Vec3::new(1.8, 5.0, -1.2), 6, 3.0);
    lattice(of(walls.into_iter().chain(pillar)), DVec3::new(-0.2, 2.4, 0.3), 1.5)
}

/// The room with a lattice whose cameras stand close to the floor and the walls, inside the room.
pub(super) fn room_to_its_walls() -> World {
    lattice(room().scene, DVec3::new(0.4, 0.4, 0.3), 1.5)
}

/// The room divided by a wall. No sample of the far half sees past it.
pub(super) fn divided_room() -> World {
    let mut world = room();
    for mesh in block(Vec3::new(-6.0, 0.0, 2.6), Vec3::new(6.0, 5.0, 2.8), 12, 5.0) {
        place(&mut world.scene, mesh);
    }
    // For a viewer close to the wall, the nearest corners of the cell are those on the far side.
    lattice(world.scene, DVec3::new(-0.2, 2.4, 1.9), 3.0)
}

/// A hollow block around the viewer, on the garden's ground.
pub(super) fn hollow() -> World {
    let body = block(Vec3::new(-3.0, 0.2, -3.0), Vec3::new(3.0, 3.2, 3.0), 8, 2.0);
    corners(of([ground()].into_iter().chain(body)))
}

/// A wall of two coplanar sheets, one over half of the other, on a ground.
pub(super) fn coplanar() -> World {
    let wall = |x: f32, hue: f32| sheet(Vec3::new(x, 3.0, -2.0), Vec3::X * 4.0, Vec3::Y * 3.0, 8, hue);
    corners(of([ground(), wall(-2.0, 1.0), wall(2.0, 4.0)]))
}

/// Wires of 1 cm to 10 cm in front of a ground: thinner than a sample's texels, and about as thick.
pub(super) fn wires() -> World {
    let wire = |i: u32| {
        let (x, half) = (i as f32 * 1.6 - 7.2, [0.005, 0.01, 0.02, 0.05][i as usize % 4]);
        block(Vec3::new(x - half, 0.0, -half), Vec3::new(x + half, 4.0, half), 2, 2.0 + i as f32)
    };
    corners(of([ground()].into_iter().chain((0..10).flat_map(wire))))
}

/// Blocks of two heights, like a chess board.
pub(super) fn checkerboard() -> World {
    let square = |i: u32| {
        let (x, z) = ((i % 8) as f32 * 2.0 - 8.0, (i / 8) as f32 * 2.0 - 8.0);
        let height = if (i % 8 + i / 8).is_multiple_of(2) { 2.0 } else { 0.2 };
        block(Vec3::new(x, 0.0, z), Vec3::new(x + 2.0, height, z + 2.0), 3, i as f32 * 0.1)
    };
    corners(of((0..64).flat_map(square)))
}

/// Ground alone, with a low rig.
pub(super) fn plain() -> World {
    let mut scene = of([ground()]);
    // The rig needs bounds with a height.
    place(&mut scene, sheet(Vec3::new(0.0, 1.0, -9.0), Vec3::X * 2.0, Vec3::Y, 4, 3.0));
    corners(scene)
}

/// One triangle with cube cameras around it.
pub(super) fn one_triangle() -> World {
    let triangle = Mesh {
        positions: vec![Vec3::new(-1.0, -1.0, 0.0), Vec3::new(1.0, -1.0, 0.0), Vec3::new(0.0, 1.0, 0.0)],
        normals: vec![Vec3::Z; 3],
        indices: vec![0, 1, 2],
        ..Mesh::default()
    };
    lattice(of([triangle]), DVec3::new(0.1, 0.2, 3.0), 1.0)
}

/// The garden with further triangles that have no area or a corner that is not finite.
pub(super) fn broken() -> World {
    let World { mut scene, rig } = garden();
    let mut mesh = sheet(Vec3::new(2.0, 1.0, 4.0), Vec3::X, Vec3::Y, 4, 5.0);
    let first = mesh.positions.len() as u32;
    mesh.positions.extend([Vec3::NAN, Vec3::new(9.0, f32::INFINITY, 0.0), Vec3::new(0.5, 0.5, 0.5)]);
    mesh.normals.extend([Vec3::ZERO, Vec3::NAN, Vec3::Y]);
    mesh.uvs.extend([Vec2::NAN; 3]);
    mesh.colors.extend([Vec4::NAN; 3]);
    let [nan, far, point] = [first, first + 1, first + 2];
    mesh.indices.extend([0, 1, nan, far, 1, 2, point, point, point, 0, 2, 0]);
    place(&mut scene, mesh);
    World { scene, rig }
}

/// An empty scene and one cube camera.
pub(super) fn sky() -> World {
    lattice(empty(), DVec3::ZERO, 1.0)
}

impl World {
    /// The world, scaled about the origin and then moved.
    pub(super) fn placed(mut self, scale: f64, offset: DVec3) -> Self {
        let moved = DAffine3::from_translation(offset) * DAffine3::from_scale(DVec3::splat(scale));
        for instance in &mut self.scene.instances {
            instance.world_from_mesh = moved * instance.world_from_mesh;
        }
        let at = |p: DVec3| p * scale + offset;
        self.rig = match self.rig {
            Rig::TileCorners { bounds, tiles, height, size } => {
                let bounds = Bounds { min: at(bounds.min), max: at(bounds.max) };
                Rig::TileCorners { bounds, tiles, height, size }
            }
            Rig::Cell { origin, spacing, face } => {
                Rig::Cell { origin: at(origin), spacing: spacing * scale, face }
            }
        };
        self
    }

    /// The scene and the rig, ready to share.
    pub(super) fn shared(self) -> (Arc<Scene>, Rig) {
        (Arc::new(self.scene), self.rig)
    }
}
