//! Faces, grouped by material.

use std::collections::HashMap;

use glam::DVec3;

use super::text::words;
use crate::load::polygon::triangulate;

/// A corner of a face: indices into the file's arrays, from zero and in range.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) struct Corner {
    pub(super) position: u32,
    pub(super) uv: Option<u32>,
    pub(super) normal: Option<u32>,
    /// For corners without a normal: corners with the same number are smoothed together. It is the smoothing group,
    /// or else a number of the face's own.
    smooth: u64,
}

/// The faces of one material.
#[derive(Debug, Default)]
pub(super) struct Group {
    pub(super) material: Option<String>,
    pub(super) corners: Vec<Corner>,
    pub(super) indices: Vec<u32>,
    pub(super) has_uvs: bool,
    known: HashMap<Corner, u32>,
}

/// All faces so far, and the state for the next one.
#[derive(Debug, Default)]
pub(super) struct Groups {
    groups: Vec<Group>,
    by_material: HashMap<Option<String>, usize>,
    material: Option<String>,
    current: Option<usize>,
    smoothing: u64,
    faces: u64,
    /// Reused for every face, so that no face allocates.
    face: Vec<Corner>,
    outline: Vec<DVec3>,
}

impl Groups {
    pub(super) fn use_material(&mut self, name: &str) {
        self.material = (!name.is_empty()).then(|| name.to_owned());
        self.current = None;
    }

    pub(super) fn smooth(&mut self, rest: &[u8]) {
        let number = std::str::from_utf8(rest).ok().and_then(|text| text.parse::<u32>().ok());
        self.smoothing = number.map_or(0, u64::from);
    }

    /// Adds the face of a line; `false` if it has fewer than three corners or an invalid vertex. Invalid texture
    /// coordinates and normals are left out.
    pub(super) fn add_face(&mut self, rest: &[u8], positions: &[DVec3], uvs: usize, normals: usize) -> bool {
        self.face.clear();
        self.outline.clear();
        self.faces += 1;
        // Faces have numbers above all smoothing groups.
        let alone = self.faces + (1 << 32);
        let smooth = if self.smoothing == 0 { alone } else { self.smoothing };
        for word in words(rest).take_while(|word| !word.starts_with(b"#")) {
            let mut parts = word.split(|&b| b == b'/');
            let mut index = |count: usize| parts.next().and_then(|part| resolve(part, count));
            let Some(position) = index(positions.len()) else { return false };
            let (uv, normal) = (index(uvs), index(normals));
            let smooth = if normal.is_some() { 0 } else { smooth };
            self.face.push(Corner { position, uv, normal, smooth });
            self.outline.push(positions[position as usize]);
        }
        if self.face.len() < 3 {
            return false;
        }
        let current = match self.current {
            Some(current) => current,
            None => {
                let count = self.groups.len();
                let current = *self.by_material.entry(self.material.clone()).or_insert(count);
                if current == count {
                    self.groups.push(Group { material: self.material.clone(), ..Group::default() });
                }
                self.current = Some(current);
                current
            }
        };
        let group = &mut self.groups[current];
        let Group { corners, indices, has_uvs, known, .. } = group;
        *has_uvs |= self.face.iter().any(|corner| corner.uv.is_some());
        let face = &self.face;
        triangulate(&self.outline, |triangle| {
            for k in triangle {
                let next = corners.len() as u32;
                let index = *known.entry(face[k]).or_insert(next);
                if index == next {
                    corners.push(face[k]);
                }
                indices.push(index);
            }
        });
        true
    }

    pub(super) fn into_meshes(self) -> Vec<Group> {
        self.groups
    }
}

/// An index in file notation: from one, or from the end if negative. `None` if it is out of range.
fn resolve(part: &[u8], count: usize) -> Option<u32> {
    let written: i64 = std::str::from_utf8(part).ok()?.parse().ok()?;
    let index = if written < 0 { i64::try_from(count).ok()?.checked_add(written)? } else { written - 1 };
    u32::try_from(index).ok().filter(|&index| (index as usize) < count)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn indices_count_from_one_or_backwards_and_never_leave_the_array() {
        assert_eq!(resolve(b"1", 3), Some(0));
        assert_eq!(resolve(b"-1", 3), Some(2));
        assert_eq!(resolve(b"-3", 3), Some(0));
        for bad in ["0", "4", "-4", "", "x", "9223372036854775807", "-9223372036854775808", "1e3"] {
            assert_eq!(resolve(bad.as_bytes(), 3), None, "{bad}");
        }
    }

    #[test]
    fn mixed_forms_share_what_they_can() {
        let positions = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::ONE];
        let mut groups = Groups::default();
        assert!(groups.add_face(b"1 2/1 3//1 4/9/9", &positions, 1, 1));
        assert!(!groups.add_face(b"1 2", &positions, 1, 1));
        assert!(!groups.add_face(b"1 2 5", &positions, 1, 1));
        let group = groups.into_meshes().pop().unwrap();
        assert_eq!(group.indices.len(), 6);
        assert_eq!(group.corners.len(), 4);
        assert_eq!(group.corners[1].uv, Some(0));
        assert_eq!(group.corners[3].uv, None);
    }

    #[test]
    fn smoothing_groups_share_corners_and_single_faces_do_not() {
        let positions = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::ONE];
        let corners = |state: &[u8]| {
            let mut groups = Groups::default();
            groups.smooth(state);
            groups.add_face(b"1 2 3", &positions, 0, 0);
            groups.add_face(b"2 4 3", &positions, 0, 0);
            groups.into_meshes()[0].corners.len()
        };
        assert_eq!(corners(b"1"), 4);
        assert_eq!(corners(b"off"), 6);
        assert_eq!(corners(b"0"), 6);
    }
}
