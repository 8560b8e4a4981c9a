//! Lists of rays: images whose pixels look where a client says, like a lidar's scan.

use std::sync::Arc;

use glam::{DVec3, Vec3};
use serde::{Deserialize, Serialize};

use crate::InvalidField;

/// The directions of a view's pixels, row by row, in world axes. All rays begin at the camera's eye.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Vec<Vec3>", into = "Vec<Vec3>")]
pub struct RayList(Arc<[Vec3]>);

impl RayList {
    /// Most rays of a view. Longer scans are asked for in parts.
    pub const MOST: usize = 1 << 16;

    /// Angle between neighbours where a list has none, degrees.
    pub const USUAL_SPACING_DEG: f64 = 0.25;

    /// A list of directions of any length. A pixel whose direction is zero has no ray.
    ///
    /// # Errors
    /// `rays` for none, too many, or a number that is not finite.
    pub fn new(directions: Vec<Vec3>) -> Result<Self, InvalidField> {
        let count = directions.len();
        if !(1..=Self::MOST).contains(&count) {
            let reason = format!(
                "must be 1 to {} directions, not {count}; send the rest in further requests",
                Self::MOST
            );
            return Err(InvalidField::new("rays", reason));
        }
        match directions.iter().position(|direction| !direction.is_finite()) {
            Some(at) => {
                let reason = format!("direction {at} must be finite, not {}", directions[at]);
                Err(InvalidField::new("rays", reason))
            }
            None => Ok(Self(directions.into())),
        }
    }

    /// The directions, as they were given.
    pub fn directions(&self) -> &[Vec3] {
        &self.0
    }

    /// Unit direction of a ray; `None` if there is none, or its direction is zero.
    pub fn direction(&self, index: usize) -> Option<DVec3> {
        // Scaled first, since the squares of small and of large numbers do not fit.
        let direction = self.0.get(index)?.as_dvec3();
        (direction / direction.abs().max_element()).try_normalize()
    }

    /// The median angle between neighbours of a row, degrees; of a column, if rows have one ray.
    pub fn spacing_deg(&self, width: u32) -> f64 {
        let row = if width > 1 { width as usize } else { self.0.len() };
        let angle = |at: usize| {
            let [a, b] = [self.direction(at)?, self.direction(at + 1)?];
            // Exact for small angles, unlike the arc cosine.
            let angle = a.cross(b).length().atan2(a.dot(b));
            (angle > 0.0).then_some(angle.to_degrees())
        };
        let mut angles: Vec<f64> =
            (0..self.0.len().saturating_sub(1)).filter(|at| (at + 1) % row != 0).filter_map(angle).collect();
        angles.sort_by(f64::total_cmp);
        angles.get(angles.len() / 2).copied().unwrap_or(Self::USUAL_SPACING_DEG)
    }
}

impl TryFrom<Vec<Vec3>> for RayList {
    type Error = InvalidField;

    fn try_from(directions: Vec<Vec3>) -> Result<Self, InvalidField> {
        Self::new(directions)
    }
}

impl From<RayList> for Vec<Vec3> {
    fn from(list: RayList) -> Self {
        list.0.to_vec()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directions_of_any_length_are_normalised_and_zero_is_no_ray() {
        let list = RayList::new(vec![Vec3::X * 1e-38, Vec3::Y * 3e38, Vec3::ZERO]).unwrap();
        assert_eq!(list.direction(0), Some(DVec3::X));
        assert_eq!(list.direction(1), Some(DVec3::Y));
        assert_eq!((list.direction(2), list.direction(3)), (None, None));
    }

    #[test]
    fn no_rays_too_many_and_numbers_that_are_not_finite_are_refused() {
        for (directions, words) in [
            (vec![], "1 to 65536"),
            (vec![Vec3::X; RayList::MOST + 1], "not 65537"),
            (vec![Vec3::X, Vec3::NAN], "direction 1"),
            (vec![Vec3::splat(f32::INFINITY)], "direction 0"),
        ] {
            let refused = RayList::new(directions).unwrap_err();
            assert_eq!(refused.field, "rays");
            assert!(refused.reason.contains(words), "{}", refused.reason);
        }
    }

    #[test]
    fn spacing_is_the_usual_angle_between_neighbours_of_a_row() {
        let at = |degrees: f32| Vec3::new(degrees.to_radians().cos(), degrees.to_radians().sin(), 0.0);
        // Two rows, ten degrees apart.
        let list = RayList::new(vec![at(0.0), at(0.5), at(1.0), at(10.0), at(10.5), at(11.0)]).unwrap();
        assert!((list.spacing_deg(3) - 0.5).abs() < 1e-4);
        assert!((list.spacing_deg(1) - 0.5).abs() < 1e-4);
        let alike = RayList::new(vec![Vec3::X; 4]).unwrap();
        for list in [alike, RayList::new(vec![Vec3::X]).unwrap()] {
            assert_eq!(list.spacing_deg(4), RayList::USUAL_SPACING_DEG);
        }
    }
}
