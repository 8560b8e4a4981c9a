//! Which faces of a cube a sample has, or a plan uses.

use std::collections::BTreeMap;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::{InvalidField, OmniLayout, SampleCamera};

/// A set of a cube's six faces, numbered as in [`SampleCamera::faces`]. Samples of other cameras have one image, and
/// always [`FaceMask::ALL`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(try_from = "u32", into = "u32")]
pub struct FaceMask(u8);

/// Number of a cube's faces.
const FACES: u32 = 6;

/// Share of a face's half side, beyond its border, within which [`FaceMask::around`] counts a direction as touching the
/// face. Rays of an estimate are about that far apart.
const MARGIN: f64 = 0.1;

impl FaceMask {
    /// All faces.
    pub const ALL: Self = Self((1 << FACES) - 1);

    /// No face: what a worker has of a sample that it does not hold. No sample, plan or request has this mask.
    pub const NONE: Self = Self(0);

    /// The mask with these bits; bit i stands for face i.
    ///
    /// # Errors
    /// [`InvalidField`] of that field for no face, and for bits that stand for none.
    pub fn new(bits: u32, field: &'static str) -> Result<Self, InvalidField> {
        match u8::try_from(bits) {
            Ok(bits @ 1..) if bits <= Self::ALL.0 => Ok(Self(bits)),
            _ => {
                let reason = format!("must name 1 to {FACES} faces, bits 0 to {}, not {bits:#b}", FACES - 1);
                Err(InvalidField::new(field, reason))
            }
        }
    }

    /// A single face, below 6.
    pub fn only(face: usize) -> Self {
        Self(1 << face & Self::ALL.0)
    }

    /// Bit i stands for face i.
    pub fn bits(self) -> u32 {
        self.0.into()
    }

    /// Whether it has that face.
    pub fn has(self, face: usize) -> bool {
        self.contains(Self::only(face))
    }

    /// Whether it has all faces of another mask.
    pub fn contains(self, other: Self) -> bool {
        other.0 & !self.0 == 0
    }

    /// The faces of either mask.
    pub fn union(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// The faces that another mask lacks.
    pub fn without(self, other: Self) -> Self {
        Self(self.0 & !other.0)
    }

    /// Whether it has no face.
    pub fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// Share of a whole sample that it is: what rendering its faces costs, as a share of rendering all.
    pub fn share(self) -> f64 {
        f64::from(self.0.count_ones()) / f64::from(FACES)
    }

    /// The faces of a camera that look in a direction, which has any length: the face that has it, and those whose border
    /// is near. The ring of texels around a face counts as near whatever its width, since fetches beside a border read it.
    pub fn around(camera: &SampleCamera, direction: DVec3) -> Self {
        let SampleCamera::Omni { layout: OmniLayout::CubeFaces { face }, .. } = *camera else {
            return Self::ALL;
        };
        let extent = (f64::from(face) / (f64::from(face) - 2.0)).max(1.0 + MARGIN);
        let a = direction.abs();
        let axes = [(a.x, a.y.max(a.z)), (a.y, a.z.max(a.x)), (a.z, a.x.max(a.y))];
        let mut touched = Self::NONE;
        for (axis, (along, across)) in axes.into_iter().enumerate() {
            if along > 0.0 && across <= extent * along {
                let is_negative = direction[axis] < 0.0;
                touched = touched.union(Self::only(2 * axis + usize::from(is_negative)));
            }
        }
        touched
    }

    /// The mask for a sample of a camera: a single image is whole or nothing.
    pub fn of_camera(self, camera: &SampleCamera) -> Self {
        let is_cube = matches!(camera, SampleCamera::Omni { layout: OmniLayout::CubeFaces { .. }, .. });
        if is_cube || self.is_empty() { self } else { Self::ALL }
    }
}

impl From<FaceMask> for u32 {
    fn from(mask: FaceMask) -> Self {
        mask.bits()
    }
}

impl TryFrom<u32> for FaceMask {
    type Error = InvalidField;

    fn try_from(bits: u32) -> Result<Self, InvalidField> {
        Self::new(bits, "faces")
    }
}

/// The faces of some of a rig's cameras; of all other cameras all faces.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(from = "BTreeMap<u64, FaceMask>", into = "BTreeMap<u64, FaceMask>")]
pub struct FaceMasks(BTreeMap<u64, FaceMask>);

impl FaceMasks {
    /// The faces of a camera.
    pub fn of(&self, camera: u64) -> FaceMask {
        self.0.get(&camera).copied().unwrap_or(FaceMask::ALL)
    }

    /// Whether all cameras have all faces.
    pub fn are_all(&self) -> bool {
        self.0.is_empty()
    }

    /// The cameras that lack faces, with the faces that they have.
    pub fn partial(&self) -> impl Iterator<Item = (u64, FaceMask)> {
        self.0.iter().map(|(camera, faces)| (*camera, *faces))
    }
}

impl FromIterator<(u64, FaceMask)> for FaceMasks {
    fn from_iter<T: IntoIterator<Item = (u64, FaceMask)>>(masks: T) -> Self {
        Self(masks.into_iter().filter(|(_, faces)| *faces != FaceMask::ALL).collect())
    }
}

impl From<BTreeMap<u64, FaceMask>> for FaceMasks {
    fn from(masks: BTreeMap<u64, FaceMask>) -> Self {
        masks.into_iter().collect()
    }
}

impl From<FaceMasks> for BTreeMap<u64, FaceMask> {
    fn from(masks: FaceMasks) -> Self {
        masks.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Camera;

    fn cube(face: u32) -> SampleCamera {
        SampleCamera::Omni { center: DVec3::ZERO, layout: OmniLayout::CubeFaces { face } }
    }

    fn around(direction: [f64; 3]) -> u32 {
        FaceMask::around(&cube(512), DVec3::from(direction)).bits()
    }

    #[test]
    fn a_mask_of_no_face_is_refused_by_its_field() {
        for bits in [0, 1 << 6, 0xff, 0x100, u32::MAX] {
            assert_eq!(
                FaceMask::new(bits, "plan.warp.faces").unwrap_err().field,
                "plan.warp.faces",
                "{bits}"
            );
        }
        for bits in 1..=FaceMask::ALL.bits() {
            assert_eq!(FaceMask::new(bits, "faces").unwrap().bits(), bits);
        }
        assert_eq!(FaceMask::try_from(0).unwrap_err().field, "faces");
    }

    #[test]
    fn a_direction_along_an_edge_or_a_corner_touches_all_faces_there() {
        assert_eq!(around([1.0, 0.0, 0.0]), 0b1);
        assert_eq!(around([0.0, -2.0, 0.1]), 0b1000);
        assert_eq!(around([1.0, 1.0, 0.0]), 0b101, "an edge");
        assert_eq!(around([-1.0, 1.0, 1.0]), 0b01_0110, "a corner");
        assert_eq!(around([-1.0, -1.0, -1.0]), 0b10_1010);
        assert_eq!(around([1.0, 0.0, 1.0 + 1e-12]), 0b01_0001, "beside an edge by less than rounding in f32");
        assert_eq!(around([0.0; 3]), 0, "no direction");
        assert_eq!(around([f64::NAN; 3]), 0);
    }

    #[test]
    fn a_direction_within_the_ring_of_a_face_touches_it() {
        // Faces of 8 texels: the ring is a sixth of the extent, wider than the margin.
        let ring = cube(8).faces()[0].tan_half_fov.x;
        let at = |across: f64| FaceMask::around(&cube(8), DVec3::new(1.0, across, 0.0)).bits();
        assert_eq!([at(ring - 1e-9), at(1.0 / (ring - 1e-9))], [0b101; 2]);
        assert_eq!(at(1.0 / (ring + 1e-9)), 0b1);
    }

    #[test]
    fn a_single_image_is_whole_or_nothing() {
        let camera = Camera::look_at(DVec3::ZERO, DVec3::X);
        let single = SampleCamera::Perspective { camera, width: 4, height: 3 };
        assert_eq!(FaceMask::around(&single, DVec3::X), FaceMask::ALL);
        assert_eq!(FaceMask::only(0).of_camera(&single), FaceMask::ALL);
        assert_eq!(FaceMask::NONE.of_camera(&single), FaceMask::NONE);
        assert_eq!(FaceMask::only(3).of_camera(&cube(8)), FaceMask::only(3));
    }

    #[test]
    fn cameras_without_a_mask_have_all_faces() {
        let masks: FaceMasks = [(3, FaceMask::only(1)), (4, FaceMask::ALL)].into_iter().collect();
        assert_eq!(
            [3, 4, 5].map(|camera| masks.of(camera)),
            [FaceMask::only(1), FaceMask::ALL, FaceMask::ALL]
        );
        assert!(!masks.are_all() && FaceMasks::default().are_all());
        let read = BTreeMap::from([(3, FaceMask::only(1)), (4, FaceMask::ALL)]);
        assert_eq!(FaceMasks::from(read), masks);
    }
}
