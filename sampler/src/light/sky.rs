//! The sky's light: what an open sky sends, and the share of it that texels see.

use std::f64::consts::TAU;
use std::ops::{AddAssign, Mul};

use argus_scene::light_sampling::cosine_direction;
use argus_scene::shading::sky_radiance;
use argus_scene::{EnvironmentMap, Sky};
use glam::{DVec3, Vec2, Vec3};
use rayon::prelude::*;

use super::filter::smoothed;
use super::pattern::{Pattern, above, disc_points};
use super::shading_points::{Effort, ShadingPoints};
use crate::LightSettings;
use crate::light_rays::LightRaysAbout;
use crate::passes::SkyTable;

/// Irradiance of an open sky, as a table over normals.
#[derive(Clone)]
pub(super) struct SkyIrradiance {
    /// Irradiance / π for y = −1 to 1, evenly: rows of as many directions as columns. Empty for a black sky.
    table: Vec<Vec3>,
    /// Directions around, evenly from −z over +x. One for a gradient, which is the same all around.
    columns: usize,
}

/// Intervals of the table.
const INTERVALS: usize = 64;
/// Directions that an entry is the mean of.
const DIRECTIONS: u32 = 4096;
/// Columns of the table of an environment map.
const COLUMNS: usize = 64;
/// Patches of an environment map, around and from pole to pole, that an entry is a sum over.
const PATCHES: [u32; 2] = [128, 64];

impl SkyIrradiance {
    pub(super) fn new(sky: &Sky) -> Self {
        if let Some(map) = &sky.map {
            return Self::of_map(map);
        }
        let entry = |i: usize| {
            let y = i as f64 / INTERVALS as f64 * 2.0 - 1.0;
            let normal = DVec3::new((1.0 - y * y).max(0.0).sqrt(), y, 0.0);
            let directions = (0..DIRECTIONS).map(|i| {
                let disc = argus_scene::light_sampling::disc_point(argus_scene::light_sampling::r2(i));
                sky_radiance(sky, cosine_direction(normal, disc).as_vec3()).as_dvec3()
            });
            (directions.sum::<DVec3>() / f64::from(DIRECTIONS)).as_vec3()
        };
        let is_black = [sky.zenith, sky.horizon, sky.ground].iter().all(|color| *color == Vec3::ZERO);
        let table = if is_black { Vec::new() } else { (0..=INTERVALS).into_par_iter().map(entry).collect() };
        Self { table, columns: 1 }
    }

    fn of_map(map: &EnvironmentMap) -> Self {
        if map.brightest() == Vec3::ZERO {
            return Self { table: Vec::new(), columns: 1 };
        }
        let patches = map.patches(PATCHES);
        let entry = |i: usize| {
            let y = (i / COLUMNS) as f64 / INTERVALS as f64 * 2.0 - 1.0;
            let around = (i % COLUMNS) as f64 / COLUMNS as f64 * TAU;
            let level = (1.0 - y * y).max(0.0).sqrt();
            let normal = DVec3::new(level * around.sin(), y, -level * around.cos());
            let (mut sum, mut weight) = (DVec3::ZERO, 0.0);
            for patch in &patches {
                let cosine = normal.dot(patch.direction).max(0.0);
                sum += patch.power * cosine;
                weight += patch.solid_angle * cosine;
            }
            // The sum of weights is π but for the size of patches, which then cancels.
            (sum / weight).as_vec3()
        };
        let entries = (INTERVALS + 1) * COLUMNS;
        Self { table: (0..entries).into_par_iter().map(entry).collect(), columns: COLUMNS }
    }

    /// Whether no light comes from the sky.
    pub(super) fn is_black(&self) -> bool {
        self.table.is_empty()
    }

    /// The table, for programs.
    pub(super) fn table(&self) -> SkyTable<'_> {
        SkyTable { entries: &self.table, columns: self.columns }
    }

    /// Irradiance / π on a surface with a unit normal.
    pub(super) fn irradiance_over_pi(&self, normal: Vec3) -> Vec3 {
        let place = (normal.y.clamp(-1.0, 1.0) + 1.0) * 0.5 * INTERVALS as f32;
        let below = (place as usize).min(INTERVALS - 1);
        let row = |row: usize| self.table.get(row * self.columns..(row + 1) * self.columns);
        let (Some(lower), Some(upper)) = (row(below), row(below + 1)) else { return Vec3::ZERO };
        if self.columns == 1 {
            return lower[0].lerp(upper[0], place - below as f32);
        }
        let turn = normal.x.atan2(-normal.z) / std::f32::consts::TAU;
        let across = (turn - turn.floor()) * self.columns as f32;
        let left = (across as usize).min(self.columns - 1);
        let right = (left + 1) % self.columns;
        let along = |row: &[Vec3]| row[left].lerp(row[right], across - left as f32);
        along(lower).lerp(along(upper), place - below as f32)
    }
}

/// Radiance of the sky, summed over rays.
#[derive(Clone, Copy, Default)]
struct SkySums {
    /// Over rays that reach the sky.
    seen: Vec3,
    /// Over all rays.
    whole: Vec3,
}

impl AddAssign for SkySums {
    fn add_assign(&mut self, other: Self) {
        self.seen += other.seen;
        self.whole += other.whole;
    }
}

impl Mul<f32> for SkySums {
    type Output = Self;

    fn mul(self, factor: f32) -> Self {
        Self { seen: self.seen * factor, whole: self.whole * factor }
    }
}

/// The share of the sky's irradiance that each texel sees, by colour: a ratio of two sums over the same rays, so that an
/// open sky has no noise.
pub(super) fn seen_share(
    sky: &Sky,
    points: &ShadingPoints,
    about: &LightRaysAbout<'_>,
    settings: LightSettings,
) -> Vec<Vec3> {
    let alone = match points.effort {
        Effort::Whole { rays } => Some(disc_points(rays)),
        Effort::Shared => None,
    };
    let pattern = Pattern::of_disc(settings.sky_rays as usize);
    let reach = sky.reach.map_or(f32::MAX, |reach| reach as f32);
    let cast = |index: usize| {
        let point = &points.all[index];
        let mut sums = SkySums::default();
        if !point.exists {
            return sums;
        }
        let mut cast = |disc: Vec2| {
            let direction = above(point.normal, disc);
            let radiance = sky_radiance(sky, direction);
            sums.whole += radiance;
            sums.seen += radiance * point.sees(about, direction, reach);
        };
        match &alone {
            Some(all) => all.iter().for_each(|&disc| cast(disc)),
            None => pattern.of_slot(points.slot(index)).for_each(cast),
        }
        sums
    };
    let sums: Vec<SkySums> = (0..points.all.len()).into_par_iter().with_min_len(256).map(cast).collect();
    // Each sum by itself: the mean of ratios of a few rays would favour directions in which the sky is dark.
    let sums = if settings.filter { smoothed(sums, points) } else { sums };
    let ratio = |seen: f32, whole: f32| if whole > 0.0 { seen / whole } else { 0.0 };
    let share = |SkySums { seen, whole }: SkySums| {
        Vec3::new(ratio(seen.x, whole.x), ratio(seen.y, whole.y), ratio(seen.z, whole.z))
    };
    sums.into_par_iter().map(share).collect()
}

#[cfg(test)]
mod tests {
    use argus_scene::Environment;

    use super::*;

    #[test]
    fn an_even_sky_has_the_same_irradiance_for_every_normal() {
        let sky = Sky { zenith: Vec3::ONE, horizon: Vec3::ONE, ground: Vec3::ONE, map: None, reach: None };
        let irradiance = SkyIrradiance::new(&sky);
        for y in [-1.0, -0.3, 0.0, 0.7, 1.0] {
            let normal = Vec3::new((1.0f32 - y * y).sqrt(), y, 0.0);
            assert!((irradiance.irradiance_over_pi(normal) - Vec3::ONE).abs().max_element() < 1e-5);
        }
        assert!(SkyIrradiance::new(&Sky::BLACK).is_black());
    }

    #[test]
    fn the_table_is_the_integral_of_the_gradient() {
        // Upwards: ∫ lerp(horizon, zenith, y) over the cosine-weighted hemisphere has a mean height of 2/3.
        let sky = Sky { zenith: Vec3::ONE, horizon: Vec3::ZERO, ground: Vec3::ZERO, map: None, reach: None };
        let up = SkyIrradiance::new(&sky).irradiance_over_pi(Vec3::Y);
        assert!((up.x - 2.0 / 3.0).abs() < 1e-3, "{up}");
    }

    /// The sky of a map with this radiance by direction, the means of texels of a map of 128 × 64.
    fn sky_of(radiance: impl Fn(f64, f64) -> f32) -> Sky {
        let point = |i: u32| Vec3::splat(radiance(f64::from(i % 128) + 0.5, f64::from(i / 128) + 0.5));
        let environment = Environment::new(128, 64, (0..128 * 64).map(point).collect()).unwrap();
        assert!(environment.lights.is_empty());
        Sky::of_map(environment.map)
    }

    #[test]
    fn a_map_of_one_colour_has_the_same_irradiance_for_every_normal() {
        let irradiance = SkyIrradiance::new(&sky_of(|_, _| 0.5));
        for normal in [Vec3::Y, Vec3::NEG_Y, Vec3::X, Vec3::NEG_Z, Vec3::new(0.48, -0.6, 0.64)] {
            assert!((irradiance.irradiance_over_pi(normal) - Vec3::splat(0.5)).abs().max_element() < 1e-3);
        }
        assert!(SkyIrradiance::new(&sky_of(|_, _| 0.0)).is_black());
    }

    #[test]
    fn the_table_of_a_map_is_the_integral_of_its_radiance() {
        // Light from the side of +x alone: the left half of the map, whose centre is +z.
        let sky = sky_of(|column, _| f32::from(u8::from(column < 64.0)));
        let irradiance = SkyIrradiance::new(&sky);
        for normal in [Vec3::X, Vec3::NEG_X, Vec3::Y, Vec3::Z, Vec3::new(0.8, 0.0, 0.6)] {
            // A half space that is turned by an angle covers (1 + cosine) / 2 of the cosine-weighted hemisphere.
            let expected = 0.5 + 0.5 * normal.x;
            let found = irradiance.irradiance_over_pi(normal).x;
            assert!((found - expected).abs() < 0.01, "{normal}: {found}, {expected}");
        }
    }
}
