//! Rigs: the rules that place sample cameras.
//!
//! A rig is a pure function from an index to a camera, known to every process. So a request for a sample is two numbers,
//! and every process knows the sample's camera.
//!
//! Beside its own cameras a rig has *refinements*: cameras of the same kind, denser at each level. They fill pixels that
//! the rig's own samples do not see.

pub(crate) mod coverage_estimate;
mod judged;
mod lattice;
mod renewal;
mod sight;
pub(crate) mod target;
mod tile;

use glam::{DVec3, IVec3};
use serde::{Deserialize, Serialize};

pub use self::coverage_estimate::{Coverage, CoverageEstimate};
pub use self::lattice::MAX_LEVEL;
use self::lattice::Point;
pub use self::sight::{CandidateCameras, VisibilityQuery};
pub use self::target::Target;
use self::tile::Tile;
use crate::scene::RigKind;
use crate::{Bounds, Camera, InvalidField, OmniLayout, SampleCamera, Scene};

/// The placement of sample cameras.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub enum Rig {
    /// The cluster paper's rig (section 4, figure 3): the ground is divided into tiles, and four cameras above the
    /// corners of each look at its centre. Index: 4·tile + corner.
    TileCorners {
        /// The scene's extent; tiles divide its x and z.
        bounds: Bounds,
        /// Tiles along x and z.
        tiles: [u32; 2],
        /// Height of the cameras above the box's top, as a multiple of half a tile's longer edge.
        height: f64,
        /// Texels of a sample: width, height.
        size: [u32; 2],
    },
    /// Omni cameras on a lattice; a viewpoint is served by the corners of its cell. Further levels are the points of
    /// lattices with half the spacing, a quarter, and so on. A viewer who sees only what is near is served by a finer
    /// level, and one who sees only what is far by every second point, every fourth, and so on ([`Rig::own_level`]).
    /// Refinements are levels finer than a viewer's own. The index packs a point's three coordinates, 20 bits each, and
    /// its level.
    Cell {
        /// Position of lattice coordinate (0, 0, 0).
        origin: DVec3,
        /// Edge of a cell, metres.
        spacing: f64,
        /// Side of a cube face in texels.
        face: u32,
    },
}

/// A user's settings of a rig; unset ones follow from the scene.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct RigSettings {
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

/// Least number of cameras around a viewpoint that are tested for their visibility of a view.
const CANDIDATES: usize = 16;

/// The finest level that may serve viewers as their own; refinements of it fit into an index.
const FINEST_OWN: u32 = lattice::FINEST - MAX_LEVEL;

/// The number of doublings of the spacing of level 0 that may serve viewers as their own.
const COARSEST_OWN: i32 = 12;

/// Least distance of what a viewer sees, in spacings of the lattice that serves it. Views of Sponza and of a scene of its
/// proportions, from which the default spacing was chosen, have 3 on average.
const LEAST_RANGE: f64 = 1.5;

/// Greatest such distance. Viewers who see a scene's extent as a whole, from outside, have up to 37.
const MOST_RANGE: f64 = 48.0;

impl Rig {
    /// The rig for a scene: the paper's 400×300 cameras over one tile, or cells a sixteenth of the extent of what
    /// viewers look at.
    ///
    /// # Errors
    /// A setting that is out of range, by name.
    pub fn for_scene(scene: &Scene, settings: &RigSettings) -> Result<Self, InvalidField> {
        let bounds = scene.extent();
        let size = bounds.size().max_element().max(1e-6);
        let rig = match settings.kind.unwrap_or(scene.rig) {
            RigKind::TileCorners => Self::TileCorners {
                bounds,
                tiles: settings.tiles.unwrap_or([1, 1]),
                height: 1.0,
                size: settings.size.unwrap_or([400, 300]),
            },
            RigKind::Cell => Self::Cell {
                origin: bounds.center(),
                spacing: settings.spacing.unwrap_or(size / 16.0),
                face: settings.face.unwrap_or(512),
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
                InvalidField::within("rig.tiles", x, 1..=1024)?;
                InvalidField::within("rig.tiles", z, 1..=1024)?;
                check(height > 0.0 && height < 1e6, "rig.height", "must be above 0 and below a million")?;
                InvalidField::within("rig.size", w, 1..=8192)?;
                InvalidField::within("rig.size", h, 1..=8192).map(drop)
            }
            Self::Cell { origin, spacing, face } => {
                check(origin.is_finite(), "rig.origin", "must be finite")?;
                InvalidField::positive("rig.spacing", spacing)?;
                InvalidField::within("rig.face", face, 8..=2048).map(drop)
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
            Self::TileCorners { size: [width, height], .. } => {
                let (tile, eye) = self.tile_camera(index).ok_or_else(unknown)?;
                let mut camera = Camera::look_at(eye, tile.bounds.center());
                camera.fov_deg = tile.fov_around(&camera, width, height);
                Ok(SampleCamera::Perspective { camera, width, height })
            }
            Self::Cell { face, .. } => {
                let center = self.lattice_point(index).ok_or_else(unknown)?;
                Ok(SampleCamera::Omni { center, layout: OmniLayout::CubeFaces { face } })
            }
        }
    }

    /// The level of an index: 0 for one of the rig's own cameras; `None` if the rig has no such camera.
    pub fn level(&self, index: u64) -> Option<u32> {
        match *self {
            Self::Cell { .. } => Point::from_index(index).map(|point| point.level),
            Self::TileCorners { .. } => {
                let own = 4 * self.tile_count();
                self.tile_camera(index)?;
                let slot = index.checked_sub(own).map(|refined| refined % tile::REFINED);
                Some(slot.map_or(0, tile::level_of))
            }
        }
    }

    /// The rig's own `count` cameras that serve a viewpoint best, best first; fewer if the rig has fewer. The result
    /// depends only on the arguments.
    pub fn nearest(&self, camera: &Camera, count: usize) -> Vec<u64> {
        self.nearest_among(camera, count, CandidateCameras::default())
    }

    /// The `count` cameras that serve a viewpoint best, best first, of the rig's own and of refinements. The result
    /// depends only on the arguments, not on their order.
    pub fn nearest_among(
        &self,
        camera: &Camera,
        count: usize,
        CandidateCameras { refined, sight }: CandidateCameras<'_>,
    ) -> Vec<u64> {
        let level = self.own_level(camera, sight);
        self.nearest_at(level, camera, count, CandidateCameras { refined, sight })
    }

    /// The level of the cameras that serve a viewer, by the median distance of what it sees: 0, or the nearest level whose
    /// spacing suits that distance. So a viewer beside small things in a wide scene has cameras near these, and one far
    /// from everything shares cameras with many others. At level −n, every 2ⁿ-th point of the lattice serves. 0 without ray
    /// queries.
    pub fn own_level(&self, camera: &Camera, sight: Option<&dyn VisibilityQuery>) -> i32 {
        let (Self::Cell { spacing, .. }, Some(sight)) = (*self, sight) else { return 0 };
        let Some(range) = sight::median_range(sight, camera) else { return 0 };
        // These saturate; NaN is 0.
        let halvings = (LEAST_RANGE * spacing / range).log2().ceil().max(0.0) as i32;
        let doublings = (range / (MOST_RANGE * spacing)).log2().ceil().max(0.0) as i32;
        halvings.min(FINEST_OWN as i32) - doublings.min(COARSEST_OWN)
    }

    /// The cameras of [`Rig::nearest_among`] for a viewer with this own level.
    pub fn nearest_at(
        &self,
        level: i32,
        camera: &Camera,
        count: usize,
        CandidateCameras { refined, sight }: CandidateCameras<'_>,
    ) -> Vec<u64> {
        let Some(sight) = sight.filter(|_| matches!(self, Self::Cell { .. })) else {
            return self.ranked(camera, (level, 2), refined).into_iter().take(count).collect();
        };
        // A cell's neighbours may see surfaces that its own corners do not.
        let ranked = self.ranked(camera, (level, 4), refined);
        let ranked = ranked.into_iter().take(CANDIDATES.max(count.saturating_mul(2)));
        let place = |index| self.lattice_point(index).map(|at| (index, at));
        sight.best(camera, &ranked.filter_map(place).collect::<Vec<_>>(), count)
    }

    /// The cameras of a level of the lattice around a viewpoint, `edge` to a side, and refinements, nearest first.
    fn ranked(&self, camera: &Camera, (level, edge): (i32, i32), refined: &[u64]) -> Vec<u64> {
        let mut ranked: Vec<(f64, u64)> = match *self {
            Self::TileCorners { .. } => {
                let number = self.tile_looked_at(camera);
                let tile = self.tile(number);
                // The smaller the angle at the tile's centre between eye and sample camera, the more surfaces both see.
                let center = tile.bounds.center();
                let to_eye = (camera.eye - center).normalize_or(DVec3::Y);
                let angle = |eye: DVec3| -to_eye.dot((eye - center).normalize_or(DVec3::Y));
                let own = (0..4).map(|corner| 4 * number + corner);
                let first = 4 * self.tile_count() + number * tile::REFINED;
                let of_tile = refined.iter().copied().filter(|i| (first..first + tile::REFINED).contains(i));
                let eye_of = |index| self.tile_camera(index).map(|(_, eye)| (angle(eye), index));
                own.chain(of_tile).filter_map(eye_of).collect()
            }
            Self::Cell { .. } => {
                let (level, stride) = (level.max(0) as u32, 1 << (-level).clamp(0, COARSEST_OWN));
                let at = self.lattice_coordinates(camera.eye, level) / f64::from(stride);
                let own = lattice::block((level, stride), at.floor().as_ivec3() - (edge - 2) / 2, edge);
                let distance = |index| {
                    self.lattice_point(index).map(|center| ((center - camera.eye).length_squared(), index))
                };
                own.into_iter().chain(refined.iter().copied()).filter_map(distance).collect()
            }
        };
        ranked.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        ranked.dedup();
        ranked.into_iter().map(|(_, index)| index).collect()
    }

    /// The refinement of a level from 1, in a rig of tiles to [`MAX_LEVEL`], that fills the most holes of a viewpoint: the closest that sees the
    /// viewpoint, or the closest if none does. A lattice point of a coarser level has that level's index. `None` if a
    /// tile's camera would stand within the scene's bounds.
    pub fn refinement(
        &self,
        camera: &Camera,
        level: u32,
        sight: Option<&dyn VisibilityQuery>,
    ) -> Option<u64> {
        match *self {
            Self::TileCorners { bounds, .. } => {
                let level = level.clamp(1, MAX_LEVEL);
                let number = self.tile_looked_at(camera);
                let tile = self.tile(number);
                let slot = tile.nearest_slot(camera.eye, level);
                // Another tile's surfaces may be anywhere within the scene's box.
                let outside = tile.refined(slot).is_some_and(|eye| !bounds.contains(eye));
                outside.then_some(4 * self.tile_count() + number * tile::REFINED + slot)
            }
            Self::Cell { .. } => {
                let level = level.clamp(1, lattice::FINEST);
                let eye = self.lattice_coordinates(camera.eye, level);
                let mut around = lattice::neighbours(eye.round().as_ivec3());
                around.sort_by(|a, b| {
                    let squared = |at: &IVec3| (at.as_dvec3() - eye).length_squared();
                    squared(a).total_cmp(&squared(b)).then(a.to_array().cmp(&b.to_array()))
                });
                let mut indices = around.into_iter().map(|at| Point { level, at }.coarsest().index());
                let nearest = indices.next();
                let sees = |index: &u64| match (sight, self.lattice_point(*index)) {
                    (Some(sight), Some(at)) => sight.sees(at, camera.eye),
                    _ => true,
                };
                nearest.filter(sees).or_else(|| indices.find(sees)).or(nearest)
            }
        }
    }

    /// The cameras of the aligned block of a lattice, `edge` of them on each side, that holds the camera of an index;
    /// ascending, the same for each of them. A refinement's block has only cameras of its own level. In a rig without a
    /// lattice, the camera itself.
    pub fn block(&self, index: u64, edge: u32) -> Vec<u64> {
        match (*self, Point::from_index(index)) {
            (Self::Cell { .. }, Some(point)) => point.block(edge).into_iter().map(Point::index).collect(),
            _ => vec![index],
        }
    }

    /// Metres between the camera of an index and its nearest neighbours of the same level; `None` in a rig of tiles.
    pub fn spacing_of(&self, index: u64) -> Option<f64> {
        let Self::Cell { spacing, .. } = *self else { return None };
        self.level(index).map(|level| spacing / f64::from(1_u32 << level))
    }

    /// The same cameras with `side` texels along the longer edge of an image.
    pub fn with_side(self, side: u32) -> Self {
        match self {
            Self::TileCorners { bounds, tiles, height, size } => {
                let longer = u64::from(size[0].max(size[1]).max(1));
                let scaled = |edge: u32| (u64::from(edge) * u64::from(side)).div_ceil(longer) as u32;
                Self::TileCorners { bounds, tiles, height, size: size.map(scaled) }
            }
            Self::Cell { origin, spacing, .. } => Self::Cell { origin, spacing, face: side },
        }
    }

    /// Texels of one sample.
    pub fn sample_texels(&self) -> u64 {
        match *self {
            Self::TileCorners { size: [width, height], .. } => u64::from(width) * u64::from(height),
            Self::Cell { face, .. } => 6 * u64::from(face) * u64::from(face),
        }
    }

    /// A viewpoint in units of a level's spacing, clamped to the range of indices.
    fn lattice_coordinates(&self, eye: DVec3, level: u32) -> DVec3 {
        let Self::Cell { origin, spacing, .. } = *self else { return DVec3::ZERO };
        let limit = DVec3::splat(lattice::LIMIT);
        ((eye - origin) / spacing * f64::from(1_u32 << level)).clamp(-limit, limit)
    }

    /// Position of the point of an index, metres.
    fn lattice_point(&self, index: u64) -> Option<DVec3> {
        let Self::Cell { origin, spacing, .. } = *self else { return None };
        let point = Point::from_index(index)?;
        Some(origin + point.at.as_dvec3() * (spacing / f64::from(1_u32 << point.level)))
    }

    fn tile_count(&self) -> u64 {
        let Self::TileCorners { tiles: [x, z], .. } = *self else { return 0 };
        u64::from(x) * u64::from(z)
    }

    /// The tile and the position of a tile camera.
    fn tile_camera(&self, index: u64) -> Option<(Tile, DVec3)> {
        let own = 4 * self.tile_count();
        let (number, refined) = match index.checked_sub(own) {
            None => (index / 4, None),
            Some(beyond) => (beyond / tile::REFINED, Some(beyond % tile::REFINED)),
        };
        if number >= self.tile_count() {
            return None;
        }
        let tile = self.tile(number);
        let eye = match refined {
            None => tile.corner(index % 4),
            Some(slot) => tile.refined(slot)?,
        };
        Some((tile, eye))
    }

    /// A tile by its number.
    fn tile(&self, number: u64) -> Tile {
        let Self::TileCorners { bounds, tiles, height, .. } = *self else {
            return Tile { bounds: Bounds::EMPTY, above: 0.0 };
        };
        let size = bounds.size() / DVec3::new(f64::from(tiles[0]), 1.0, f64::from(tiles[1]));
        let columns = u64::from(tiles[0]);
        let min = bounds.min + size * DVec3::new((number % columns) as f64, 0.0, (number / columns) as f64);
        let above = 0.5 * height * size.x.max(size.z).max(size.y * 0.5).max(1e-6);
        Tile { bounds: Bounds { min, max: min + size }, above }
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

#[cfg(test)]
mod tests;
