//! Looks the light of pixels up in filled cells.
//!
//! A pixel takes the eight cells of the level whose cells are a few pixels wide there; near the next level it blends into
//! that. A point that a ray found, such as one seen in a mirror, takes cells a few times as wide as that ray is there.
//! Each side counts by how near it is, how alike it faces, and how close the pixel is to its plane. Where a wall stands
//! between the eight cells, those sides count that see the one that the pixel lies on. Where cells do not describe a pixel,
//! finer ones may. What a pixel finds depends on the pixel and on cells alone, never on its neighbours.

use std::ops::{AddAssign, Mul, Range};

use argus_scene::Bounds;
use glam::{IVec3, Vec3};
use rayon::prelude::*;

use super::super::lattice::{CellKey, Lattice, MOST_LEVEL};
use super::super::shading_points::{ShadingPoint, ShadingPoints};
use super::scene::RAYS;
use super::sides::{MOST_BLOCKED, ORIGINS};
use super::store::Store;

/// Share of a level, in octaves, in which it blends into the next.
const BLEND: f32 = 0.3;
/// Least cosine between view and surface that spacing follows: cells grow with its inverse root.
const LEAST_COSINE: f32 = 0.05;
/// Falloff with the squared distance from a side's plane, in edges of the cell: no weight from 0.91 on.
const PLANE: f32 = 1.2;
/// Weight below which the sides do not show what the pixel shows.
const LEAST_WEIGHT: f32 = 0.02;
/// Levels that are tried, each finer than the one before it, where cells do not describe a pixel.
const FINER: u32 = 1;
/// Which sides describe pixels.
#[derive(Clone, Copy)]
struct Fitness {
    /// Blocked ways of eight between a side's origins from which on it is unfit.
    most_blocked: u8,
    /// Share of unfit sides from which on the others do not describe a pixel.
    most_unfit: f32,
}

const IN_THE_OPEN: Fitness = Fitness { most_blocked: MOST_BLOCKED, most_unfit: 0.5 };
/// A side that reaches through the wall by little brings light of the other room.
const BESIDE_WALL: Fitness = Fitness { most_blocked: 0, most_unfit: 0.1 };
/// Rows and columns of pixels that are looked up together.
const BLOCK: usize = 16;

/// Light that a lookup brings.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(in crate::light) struct CellLight {
    /// The share of the sky's irradiance that is seen, by colour.
    pub(in crate::light) sky: Vec3,
    /// Irradiance / π from other surfaces.
    pub(in crate::light) indirect: Vec3,
}

/// What is found for a pixel.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) enum Answer {
    /// No surface.
    #[default]
    Nothing,
    Light(CellLight),
    /// Cells do not describe it: rays of its own light it.
    Alone,
    /// Some of its cells are not filled.
    Missing,
}

/// Lookups about an eye.
pub(super) struct Lookup<'a> {
    pub(super) store: &'a Store,
    pub(super) lattice: Lattice,
    /// The eye's cell of each level, and its place within: [`Lattice::about`].
    pub(super) eye: Vec<Option<(IVec3, Vec3)>>,
    pub(super) tier: usize,
    /// Whether cells of an earlier pose count where they are not filled anew yet.
    pub(super) shows_older: bool,
    /// Edge of a cell in pixels.
    pub(super) pixels: f32,
    /// Angle of a pixel, radians.
    pub(super) pixel: f32,
}

/// A side of one of a corner's cells, ready to be weighted.
struct Near {
    /// Offset of its cell from the corner's lowest: zeros and ones.
    offset: Vec3,
    /// Mean point from that cell's lowest corner, in edges of a cell.
    at: Vec3,
    normal: Vec3,
    /// How many of eight ways between its own origins are blocked; all if the side is thin.
    blocked: u8,
    /// Its group ([`super::corner::groups`]).
    group: u8,
    /// Squared share of its rays that count.
    valid: f32,
    light: Mix,
}

/// Means of rays.
#[derive(Clone, Copy, Default)]
struct Mix {
    seen: Vec3,
    whole: Vec3,
    reflected: Vec3,
}

impl AddAssign for CellLight {
    fn add_assign(&mut self, other: Self) {
        self.sky += other.sky;
        self.indirect += other.indirect;
    }
}

impl Mul<f32> for CellLight {
    type Output = Self;

    fn mul(self, factor: f32) -> Self {
        Self { sky: self.sky * factor, indirect: self.indirect * factor }
    }
}

impl Mix {
    fn plus(self, other: Self, weight: f32) -> Self {
        Self {
            seen: self.seen + other.seen * weight,
            whole: self.whole + other.whole * weight,
            reflected: self.reflected + other.reflected * weight,
        }
    }

    fn light(self) -> CellLight {
        let ratio = |seen: f32, whole: f32| if whole > 0.0 { seen / whole } else { 0.0 };
        let Self { seen, whole, reflected } = self;
        let sky = Vec3::new(ratio(seen.x, whole.x), ratio(seen.y, whole.y), ratio(seen.z, whole.z));
        CellLight { sky, indirect: reflected }
    }
}

/// What a lookup at a corner brings.
enum Mixed {
    Light(Mix),
    Alone,
    Missing,
}

/// What is known of a corner: its range of [`Corners::sides`], and whether a wall stands between them.
#[derive(Clone)]
enum Known {
    Missing,
    Sides { range: Range<usize>, are_parted: bool },
}

/// The corners of a block of pixels, each gathered once.
#[derive(Default)]
struct Corners {
    known: Vec<(CellKey, Known)>,
    sides: Vec<Near>,
}

impl Lookup<'_> {
    /// Corners of every `step`-th pixel in each direction; ascending.
    pub(super) fn corners_of(&self, points: &ShadingPoints, step: usize) -> Vec<CellKey> {
        let [width, height] = points.size;
        let of_row = |row: usize| {
            let mut keys = Vec::new();
            for column in (0..width).step_by(step) {
                let Some(point) = points.all.get(row * width + column) else { continue };
                for key in self.corners(point).into_iter().flatten() {
                    if keys.last() != Some(&key) {
                        keys.push(key);
                    }
                }
            }
            keys
        };
        let rows: Vec<usize> = (0..height).step_by(step).collect();
        sorted(rows.into_par_iter().flat_map_iter(of_row).collect())
    }

    /// Those of some corners that lack cells, in the same order.
    pub(super) fn lacking(&self, corners: &[CellKey]) -> Vec<CellKey> {
        let lacks = |key: &&CellKey| !self.is_whole(**key);
        corners.par_iter().with_min_len(256).filter(lacks).copied().collect()
    }

    fn is_whole(&self, corner: CellKey) -> bool {
        self.store.is_whole(corner, self.tier)
            || self.shows_older && self.store.is_whole_or_older(corner, self.tier)
    }

    /// Looks all pixels up that `answers` says are missing. Returns the corners that lack cells; ascending.
    pub(super) fn look_up(&self, points: &ShadingPoints, answers: &mut [Answer]) -> Vec<CellKey> {
        let [width, _] = points.size;
        let band = |(number, answers): (usize, &mut [Answer])| {
            let mut lacking = Vec::new();
            if !answers.contains(&Answer::Missing) {
                return lacking;
            }
            let first = number * BLOCK * width;
            for begin in (0..width).step_by(BLOCK) {
                let mut corners = Corners::default();
                for row in 0..answers.len() / width {
                    for column in begin..(begin + BLOCK).min(width) {
                        let place = row * width + column;
                        if answers[place] == Answer::Missing {
                            answers[place] = self.answer(&points.all[first + place], &mut corners);
                        }
                    }
                }
                let missing = corners.known.iter().filter(|(_, known)| matches!(known, Known::Missing));
                lacking.extend(missing.map(|(key, _)| *key));
            }
            lacking
        };
        let bands = answers.par_chunks_mut((BLOCK * width).max(1)).enumerate();
        sorted(bands.map(band).flatten_iter().collect())
    }

    /// The two corners that a pixel looks up: at its level, and if it blends into the next, there.
    fn corners(&self, point: &ShadingPoint) -> [Option<CellKey>; 2] {
        if !point.exists {
            return [None; 2];
        }
        let (level, blend) = self.level(point);
        let at = |level: u32| self.corner(point, level).map(|(key, _)| key);
        [at(level), if blend > 0.0 { at(level + 1) } else { None }]
    }

    fn answer(&self, point: &ShadingPoint, corners: &mut Corners) -> Answer {
        if !point.exists {
            return Answer::Nothing;
        }
        let (level, blend) = self.level(point);
        let coarse = self.mixed(point, level, corners);
        // Both are looked up in any case, so that all that lacks is known.
        let fine = if blend > 0.0 { Some(self.mixed(point, level + 1, corners)) } else { None };
        match (coarse, fine) {
            (Mixed::Missing, _) | (_, Some(Mixed::Missing)) => Answer::Missing,
            (Mixed::Light(coarse), None) => Answer::Light(coarse.light()),
            (Mixed::Light(coarse), Some(Mixed::Light(fine))) => {
                Answer::Light(Mix::default().plus(coarse, 1.0 - blend).plus(fine, blend).light())
            }
            // The finer level is enough. A coarser one may reach behind walls that the finer one told from one another.
            (Mixed::Alone, Some(Mixed::Light(fine))) => Answer::Light(fine.light()),
            (Mixed::Alone, None) => self.finer(point, level + 1, corners),
            (_, Some(Mixed::Alone)) => self.finer(point, level + 2, corners),
        }
    }

    /// The answer of the first of a few finer levels whose cells describe a pixel.
    fn finer(&self, point: &ShadingPoint, level: u32, corners: &mut Corners) -> Answer {
        for level in level..(level + FINER).min(MOST_LEVEL + 1) {
            match self.mixed(point, level, corners) {
                Mixed::Light(light) => return Answer::Light(light.light()),
                Mixed::Missing => return Answer::Missing,
                Mixed::Alone => {}
            }
        }
        Answer::Alone
    }

    /// The level of a pixel, and the share of the next finer one.
    fn level(&self, point: &ShadingPoint) -> (u32, f32) {
        let across = if point.across > 0.0 { point.across } else { self.seen_across(point) };
        let spacing = self.pixels * across;
        // NaN becomes 0.
        let level = (self.lattice.edge / spacing).log2().max(0.0).min(MOST_LEVEL as f32);
        let whole = level.floor();
        let blend = if whole < MOST_LEVEL as f32 { (level - whole - (1.0 - BLEND)) / BLEND } else { 0.0 };
        (whole as u32, blend.max(0.0))
    }

    /// The mean side of the area that a pixel shows from the eye, metres.
    fn seen_across(&self, point: &ShadingPoint) -> f32 {
        let distance = point.position.length();
        let cosine = (point.side.dot(point.position).abs() / distance).max(LEAST_COSINE);
        self.pixel * distance / cosine.sqrt()
    }

    /// The corner of a pixel on a level, and the pixel's place from its lowest cell's lowest corner, in edges of a cell: 0.5
    /// to 1.5.
    #[inline]
    fn corner(&self, point: &ShadingPoint, level: u32) -> Option<(CellKey, Vec3)> {
        let (cell, within) = (*self.eye.get(level as usize)?)?;
        let place = point.position / self.lattice.spacing(level) + within;
        let base = (place - 0.5).floor();
        // Saturates, and is then beyond the lattice.
        let key = CellKey::new(
            level,
            IVec3::new(
                cell.x.saturating_add(base.x as i32),
                cell.y.saturating_add(base.y as i32),
                cell.z.saturating_add(base.z as i32),
            ),
        )?;
        Some((key, place - base))
    }

    fn mixed(&self, point: &ShadingPoint, level: u32, corners: &mut Corners) -> Mixed {
        let Some((key, place)) = self.corner(point, level) else { return Mixed::Alone };
        let known = match corners.known.iter().rev().find(|(known, _)| *known == key) {
            Some((_, known)) => known.clone(),
            None => {
                let known = self.gather(key, corners);
                corners.known.push((key, known.clone()));
                known
            }
        };
        let Known::Sides { range, are_parted } = known else { return Mixed::Missing };
        let sides = &corners.sides[range];
        let rule = if are_parted { BESIDE_WALL } else { IN_THE_OPEN };
        let weighed = match are_parted {
            false => Some(Weighed::of(sides.iter(), point, place, rule)),
            true => Weighed::beside_wall(sides, point, place),
        };
        weighed.and_then(|weighed| weighed.mean(rule)).map_or(Mixed::Alone, Mixed::Light)
    }

    /// Collects the sides of a corner's cells.
    fn gather(&self, key: CellKey, corners: &mut Corners) -> Known {
        let (first, store) = (corners.sides.len(), self.store);
        // All of a corner is of one pose.
        let is_older = self.shows_older && !store.is_whole(key, self.tier);
        let groups = if is_older { store.groups_or_older(key) } else { store.groups(key) };
        let Some(groups) = groups else { return Known::Missing };
        let mut group = groups.iter().copied();
        let older = key.corner().map(|(offset, cell)| (offset, store.filled_or_older(cell, self.tier)));
        let older = is_older.then_some(older).into_iter().flatten();
        let new = (!is_older).then(|| store.around(key, self.tier)).into_iter().flatten();
        for (offset, filled) in older.chain(new) {
            let Some(filled) = filled else { return Known::Missing };
            for (side, sums) in filled.sides.iter().zip(filled.sums) {
                let number = group.next().unwrap_or(0);
                if sums.valid > 0.0 {
                    let (share, offset) = (sums.valid / RAYS[self.tier] as f32, offset.as_vec3());
                    let each = 1.0 / sums.valid;
                    corners.sides.push(Near {
                        offset,
                        at: offset + side.place,
                        normal: side.normal,
                        blocked: if side.is_thin { ORIGINS as u8 } else { side.blocked },
                        group: number,
                        valid: share * share,
                        light: Mix {
                            seen: sums.seen * each,
                            whole: sums.whole * each,
                            reflected: sums.reflected * each,
                        },
                    });
                }
            }
        }
        Known::Sides { range: first..corners.sides.len(), are_parted: !groups.is_empty() }
    }
}

impl Near {
    /// How much the side counts at a pixel.
    #[inline]
    fn weight(&self, point: &ShadingPoint, place: Vec3) -> f32 {
        let likeness = self.likeness(point, place);
        if likeness <= 0.0 {
            return 0.0;
        }
        // 1 − across for the lower cell of an axis, across for the upper one.
        let across = place - 0.5;
        let near = (1.0 - across + self.offset * (2.0 * across - 1.0)).element_product();
        near * likeness * self.valid
    }

    /// How alike the side and the pixel face, and how near the pixel is to its plane: 0 to 1.
    #[inline]
    fn likeness(&self, point: &ShadingPoint, place: Vec3) -> f32 {
        let facing = point.normal.dot(self.normal);
        if facing <= 0.0 {
            return 0.0;
        }
        let off = (place - self.at).dot(point.side);
        let plane = (1.0 - PLANE * off * off).max(0.0);
        let squared = facing * facing;
        squared * squared * (plane * plane)
    }
}

/// Sides that were weighed at a pixel.
#[derive(Clone, Copy, Default)]
struct Weighed {
    sum: Mix,
    fit: f32,
    unfit: f32,
}

impl Weighed {
    fn of<'a>(
        sides: impl Iterator<Item = &'a Near>,
        point: &ShadingPoint,
        place: Vec3,
        rule: Fitness,
    ) -> Self {
        let mut all = Self::default();
        for side in sides {
            let weight = side.weight(point, place);
            if weight <= 0.0 {
                continue;
            }
            if side.blocked > rule.most_blocked {
                all.unfit += weight;
            } else {
                all.fit += weight;
                all.sum = all.sum.plus(side.light, weight);
            }
        }
        all
    }

    /// Beside a wall: those sides that are on the pixel's side of it, as the side is that the pixel itself lies on. `None` if
    /// there is no such side, or if it is not fit.
    fn beside_wall(sides: &[Near], point: &ShadingPoint, place: Vec3) -> Option<Self> {
        let cell = place.floor();
        let here = sides.iter().filter(|side| side.offset == cell);
        let home = here.max_by(|a, b| a.likeness(point, place).total_cmp(&b.likeness(point, place)))?;
        if home.blocked > BESIDE_WALL.most_blocked || home.likeness(point, place) <= 0.0 {
            return None;
        }
        let is_seen = |side: &&Near| home.group == 0 || side.group == 0 || side.group == home.group;
        Some(Self::of(sides.iter().filter(is_seen), point, place, BESIDE_WALL))
    }

    fn weight(&self) -> f32 {
        self.fit + self.unfit
    }

    /// The mean; `None` if the sides do not describe the pixel.
    fn mean(self, rule: Fitness) -> Option<Mix> {
        let describes = self.fit > LEAST_WEIGHT && self.unfit <= rule.most_unfit * self.weight();
        describes.then(|| Mix::default().plus(self.sum, 1.0 / self.fit))
    }
}

/// Keys in ascending order, each once.
pub(super) fn sorted(mut keys: Vec<CellKey>) -> Vec<CellKey> {
    keys.par_sort_unstable();
    keys.dedup();
    keys
}

/// The texels of an image or list that have no light yet, as an image of their own.
pub(super) fn only(points: &ShadingPoints, keep: impl Fn(usize) -> bool + Sync) -> ShadingPoints {
    let point =
        |(index, point): (usize, &ShadingPoint)| if keep(index) { *point } else { ShadingPoint::default() };
    ShadingPoints {
        size: points.size,
        first: points.first,
        effort: points.effort,
        numbers: Vec::new(),
        all: points.all.par_iter().enumerate().map(point).collect(),
        bounds: Bounds::EMPTY,
    }
}
