//! Transforms of nodes.

use std::sync::Arc;

use argus_scene::{InvalidField, Transforms};
use glam::{DAffine3, DMat3, DVec3};

use super::known;
use crate::v1;

/// Numbers of a matrix without its last row, and with it.
const WITHOUT_LAST_ROW: usize = 12;
const WHOLE: usize = 16;

/// Reads a matrix row by row: 16 numbers, or 12 without the last row, which must be 0 0 0 1.
///
/// # Errors
/// How many numbers there are, or what the last row is.
pub fn affine(numbers: &[f64]) -> Result<DAffine3, String> {
    let rows = match numbers.len() {
        WITHOUT_LAST_ROW | WHOLE => &numbers[..WITHOUT_LAST_ROW],
        other => {
            return Err(format!("its matrix has {other} numbers; give 16 (4x4) or 12 (3x4), row by row"));
        }
    };
    let last = &numbers[WITHOUT_LAST_ROW..];
    if !last.is_empty() && last != [0.0, 0.0, 0.0, 1.0] {
        return Err(format!(
            "the last row of its matrix is {last:?}; it must be 0 0 0 1: give the matrix row by row, the translation in \
             the last column"
        ));
    }
    let column = |at: usize| DVec3::new(rows[at], rows[4 + at], rows[8 + at]);
    Ok(DAffine3 { matrix3: DMat3::from_cols(column(0), column(1), column(2)), translation: column(3) })
}

/// The 12 numbers of a matrix without its last row, row by row.
pub fn rows_of(matrix: &DAffine3) -> Vec<f64> {
    let DAffine3 { matrix3, translation } = matrix;
    let row = |at: usize| [matrix3.x_axis[at], matrix3.y_axis[at], matrix3.z_axis[at], translation[at]];
    [0, 1, 2].into_iter().flat_map(row).collect()
}

/// Whether a matrix leads to the world, and not to the parent.
///
/// # Errors
/// No space has this number.
pub fn space_is_world(number: i32, field: &'static str) -> Result<bool, InvalidField> {
    Ok(known::<v1::Space>(number, field)? == v1::Space::World)
}

impl From<&Transforms> for v1::Transforms {
    fn from(transforms: &Transforms) -> Self {
        let node = |(&node, matrix): (&u32, &DAffine3)| v1::NodeTransform {
            node,
            parent_from_node: rows_of(matrix),
        };
        Self { revision: transforms.revision, nodes: transforms.parent_from_node.iter().map(node).collect() }
    }
}

impl TryFrom<v1::Transforms> for Transforms {
    type Error = InvalidField;

    fn try_from(wire: v1::Transforms) -> Result<Self, InvalidField> {
        const FIELD: &str = "transforms.nodes.parent_from_node";
        let node = |node: v1::NodeTransform| {
            let matrix = affine(&node.parent_from_node).map_err(|reason| InvalidField::new(FIELD, reason))?;
            argus_scene::transforms::check_transform(FIELD, &node.node.to_string(), &matrix)?;
            Ok((node.node, matrix))
        };
        let most = argus_scene::transforms::MOST_MOVERS;
        InvalidField::within("transforms.nodes", wire.nodes.len(), 0..=most)?;
        Ok(Self {
            revision: wire.revision,
            parent_from_node: wire.nodes.into_iter().map(node).collect::<Result<_, InvalidField>>()?,
        })
    }
}

/// A state of transforms as processes share it.
///
/// # Errors
/// A field is invalid.
pub fn shared_transforms(wire: v1::Transforms) -> Result<Arc<Transforms>, InvalidField> {
    Transforms::try_from(wire).map(Arc::new)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_matrix_is_read_row_by_row_with_or_without_its_last_row() {
        let rows: Vec<f64> = (0..12).map(f64::from).collect();
        let matrix = affine(&rows).unwrap();
        assert_eq!(matrix.transform_point3(DVec3::ZERO), DVec3::new(3.0, 7.0, 11.0));
        assert_eq!(matrix.transform_vector3(DVec3::X), DVec3::new(0.0, 4.0, 8.0));
        assert_eq!(affine(&[&rows[..], &[0.0, 0.0, 0.0, 1.0]].concat()), Ok(matrix));
        assert_eq!(rows_of(&matrix), rows);
        assert!(affine(&rows[..9]).unwrap_err().contains("9 numbers"));
        assert!(affine(&[&rows[..], &[1.0, 2.0, 3.0, 1.0]].concat()).unwrap_err().contains("last row"));
    }

    #[test]
    fn transforms_travel_unchanged_and_bad_ones_are_refused() {
        let moved = DAffine3::from_scale_rotation_translation(
            DVec3::new(1.0, 2.0, 3.0),
            glam::DQuat::from_rotation_y(0.3),
            DVec3::new(0.1, 1e6, -7.0),
        );
        let transforms =
            Transforms { revision: 1 << 50, parent_from_node: [(7, moved), (9, DAffine3::IDENTITY)].into() };
        assert_eq!(Transforms::try_from(v1::Transforms::from(&transforms)).unwrap(), transforms);
        let mut wire = v1::Transforms::from(&transforms);
        wire.nodes[0].parent_from_node[5] = f64::NAN;
        assert!(Transforms::try_from(wire).unwrap_err().reason.contains("node 7"));
        assert!(space_is_world(2, "space").unwrap() && !space_is_world(0, "space").unwrap());
        assert_eq!(space_is_world(9, "space").unwrap_err().field, "space");
    }
}
