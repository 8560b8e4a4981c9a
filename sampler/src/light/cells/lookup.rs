//! Looks the light of pixels up in filled cells.
//!
//! A pixel takes the eight cells of the level whose cells are a few pixels wide there; near the next level it blends into
//! that. A point that a ray found, such as one seen in a mirror, takes cells a few times as wide as that ray is there.
//! Each side counts by how near it is, how alike it faces, and how close the pixel is to its plane. Where a wall stands
//! between the eight cells, those sides count that see the one that the pixel lies on. Where cells do not describe a pixel,
//! finer ones may. What a pixel finds depends on the pixel and on cells alone, never on its neighbours.

use std::ops::{AddAssign, Mul};

use glam::{IVec3, Vec3};
use rayon::prelude::*;

use super::super::lattice::{CellKey, Lattice, MOST_LEVEL};
use super::super::shading_points::{ShadingPoint, ShadingPoints};
use super::corner_cache::{CornerCache, Known};
use super::scene::RAYS;
use super::sides::ORIGINS;
use super::store::{Filled, Store};
use super::weighing::{Mix, Near, Octets, Rule};
use crate::packets::lanes::{Lanes, Plain};

/// Share of a level, in octaves, in which it blends into the next.
const BLEND: f32 = 0.3;
/// Least cosine between view and surface that spacing follows: cells grow with its inverse root.
const LEAST_COSINE: f32 = 0.05;
/// Levels that are tried, each finer than the one before it, where cells do not describe a pixel.
const FINER: u32 = 1;
/// Rows and columns of pixels that are looked up together.
const BLOCK: usize = 32;

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
    pub(super) has_avx2: bool,
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

/// What a lookup at a corner brings.
enum Mixed {
    Light(Mix),
    Alone,
    Missing,
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
            let rows = &points.all[number * BLOCK * width..][..answers.len()];
            let mut corners = CornerCache::default();
            for first in (0..width).step_by(BLOCK) {
                corners.forget();
                self.look_up_block(rows, answers, [first, width], &mut corners);
                lacking.extend(corners.missing());
            }
            lacking
        };
        let bands = answers.par_chunks_mut((BLOCK * width).max(1)).enumerate();
        sorted(bands.map(band).flatten_iter().collect())
    }

    /// Looks up the pixels of some rows from a column on. `columns` are that one and the number of columns.
    fn look_up_block(
        &self,
        rows: &[ShadingPoint],
        answers: &mut [Answer],
        columns: [usize; 2],
        corners: &mut CornerCache,
    ) {
        #[cfg(target_arch = "x86_64")]
        {
            use crate::packets::lanes::avx2::Avx2;

            #[target_feature(enable = "avx2")]
            fn with_avx2(
                lookup: &Lookup<'_>,
                rows: &[ShadingPoint],
                answers: &mut [Answer],
                columns: [usize; 2],
                corners: &mut CornerCache,
            ) {
                lookup.look_up_block_by::<Avx2>(rows, answers, columns, corners);
            }
            if self.has_avx2 {
                // SAFETY: the processor has what the function is compiled for.
                return unsafe { with_avx2(self, rows, answers, columns, corners) };
            }
        }
        self.look_up_block_by::<Plain>(rows, answers, columns, corners);
    }

    #[inline(always)]
    fn look_up_block_by<L: Lanes>(
        &self,
        rows: &[ShadingPoint],
        answers: &mut [Answer],
        [first, width]: [usize; 2],
        corners: &mut CornerCache,
    ) {
        for (points, answers) in rows.chunks(width).zip(answers.chunks_mut(width)) {
            let pixels = points.iter().zip(answers).skip(first).take(BLOCK);
            for (point, answer) in pixels.filter(|(_, answer)| **answer == Answer::Missing) {
                *answer = self.answer::<L>(point, corners);
            }
        }
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

    #[inline(always)]
    fn answer<L: Lanes>(&self, point: &ShadingPoint, corners: &mut CornerCache) -> Answer {
        if !point.exists {
            return Answer::Nothing;
        }
        let (level, blend) = self.level(point);
        let coarse = self.mixed::<L>(point, level, corners);
        // Both are looked up in any case, so that all that lacks is known.
        let fine = if blend > 0.0 { Some(self.mixed::<L>(point, level + 1, corners)) } else { None };
        match (coarse, fine) {
            (Mixed::Missing, _) | (_, Some(Mixed::Missing)) => Answer::Missing,
            (Mixed::Light(coarse), None) => Answer::Light(light_of(coarse)),
            (Mixed::Light(coarse), Some(Mixed::Light(fine))) => {
                Answer::Light(light_of(Mix::default().plus(coarse, 1.0 - blend).plus(fine, blend)))
            }
            // The finer level is enough. A coarser one may reach behind walls that the finer one told from one another.
            (Mixed::Alone, Some(Mixed::Light(fine))) => Answer::Light(light_of(fine)),
            (Mixed::Alone, None) => self.finer::<L>(point, level + 1, corners),
            (_, Some(Mixed::Alone)) => self.finer::<L>(point, level + 2, corners),
        }
    }

    /// The answer of the first of a few finer levels whose cells describe a pixel.
    #[inline(always)]
    fn finer<L: Lanes>(&self, point: &ShadingPoint, level: u32, corners: &mut CornerCache) -> Answer {
        for level in level..(level + FINER).min(MOST_LEVEL + 1) {
            match self.mixed::<L>(point, level, corners) {
                Mixed::Light(light) => return Answer::Light(light_of(light)),
                Mixed::Missing => return Answer::Missing,
                Mixed::Alone => {}
            }
        }
        Answer::Alone
    }

    /// The level of a pixel, and the share of the next finer one.
    #[inline(always)]
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
    #[inline(always)]
    fn seen_across(&self, point: &ShadingPoint) -> f32 {
        let distance = point.position.length();
        let cosine = (point.side.dot(point.position).abs() / distance).max(LEAST_COSINE);
        self.pixel * distance / cosine.sqrt()
    }

    /// The corner of a pixel on a level, and the pixel's place from its lowest cell's lowest corner, in edges of a cell: 0.5
    /// to 1.5.
    #[inline(always)]
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

    #[inline(always)]
    fn mixed<L: Lanes>(&self, point: &ShadingPoint, level: u32, corners: &mut CornerCache) -> Mixed {
        let Some((key, place)) = self.corner(point, level) else { return Mixed::Alone };
        let known = corners.of(key).unwrap_or_else(|| self.gather(key, corners));
        let Known::Sides { first, count, rule } = known else { return Mixed::Missing };
        let octets = Octets(&corners.octets[first as usize..][..count as usize]);
        octets.mean::<L>(point, place, rule).map_or(Mixed::Alone, Mixed::Light)
    }

    /// Collects the sides of a corner's cells.
    #[inline(never)]
    fn gather(&self, key: CellKey, corners: &mut CornerCache) -> Known {
        let known = self.near(key, corners);
        corners.keep(key, known)
    }

    /// The sides of a corner's cells, with the rule by which they count; `None` if the corner lacks some.
    fn near(&self, key: CellKey, corners: &mut CornerCache) -> Option<Rule> {
        let store = self.store;
        // All of a corner is of one pose.
        let is_older = self.shows_older && !store.is_whole(key, self.tier);
        let groups = if is_older { store.groups_or_older(key) } else { store.groups(key) }?;
        let (mut group, rays) = (groups.iter(), RAYS[self.tier] as f32);
        let mut add = |offset: IVec3, filled: Filled<'_>| {
            for (side, sums) in filled.sides.iter().zip(filled.sums) {
                let group = *group.next().unwrap_or(&0);
                if sums.valid > 0.0 {
                    let (share, each) = (sums.valid / rays, 1.0 / sums.valid);
                    corners.add(Near {
                        offset: offset.as_vec3(),
                        place: side.place,
                        normal: side.normal,
                        blocked: if side.is_thin { ORIGINS as u8 } else { side.blocked },
                        group,
                        valid: share * share,
                        light: Mix {
                            seen: sums.seen * each,
                            whole: sums.whole * each,
                            reflected: sums.reflected * each,
                        },
                    });
                }
            }
        };
        if is_older {
            for (offset, cell) in key.corner() {
                add(offset, store.filled_or_older(cell, self.tier)?);
            }
        } else {
            for (offset, filled) in store.around(key, self.tier) {
                add(offset, filled?);
            }
        }
        Some(if groups.is_empty() { Rule::InTheOpen } else { Rule::BesideWall })
    }
}

/// The share of the sky that is seen, and what surfaces reflect.
#[inline(always)]
fn light_of(mix: Mix) -> CellLight {
    let ratio = |seen: f32, whole: f32| if whole > 0.0 { seen / whole } else { 0.0 };
    let Mix { seen, whole, reflected } = mix;
    let sky = Vec3::new(ratio(seen.x, whole.x), ratio(seen.y, whole.y), ratio(seen.z, whole.z));
    CellLight { sky, indirect: reflected }
}

/// Keys in ascending order, each once.
pub(super) fn sorted(mut keys: Vec<CellKey>) -> Vec<CellKey> {
    keys.par_sort_unstable();
    keys.dedup();
    keys
}
