//! Rigs: the rules that place sample cameras.
//!
//! A rig is a pure function from an index to a camera, known to every process, so that an order for a
//! sample is two numbers and no process needs another's word for where a sample was taken.

use glam::{DVec3, IVec3};
use serde::{Deserialize, Serialize};

use crate::scene::RigKind;
use crate::{Bounds, Camera, InvalidField, OmniLayout, SampleCamera, Scene};

/// Where sample cameras stand.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub enum Rig {
    /// The cluster paper's (section 4, figure 3): the ground is divided into tiles, and four cameras above
    /// the corners of each look at its centre. Index 4·tile + corner.
    TileCorners {
        /// Box around the scene; tiles divide its x and z.
        bounds: Bounds,
        /// Tiles along x and z.
        tiles: [u32; 2],
        /// Height of the cameras above the box's top, as a multiple of half a tile's longer edge.
        height: f64,
        /// Texels of a sample: width, height.
        size: [u32; 2],
    },
    /// Omni cameras on a lattice; a viewpoint is served by the corners of the cell it is in. The index packs
    /// the corner's three lattice coordinates, 21 bits each.
    Cell {
        /// Where lattice coordinate (0, 0, 0) lies.
        origin: DVec3,
        /// Edge of a cell, metres.
        spacing: f64,
        /// Side of a cube face in texels.
        face: u32,
    },
}

/// What a user may say about a rig; what is left open follows from the scene.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct RigKnobs {
    /// Rule.
    pub kind: Option<RigKind>,
    /// Tiles along x and z, [`Rig::TileCorners`].
    pub tiles: Option<[u32; 2]>,
    /// Texels of a sample, [`Rig::TileCorners`].
    pub size: Option<[u32; 2]>,
    /// Edge of a cell, metres, [`Rig::Cell`].
    pub spacing: Option<f64>,
    /// Side of a cube face in texels, [`Rig::Cell`].
    pub face: Option<u32>,
}

/// Lattice coordinates are stored with this offset, in 21 bits.
const LATTICE_BIAS: i32 = 1 << 20;

impl Rig {
    /// The rig for a scene: the paper's 400×300 cameras over one tile, or cells a sixteenth as long as the
    /// scene is wide.
    ///
    /// # Errors
    /// A knob that is out of range, by name.
    pub fn for_scene(scene: &Scene, knobs: &RigKnobs) -> Result<Self, InvalidField> {
        let bounds = scene.bounds();
        let extent = bounds.size().max_element().max(1e-6);
        let rig = match knobs.kind.unwrap_or(scene.rig) {
            RigKind::TileCorners => Self::TileCorners {
                bounds,
                tiles: knobs.tiles.unwrap_or([1, 1]),
                height: 1.0,
                size: knobs.size.unwrap_or([400, 300]),
            },
            RigKind::Cell => Self::Cell {
                origin: bounds.center(),
                spacing: knobs.spacing.unwrap_or(extent / 16.0),
                face: knobs.face.unwrap_or(512),
            },
        };
        rig.validate()?;
        Ok(rig)
    }

    /// Rejects rigs that place no camera.
    pub fn validate(&self) -> Result<(), InvalidField> {
        let check = |ok, field, reason: &str| if ok { Ok(()) } else { Err(InvalidField::new(field, reason)) };
        match *self {
            Self::TileCorners { bounds, tiles: [x, z], height, size: [w, h] } => {
                check(!bounds.is_empty(), "rig.bounds", "the scene is empty")?;
                check((1..=1024).contains(&x) && (1..=1024).contains(&z), "rig.tiles", "must be 1 to 1024")?;
                check(height > 0.0 && height < 1e6, "rig.height", "must be above 0 and below a million")?;
                check((1..=8192).contains(&w) && (1..=8192).contains(&h), "rig.size", "must be 1 to 8192")
            }
            Self::Cell { origin, spacing, face } => {
                check(origin.is_finite(), "rig.origin", "must be finite")?;
                check(spacing > 0.0 && spacing.is_finite(), "rig.spacing", "must be above 0 and finite")?;
                check((8..=2048).contains(&face), "rig.face", "must be 8 to 2048 texels")
            }
        }
    }

    /// The camera of an index.
    ///
    /// # Errors
    /// `sample.index` where the rig has no such camera.
    pub fn camera(&self, index: u64) -> Result<SampleCamera, InvalidField> {
        let unknown = || InvalidField::new("sample.index", format!("this rig has no camera {index}"));
        match *self {
            Self::TileCorners { tiles, size: [width, height_px], .. } => {
                if index >= 4 * u64::from(tiles[0]) * u64::from(tiles[1]) {
                    return Err(unknown());
                }
                let (tile, corner) = (index / 4, index % 4);
                let bounds = self.tile_bounds(tile);
                let eye = self.tile_corner(bounds, corner);
                let mut camera = Camera::look_at(eye, bounds.center());
                camera.fov_deg = fov_around(&camera, bounds, width, height_px);
                Ok(SampleCamera::Perspective { camera, width, height: height_px })
            }
            Self::Cell { origin, spacing, face } => {
                let c = lattice_from_index(index).ok_or_else(unknown)?;
                let center = origin + c.as_dvec3() * spacing;
                Ok(SampleCamera::Omni { center, layout: OmniLayout::CubeFaces { face } })
            }
        }
    }

    /// The `count` cameras that serve a viewpoint best, best first; fewer where the rig has fewer. Always the
    /// same for the same camera.
    pub fn nearest(&self, camera: &Camera, count: usize) -> Vec<u64> {
        let mut ranked: Vec<(f64, u64)> = match *self {
            Self::TileCorners { tiles, .. } => {
                let tile = self.tile_looked_at(camera);
                let bounds = self.tile_bounds(tile);
                // The smaller the angle at the tile's centre between eye and sample camera, the more of the
                // same surfaces both see.
                let to_eye = (camera.eye - bounds.center()).normalize_or(DVec3::Y);
                let angle = |eye: DVec3| -to_eye.dot((eye - bounds.center()).normalize_or(DVec3::Y));
                debug_assert!(tile < u64::from(tiles[0]) * u64::from(tiles[1]));
                (0..4).map(|corner| (angle(self.tile_corner(bounds, corner)), 4 * tile + corner)).collect()
            }
            Self::Cell { origin, spacing, .. } => {
                let limit = f64::from(LATTICE_BIAS - 2);
                let at = ((camera.eye - origin) / spacing).clamp(DVec3::splat(-limit), DVec3::splat(limit));
                let base = at.floor().as_ivec3();
                (0..8)
                    .map(|i| {
                        let corner = base + IVec3::new(i & 1, (i >> 1) & 1, i >> 2);
                        ((corner.as_dvec3() - at).length_squared(), index_from_lattice(corner))
                    })
                    .collect()
            }
        };
        ranked.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        ranked.into_iter().take(count).map(|(_, index)| index).collect()
    }

    /// Box of one tile, the scene's full height.
    fn tile_bounds(&self, tile: u64) -> Bounds {
        let Self::TileCorners { bounds, tiles, .. } = *self else { return Bounds::EMPTY };
        let size = bounds.size() / DVec3::new(f64::from(tiles[0]), 1.0, f64::from(tiles[1]));
        let columns = u64::from(tiles[0]);
        let min = bounds.min + size * DVec3::new((tile % columns) as f64, 0.0, (tile / columns) as f64);
        Bounds { min, max: min + size }
    }

    /// Where the camera above one corner of a tile stands.
    fn tile_corner(&self, tile: Bounds, corner: u64) -> DVec3 {
        let Self::TileCorners { height, .. } = *self else { return DVec3::ZERO };
        let size = tile.size();
        let above = 0.5 * height * size.x.max(size.z).max(size.y * 0.5).max(1e-6);
        let x = if corner & 1 == 0 { tile.min.x } else { tile.max.x };
        let z = if corner & 2 == 0 { tile.min.z } else { tile.max.z };
        DVec3::new(x, tile.max.y + above, z)
    }

    /// The tile that a camera's optical axis meets at half the scene's height, or the one closest to that.
    fn tile_looked_at(&self, camera: &Camera) -> u64 {
        let Self::TileCorners { bounds, tiles, .. } = *self else { return 0 };
        let axis = (camera.target - camera.eye).normalize_or(DVec3::NEG_Y);
        let drop = bounds.center().y - camera.eye.y;
        let reach = bounds.size().length();
        let t = if axis.y.abs() > 1e-6 && drop / axis.y > 0.0 {
            (drop / axis.y).min(reach)
        } else {
            reach * 0.25
        };
        let at = camera.eye + axis * t;
        let cell = |x: f64, min: f64, max: f64, n: u32| {
            let f = (x - min) / (max - min).max(1e-12) * f64::from(n);
            (f.max(0.0) as u64).min(u64::from(n) - 1)
        };
        let x = cell(at.x, bounds.min.x, bounds.max.x, tiles[0]);
        let z = cell(at.z, bounds.min.z, bounds.max.z, tiles[1]);
        z * u64::from(tiles[0]) + x
    }
}

/// The smallest vertical field of view, degrees, within which an image of `width` × `height` pixels shows
/// the whole box; at most 150° where the camera is too close.
fn fov_around(camera: &Camera, bounds: Bounds, width: u32, height: u32) -> f64 {
    let view_from_world = camera.view_from_world();
    let aspect = f64::from(width) / f64::from(height);
    let mut tangent: f64 = 1e-3;
    for i in 0..8 {
        let pick = |bit: i32, min: f64, max: f64| if i & bit == 0 { min } else { max };
        let corner = DVec3::new(
            pick(1, bounds.min.x, bounds.max.x),
            pick(2, bounds.min.y, bounds.max.y),
            pick(4, bounds.min.z, bounds.max.z),
        );
        let p = view_from_world * (corner - camera.eye);
        let depth = (-p.z).max(1e-9);
        tangent = tangent.max((p.y / depth).abs()).max((p.x / depth).abs() / aspect);
    }
    // A margin of 1%, so that the border's texels are inside the image.
    (2.0 * (tangent * 1.01).atan()).to_degrees().min(150.0)
}

/// Packs lattice coordinates, each within ±(2²⁰ − 1), into an index.
fn index_from_lattice(c: IVec3) -> u64 {
    let pack = |v: i32| (v + LATTICE_BIAS) as u64 & 0x1f_ffff;
    pack(c.x) | pack(c.y) << 21 | pack(c.z) << 42
}

/// Inverse of [`index_from_lattice`]; `None` for what it never makes.
fn lattice_from_index(index: u64) -> Option<IVec3> {
    let unpack = |shift: u32| ((index >> shift) & 0x1f_ffff) as i32 - LATTICE_BIAS;
    (index >> 63 == 0).then(|| IVec3::new(unpack(0), unpack(21), unpack(42)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tile() -> Rig {
        let bounds = Bounds { min: DVec3::new(-50.0, 0.0, -50.0), max: DVec3::new(50.0, 20.0, 50.0) };
        Rig::TileCorners { bounds, tiles: [2, 3], height: 1.0, size: [400, 300] }
    }

    fn cell() -> Rig {
        Rig::Cell { origin: DVec3::new(1.0, 2.0, 3.0), spacing: 2.0, face: 64 }
    }

    #[test]
    fn a_tiles_cameras_see_all_of_its_box() {
        let rig = tile();
        for index in 0..24 {
            let SampleCamera::Perspective { camera, width, height } = rig.camera(index).unwrap() else {
                panic!("tile cameras are perspective")
            };
            camera.validate().unwrap();
            let bounds = rig.tile_bounds(index / 4);
            let half = camera.tan_half_fov(width, height);
            for corner in [bounds.min, bounds.max] {
                let p = camera.view_from_world() * (corner - camera.eye);
                assert!(p.z < 0.0 && (p.truncate() / -p.z).abs().cmple(half).all(), "camera {index}");
            }
        }
        assert_eq!(rig.camera(24).unwrap_err().field, "sample.index");
    }

    #[test]
    fn the_corner_above_the_eye_is_the_best_one() {
        let rig = tile();
        let bounds = rig.tile_bounds(5);
        let SampleCamera::Perspective { camera, .. } = rig.camera(4 * 5 + 3).unwrap() else { panic!() };
        let view = Camera::look_at(camera.eye + DVec3::splat(0.1), bounds.center());
        let nearest = rig.nearest(&view, 4);
        assert_eq!(nearest[0], 4 * 5 + 3);
        assert_eq!(nearest.len(), 4);
    }

    #[test]
    fn lattice_corners_surround_the_eye_and_survive_packing() {
        let rig = cell();
        let view = Camera::look_at(DVec3::new(-7.3, 4.1, 3.0), DVec3::ZERO);
        let nearest = rig.nearest(&view, 8);
        assert_eq!(nearest.len(), 8);
        for index in nearest {
            let center = rig.camera(index).unwrap().center();
            assert!((center - view.eye).abs().max_element() <= 2.0, "{center}");
        }
        for c in [IVec3::ZERO, IVec3::splat(-LATTICE_BIAS), IVec3::new(LATTICE_BIAS - 1, -5, 7)] {
            assert_eq!(lattice_from_index(index_from_lattice(c)), Some(c));
        }
        assert_eq!(lattice_from_index(u64::MAX), None);
    }

    #[test]
    fn viewpoints_on_cell_borders_and_absurdly_far_away_still_have_samples() {
        let rig = cell();
        for eye in [DVec3::new(1.0, 2.0, 3.0), DVec3::splat(1e6), DVec3::splat(-1e12), DVec3::splat(f64::MAX)]
        {
            let view = Camera::look_at(eye, eye + DVec3::X);
            assert_eq!(rig.nearest(&view, 4).len(), 4);
        }
    }
}
