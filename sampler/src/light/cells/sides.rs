//! The surfaces in a light cell, as sides: what lies in the cell and faces the same way.
//!
//! All triangles that meet the cell are clipped to it. Each visible face of a piece belongs to one of six sides, by the axis
//! that its normal is nearest to. A side keeps its mean point, its mean shading normal and eight origins of rays, spread
//! over its area. Sides that one value does not describe are marked: surfaces that face many ways, as leaves and wires do,
//! and surfaces on both sides of a wall.

use argus_scene::light_sampling::r2;
use glam::Vec3;

use super::super::lattice::CellKey;
use super::super::paths::Polygon;
use super::super::pattern::hash;
use super::scene::CellScene;

/// Origins of a side's rays.
pub(super) const ORIGINS: usize = 8;
/// Least area of a side, in areas of a cell's face.
const LEAST_AREA: f32 = 1e-4;
/// Blocked ways of eight between a side's origins, up to which no wall stands between them.
pub(super) const MOST_BLOCKED: u8 = 2;
/// Length of the mean of a side's normals by area, below which the side is thin.
const THIN: f32 = 0.9;
/// Height of a side's rays against leaks, in edges of the cell.
pub(super) const LIFT: f32 = 0.2;
/// Share of such a ray that is looked at: it does not meet what it ends on.
pub(super) const ALMOST: f32 = 0.999;

/// A side, as lookups need it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Side {
    /// Mean point from the cell's lowest corner, in edges of the cell.
    pub(super) place: Vec3,
    /// Unit mean shading normal.
    pub(super) normal: Vec3,
    /// Whether its surfaces face many ways, as leaves and wires do: pixels are better lit by rays of their own.
    pub(super) is_thin: bool,
    /// How many of eight ways between its own origins are blocked: many if it is on both sides of a wall, few in relief.
    pub(super) blocked: u8,
}

/// A side, as its rays need it.
pub(super) struct SideShape {
    pub(super) side: Side,
    pub(super) origins: [Origin; ORIGINS],
}

/// Where rays of a side begin. Positions are metres about the centre of the scene's extent.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Origin {
    pub(super) start: Vec3,
    /// Unit normal of the triangle, on the visible side.
    pub(super) side: Vec3,
    /// Whether something lies so close above it that it is not what a viewer sees of the cell, such as the floor in a crack.
    pub(super) is_covered: bool,
}

/// The part of a triangle in the cell, seen from one side.
struct Piece {
    triangle: u32,
    polygon: Polygon,
    area: f32,
    /// Unit normal of the triangle, on that side.
    normal: Vec3,
}

/// The sides of a cell, at most six.
pub(super) fn shapes_of(scene: &CellScene<'_>, key: CellKey) -> Vec<SideShape> {
    let [low, high] = scene.lattice.corners(key);
    let mut pieces: [Vec<Piece>; 6] = Default::default();
    for triangle in scene.tree.within([low, high], scene.leaves.triangles()) {
        let Some((front, faces)) = scene.leaves.faces(scene.surfaces, triangle) else { continue };
        let polygon = scene.leaves.polygon(triangle).in_box(low, high);
        let area = polygon.area();
        if !(area > 0.0 && area.is_finite()) {
            continue;
        }
        for (normal, is_seen) in [front, -front].into_iter().zip(faces) {
            if is_seen {
                pieces[axis_of(normal)].push(Piece { triangle, polygon, area, normal });
            }
        }
    }
    pieces.iter().filter_map(|pieces| shape_of(scene, key, pieces)).collect()
}

/// The axis that a normal is nearest to, and its direction: 0 to 5.
fn axis_of(normal: Vec3) -> usize {
    let size = normal.abs();
    let axis = match (size.x >= size.y && size.x >= size.z, size.y >= size.z) {
        (true, _) => 0,
        (false, true) => 1,
        (false, false) => 2,
    };
    2 * axis + usize::from(normal[axis] < 0.0)
}

/// The side of some pieces; `None` if they have next to no area.
fn shape_of(scene: &CellScene<'_>, key: CellKey, pieces: &[Piece]) -> Option<SideShape> {
    let spacing = scene.lattice.spacing(key.level());
    let [low, _] = scene.lattice.corners(key);
    let area: f32 = pieces.iter().map(|piece| piece.area).sum();
    if !(area > LEAST_AREA * spacing * spacing) {
        return None;
    }
    let (mut center, mut facing) = (Vec3::ZERO, Vec3::ZERO);
    for piece in pieces {
        center += (piece.polygon.center() - low) * piece.area;
        facing += piece.normal * piece.area;
    }
    let (origins, normal) = origins_of(scene, key, pieces, area);
    let normal = normal.try_normalize().or_else(|| facing.try_normalize())?;
    let origins = covered(scene, origins, LIFT * spacing);
    let side = Side {
        place: center / (area * spacing),
        normal,
        is_thin: facing.length() < THIN * area,
        blocked: blocked_ways(scene, &origins, normal * (LIFT * spacing)),
    };
    side.place.is_finite().then_some(SideShape { side, origins })
}

/// Origins in strata of equal area, and the sum of their shading normals.
fn origins_of(scene: &CellScene<'_>, key: CellKey, pieces: &[Piece], area: f32) -> ([Origin; ORIGINS], Vec3) {
    let shift = hash(key.hash());
    let mut rest = pieces.iter();
    let (mut piece, mut up_to) = (&pieces[0], 0.0);
    let mut normals = Vec3::ZERO;
    let origins = std::array::from_fn(|number| {
        let target = (number as f32 + 0.5) / ORIGINS as f32 * area;
        while up_to <= target {
            let Some(next) = rest.next() else { break };
            (piece, up_to) = (next, up_to + next.area);
        }
        let square = (r2(number as u32 + 1) + shift).fract().as_vec2();
        let position = piece.polygon.point(square).unwrap_or_else(|| piece.polygon.center());
        let shading = scene.leaves.shading_normal(scene.surfaces, piece.triangle, position, piece.normal);
        normals += shading.unwrap_or(piece.normal);
        let off = 2.0 * scene.about.offset(position, 0.0);
        Origin { start: position + piece.normal * off, side: piece.normal, is_covered: false }
    });
    (origins, normals)
}

/// Finds out which origins are covered. If all are, they are all that there is, and none counts as covered.
fn covered(scene: &CellScene<'_>, origins: [Origin; ORIGINS], lift: f32) -> [Origin; ORIGINS] {
    let found = origins.map(|origin| Origin {
        is_covered: scene.about.is_blocked(origin.start, origin.side * lift, 1.0),
        ..origin
    });
    if found.iter().all(|origin| origin.is_covered) { origins } else { found }
}

/// How many of eight ways between the origins of a side are blocked. Those of covered ones do not count, as their rays do not.
fn blocked_ways(scene: &CellScene<'_>, origins: &[Origin; ORIGINS], lift: Vec3) -> u8 {
    let is_blocked = |number: &usize| {
        // Three is prime to eight: one round trip over all origins, with long steps.
        let ends = [*number, (number + 3) % ORIGINS].map(|number| &origins[number]);
        let [from, to] = ends.map(|end| end.start + lift);
        !ends.iter().any(|end| end.is_covered) && scene.about.is_blocked(from, to - from, ALMOST)
    };
    (0..ORIGINS).filter(is_blocked).count() as u8
}
