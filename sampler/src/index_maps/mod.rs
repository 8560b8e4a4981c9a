//! IndexMaps around reflectors whose texels name what they see: an id, and its range. Reflection probes by rays and by points are
//! made of them, so that each thing that a map shows is shaded once.

mod reflector;
mod requests;

use std::sync::atomic::{AtomicU64, Ordering};

use glam::DVec3;

pub use self::reflector::{HalfSpace, MappedReflector};
pub use self::requests::Requests;

/// Faces of a map: +x, −x, +y, −y, +z, −z.
pub const FACES: usize = 6;

/// A direction within a face: coordinates along its two axes, and along its own axis; the direction lies within the face
/// if the first two are at most the third.
#[inline]
pub fn in_face(face: usize, direction: DVec3) -> DVec3 {
    let [x, y, z] = direction.to_array();
    let sign = if face.is_multiple_of(2) { 1.0 } else { -1.0 };
    match face / 2 {
        0 => DVec3::new(y, z, x * sign),
        1 => DVec3::new(z, x, y * sign),
        _ => DVec3::new(x, y, z * sign),
    }
}

/// The direction of coordinates within a face.
#[inline]
pub fn from_face(face: usize, at: DVec3) -> DVec3 {
    let along = if face.is_multiple_of(2) { at.z } else { -at.z };
    match face / 2 {
        0 => DVec3::new(along, at.x, at.y),
        1 => DVec3::new(at.y, along, at.x),
        _ => DVec3::new(at.x, at.y, along),
    }
}

/// The face of a direction: that of its longest coordinate.
#[inline]
pub fn face_of(direction: DVec3) -> usize {
    let axis = direction.abs().max_position();
    2 * axis + usize::from(direction[axis] < 0.0)
}

/// Maps of all reflectors. A texel is the inverse range of what it sees, and an id for that; the nearest of all
/// that is written stays, whatever the order of writing.
pub struct IndexMaps {
    layout: Vec<Layout>,
    keys: Vec<AtomicU64>,
}

/// Where a map's texels are.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Layout {
    first: usize,
    side: u32,
}

impl IndexMaps {
    /// Empty maps of the sides that reflectors ask for, in their order.
    pub fn new(reflectors: &[MappedReflector]) -> Self {
        let texels = reflectors.iter().map(|reflector| FACES * (reflector.side as usize).pow(2)).sum();
        Self::with_bits(reflectors, vec![0; texels])
    }

    /// IndexMaps with the bits of all texels, as [`Self::bits`] gives them.
    pub fn with_bits(reflectors: &[MappedReflector], bits: Vec<u64>) -> Self {
        let mut texels = 0;
        let place = |reflector: &MappedReflector| {
            let first = texels;
            texels += FACES * (reflector.side as usize).pow(2);
            Layout { first, side: reflector.side }
        };
        let layout = reflectors.iter().map(place).collect();
        assert_eq!(texels, bits.len(), "one word a texel");
        Self { layout, keys: bits.into_iter().map(AtomicU64::new).collect() }
    }

    /// Number of maps.
    pub fn count(&self) -> u32 {
        self.layout.len() as u32
    }

    /// Number of texels of all maps.
    pub fn texels(&self) -> usize {
        self.keys.len()
    }

    /// Bytes of all texels.
    pub fn bytes(&self) -> usize {
        size_of_val(&self.keys[..])
    }

    /// Texels on an edge of a map's face.
    pub fn side(&self, map: usize) -> u32 {
        self.layout[map].side
    }

    /// Index of a texel.
    #[inline]
    pub fn index(&self, map: usize, face: usize, column: u32, row: u32) -> usize {
        let Layout { first, side } = self.layout[map];
        first + (face * side as usize + row as usize) * side as usize + column as usize
    }

    /// The texel that a direction belongs to.
    #[inline]
    pub fn texel_of(&self, map: usize, direction: DVec3) -> usize {
        let side = self.layout[map].side;
        let face = face_of(direction);
        let at = in_face(face, direction);
        let coordinate = |x: f64| (((x / at.z + 1.0) * 0.5 * f64::from(side)) as u32).min(side - 1);
        self.index(map, face, coordinate(at.x), coordinate(at.y))
    }

    /// The direction through the middle of a texel, of length 1 along the face's axis.
    #[inline]
    pub fn direction(&self, map: usize, face: usize, column: u32, row: u32) -> DVec3 {
        let side = f64::from(self.layout[map].side);
        let coordinate = |at: u32| (f64::from(at) + 0.5) / side * 2.0 - 1.0;
        from_face(face, DVec3::new(coordinate(column), coordinate(row), 1.0))
    }

    /// The map and the direction of a texel, by index.
    pub fn direction_of(&self, texel: usize) -> (usize, DVec3) {
        let map = self.layout.partition_point(|layout| layout.first <= texel) - 1;
        let Layout { first, side } = self.layout[map];
        let (side, within) = (side as usize, texel - first);
        let (face, column, row) = (within / (side * side), within % side, within / side % side);
        (map, self.direction(map, face, column as u32, row as u32))
    }

    /// The direction through the middle of a texel, and those of the texels after it on the face's two axes, beyond its edge if
    /// need be. Of length 1 along the face's axis.
    pub fn neighbourhood(&self, texel: usize) -> [DVec3; 3] {
        let (map, direction) = self.direction_of(texel);
        let Layout { first, side } = self.layout[map];
        let face = (texel - first) / (side as usize).pow(2);
        let step = 2.0 / f64::from(side);
        [DVec3::ZERO, DVec3::X, DVec3::Y].map(|axis| direction + from_face(face, axis * step))
    }

    /// Writes what a texel sees at a range in metres, unless it sees something nearer.
    #[inline]
    pub fn write(&self, texel: usize, range: f64, id: u32) {
        let inverse = (range.recip() as f32).max(f32::MIN_POSITIVE);
        self.keys[texel].fetch_max(u64::from(inverse.to_bits()) << 32 | u64::from(id), Ordering::Relaxed);
    }

    /// What a texel sees, and its range in metres; `None` for sky.
    #[inline]
    pub fn get(&self, texel: usize) -> Option<(u32, f64)> {
        let key = self.keys[texel].load(Ordering::Relaxed);
        (key != 0).then(|| (key as u32, f64::from(f32::from_bits((key >> 32) as u32)).recip()))
    }

    /// The plane that a texel and its neighbours in the face see: all points p about the map's middle whose product with
    /// the result is 1. `None` for sky. Of the two neighbours on an axis, the one whose depth differs less counts: the other
    /// may see another surface.
    #[inline]
    pub fn plane(&self, map: usize, texel: usize) -> Option<DVec3> {
        let Layout { first, side } = self.layout[map];
        let (side, within) = (side as usize, texel - first);
        let (face, row, column) = (within / (side * side), within / side % side, within % side);
        let step = 2.0 / side as f64;
        let coordinate = |at: usize| (at as f64 + 0.5) * step - 1.0;
        let (x, y) = (coordinate(column), coordinate(row));
        // The inverse of the depth along the face's axis: linear in the face's coordinates on a plane.
        let inverse = |texel: usize, x: f64, y: f64| {
            let (_, range) = self.get(texel)?;
            Some((x * x + y * y + 1.0).sqrt() / range)
        };
        let here = inverse(texel, x, y)?;
        let slope = |at: usize, stride: usize, place: &dyn Fn(f64) -> (f64, f64)| {
            let of = |texel: usize, sign: f64| {
                let (x, y) = place(sign * step);
                inverse(texel, x, y).map(|there| (there - here) * sign / step)
            };
            let before = if at > 0 { of(texel - stride, -1.0) } else { None };
            let after = if at + 1 < side { of(texel + stride, 1.0) } else { None };
            match (before, after) {
                (Some(a), Some(b)) => {
                    if a.abs() < b.abs() {
                        a
                    } else {
                        b
                    }
                }
                (Some(a), None) | (None, Some(a)) => a,
                (None, None) => 0.0,
            }
        };
        let right = slope(column, 1, &|step| (x + step, y));
        let up = slope(row, side, &|step| (x, y + step));
        Some(from_face(face, DVec3::new(right, up, here - right * x - up * y)))
    }

    /// All texels' bits: equal for equal maps.
    pub fn bits(&self) -> impl Iterator<Item = u64> {
        self.keys.iter().map(|key| key.load(Ordering::Relaxed))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn maps() -> IndexMaps {
        let map = |side| MappedReflector {
            instance: 0,
            center: DVec3::ZERO,
            radius: 1.0,
            curvature: 1.0,
            side,
            front: None,
        };
        IndexMaps::new(&[map(32), map(96), map(64)])
    }

    #[test]
    fn every_texel_is_the_one_that_its_direction_belongs_to() {
        let maps = maps();
        assert_eq!(maps.texels(), 6 * (32 * 32 + 96 * 96 + 64 * 64));
        for texel in 0..maps.texels() {
            let (map, direction) = maps.direction_of(texel);
            assert_eq!(maps.texel_of(map, direction * 7.5), texel);
        }
    }

    #[test]
    fn every_direction_has_a_texel_within_half_a_texel_of_it_also_at_borders_of_faces() {
        let maps = maps();
        for i in 0..4000u32 {
            let part = |step: u32| f64::from(i / step % 17) / 8.0 - 1.0;
            let direction = DVec3::new(part(1), part(17), part(289));
            if direction == DVec3::ZERO {
                continue;
            }
            let (map, middle) = maps.direction_of(maps.texel_of(1, direction));
            assert_eq!(map, 1);
            let angle = middle.angle_between(direction);
            assert!(angle <= 2f64.sqrt() / 96.0 + 1e-9, "{direction}: {angle}");
        }
    }

    #[test]
    fn faces_are_the_directions_whose_longest_coordinate_is_their_axis() {
        for face in 0..FACES {
            let direction = from_face(face, DVec3::new(0.3, -0.8, 1.0));
            assert_eq!(face_of(direction), face);
            assert!((in_face(face, direction) - DVec3::new(0.3, -0.8, 1.0)).length() < 1e-15);
        }
    }

    #[test]
    fn the_nearest_stays_and_of_equally_near_ones_the_highest_id() {
        let maps = maps();
        for (range, id) in [(3.0, 9), (2.0, 4), (5.0, 1), (2.0, 7), (2.0, 5)] {
            maps.write(11, range, id);
        }
        assert_eq!(maps.get(11), Some((7, 2.0)));
        assert_eq!(maps.get(12), None);
        maps.write(12, 1e300, 3);
        assert!(maps.get(12).is_some(), "far away is not sky");
    }
}
