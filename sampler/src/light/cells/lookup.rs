//! Looks the light of pixels up in filled cells.
//!
//! A pixel takes the eight cells of the level whose cells are a few pixels wide there; near the next level it blends into
//! that. A point that a ray found, such as one seen in a mirror, takes cells a few times as wide as that ray is there. Each side counts by how near it is, how alike it faces, and how close the pixel is to its plane. What a pixel
//! gets depends on the pixel and on cells alone, never on its neighbours.

use std::ops::Range;

use argus_scene::Bounds;
use glam::{IVec3, Vec3};
use rayon::prelude::*;

use super::super::lattice::{CellKey, Lattice, MOST_LEVEL};
use super::super::shading_points::{ShadingPoint, ShadingPoints};
use super::corner::{MOST_GROUPS, above};
use super::scene::RAYS;
use super::sides::{ALMOST, MOST_BLOCKED};
use super::store::Store;
use crate::light_rays::LightRaysAbout;

/// Share of a level, in octaves, in which it blends into the next.
const BLEND: f32 = 0.3;
/// Least cosine between view and surface that spacing follows: cells grow with its inverse root.
const LEAST_COSINE: f32 = 0.05;
/// Falloff with the squared distance from a side's plane, in edges of the cell: no weight from 0.91 on.
const PLANE: f32 = 1.2;
/// Weight below which the sides do not show what the pixel shows.
const LEAST_WEIGHT: f32 = 0.02;
/// Share of unfit sides from which a pixel is lit by rays of its own.
const MOST_UNFIT: f32 = 0.5;
/// Share of the weight up to which a group of sides does not count.
const LITTLE: f32 = 0.02;
/// Share of the weight from which on further groups are left out unseen.
const MOST_OF: f32 = 0.9;
/// Beside a wall: share of unfit sides from which, and share of seen sides below which a pixel is lit by rays of its own.
const MOST_LOST: f32 = 0.1;
const LEAST_SEEN: f32 = 0.7;
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
    /// The scene about the eye.
    pub(super) about: &'a LightRaysAbout<'a>,
    /// The eye's cell of each level, and its place within: [`Lattice::about`].
    pub(super) eye: Vec<Option<(IVec3, Vec3)>>,
    pub(super) tier: usize,
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
    is_unfit: bool,
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

/// Sides that some pixels see and others do not.
struct Group {
    number: u8,
    /// A point above its first side, in edges of a cell from the corner's lowest.
    above: Vec3,
}

/// What is known of a corner: ranges of [`Corners::sides`] and of [`Corners::groups`].
#[derive(Clone)]
enum Known {
    Missing,
    Sides(Range<usize>, Range<usize>),
}

/// The corners of a block of pixels, each gathered once.
#[derive(Default)]
struct Corners {
    known: Vec<(CellKey, Known)>,
    sides: Vec<Near>,
    groups: Vec<Group>,
}

impl Lookup<'_> {
    /// Corners of every `step`-th pixel in each direction that lack cells; ascending.
    pub(super) fn missing(&self, points: &ShadingPoints, step: usize) -> Vec<CellKey> {
        let [width, height] = points.size;
        let of_row = |row: usize| {
            let mut lacking = Vec::new();
            let mut last = None;
            for column in (0..width).step_by(step) {
                let Some(point) = points.all.get(row * width + column) else { continue };
                for key in self.corners(point).into_iter().flatten() {
                    if last.replace(key) != Some(key) && !self.store.is_whole(key, self.tier) {
                        lacking.push(key);
                    }
                }
            }
            lacking
        };
        let rows: Vec<usize> = (0..height).step_by(step).collect();
        sorted(rows.into_par_iter().flat_map_iter(of_row).collect())
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
            // The finer level is enough. A coarser one may reach behind walls that the finer one told from one another.
            (Mixed::Alone, Some(Mixed::Light(fine))) => Answer::Light(fine.light()),
            (Mixed::Alone, _) | (_, Some(Mixed::Alone)) => Answer::Alone,
            (Mixed::Light(coarse), Some(Mixed::Light(fine))) => {
                Answer::Light(Mix::default().plus(coarse, 1.0 - blend).plus(fine, blend).light())
            }
        }
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
        let Known::Sides(sides, groups) = known else { return Mixed::Missing };
        let (sides, groups) = (&corners.sides[sides], &corners.groups[groups]);
        let mixed = match groups.is_empty() {
            true => Weighed::all(sides, point, place).mean(),
            false => self.seen(sides, groups, point, place, level).and_then(Weighed::mean),
        };
        mixed.map_or(Mixed::Alone, Mixed::Light)
    }

    /// Weighs those sides at a pixel that are in no group or in one that the pixel sees. Groups are looked at from the
    /// weightiest on, until nearly all weight is seen. `None` if the pixel sees none of those that count.
    fn seen(
        &self,
        sides: &[Near],
        groups: &[Group],
        point: &ShadingPoint,
        place: Vec3,
        level: u32,
    ) -> Option<Weighed> {
        let mut of_groups = [Weighed::default(); MOST_GROUPS + 1];
        let of_groups = &mut of_groups[..=groups.last().map_or(0, |group| usize::from(group.number))];
        sides.iter().for_each(|side| of_groups[usize::from(side.group)].add(side, point, place));
        let total = of_groups.iter().map(Weighed::weight).sum::<f32>();
        let spacing = self.lattice.spacing(level);
        let (mut all, mut seen) = (of_groups[0], None);
        while all.weight() < MOST_OF * total {
            let weight = |group: &&Group| of_groups[usize::from(group.number)].weight();
            let Some(group) = groups.iter().max_by(|a, b| weight(a).total_cmp(&weight(b))) else { break };
            if weight(&group) <= LITTLE * total {
                break;
            }
            let to = point.position + (group.above - place) * spacing - point.start;
            let is_seen = !self.about.is_blocked(point.start, to, ALMOST);
            seen = Some(seen.unwrap_or(false) || is_seen);
            let of_group = std::mem::take(&mut of_groups[usize::from(group.number)]);
            if is_seen {
                all.join(of_group);
            }
        }
        // Beside a wall, little may be missing of what describes the pixel.
        let describes = all.unfit <= MOST_LOST * all.weight() && all.weight() >= LEAST_SEEN * total;
        (seen.unwrap_or(true) && describes).then_some(all)
    }

    /// Collects the sides of a corner's cells.
    fn gather(&self, key: CellKey, corners: &mut Corners) -> Known {
        let (first, first_group) = (corners.sides.len(), corners.groups.len());
        let Some(groups) = self.store.groups(key) else { return Known::Missing };
        let mut group = groups.iter().copied();
        for (offset, cell) in key.corner() {
            let Some(filled) = self.store.filled(cell, self.tier) else { return Known::Missing };
            for (side, sums) in filled.sides.iter().zip(filled.sums) {
                let number = group.next().unwrap_or(0);
                let is_new = |groups: &[Group]| groups.iter().all(|known| known.number != number);
                if number > 0 && is_new(&corners.groups[first_group..]) {
                    corners.groups.push(Group { number, above: above(offset, side) });
                }
                if sums.valid > 0.0 {
                    let (share, offset) = (sums.valid / RAYS[self.tier] as f32, offset.as_vec3());
                    let each = 1.0 / sums.valid;
                    corners.sides.push(Near {
                        offset,
                        at: offset + side.place,
                        normal: side.normal,
                        // Beside a wall, a side that reaches through it by little brings light of the other room.
                        is_unfit: side.is_thin
                            || side.blocked > if groups.is_empty() { MOST_BLOCKED } else { 0 },
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
        Known::Sides(first..corners.sides.len(), first_group..corners.groups.len())
    }
}

impl Near {
    /// How much the side counts at a pixel.
    #[inline]
    fn weight(&self, point: &ShadingPoint, place: Vec3) -> f32 {
        let facing = point.normal.dot(self.normal);
        if facing <= 0.0 {
            return 0.0;
        }
        // 1 − across for the lower cell of an axis, across for the upper one.
        let across = place - 0.5;
        let near = (1.0 - across + self.offset * (2.0 * across - 1.0)).element_product();
        let off = (place - self.at).dot(point.side);
        let plane = (1.0 - PLANE * off * off).max(0.0);
        let squared = facing * facing;
        near * (squared * squared) * (plane * plane) * self.valid
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
    fn all(sides: &[Near], point: &ShadingPoint, place: Vec3) -> Self {
        let mut all = Self::default();
        sides.iter().for_each(|side| all.add(side, point, place));
        all
    }

    #[inline]
    fn add(&mut self, side: &Near, point: &ShadingPoint, place: Vec3) {
        let weight = side.weight(point, place);
        if side.is_unfit {
            self.unfit += weight;
        } else {
            self.fit += weight;
            self.sum = self.sum.plus(side.light, weight);
        }
    }

    fn join(&mut self, other: Self) {
        self.sum = self.sum.plus(other.sum, 1.0);
        self.fit += other.fit;
        self.unfit += other.unfit;
    }

    fn weight(&self) -> f32 {
        self.fit + self.unfit
    }

    /// The mean; `None` if the sides do not describe the pixel.
    fn mean(self) -> Option<Mix> {
        let describes = self.fit > LEAST_WEIGHT && self.unfit <= MOST_UNFIT * self.weight();
        describes.then(|| Mix::default().plus(self.sum, 1.0 / self.fit))
    }
}

fn sorted(mut keys: Vec<CellKey>) -> Vec<CellKey> {
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
        all: points.all.par_iter().enumerate().map(point).collect(),
        bounds: Bounds::EMPTY,
    }
}
