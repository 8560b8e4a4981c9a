//! The sky's light: what an open sky sends, and the share of it that texels see.

use argus_scene::Sky;
use argus_scene::light_sampling::cosine_direction;
use argus_scene::shading::sky_radiance;
use glam::{DVec3, Vec2, Vec3};
use rayon::prelude::*;

use super::filter::smoothed;
use super::pattern::{Pattern, above, disc_points};
use super::texels::{Effort, Texels};
use crate::LightKnobs;
use crate::light_rays::LightRaysAbout;

/// Irradiance of an open sky, as a function of the normal's height: the sky is the same all around.
pub(super) struct SkyIrradiance {
    /// Irradiance / π for y = −1 to 1, evenly.
    table: Vec<Vec3>,
}

/// Intervals of the table.
const INTERVALS: usize = 64;
/// Directions that an entry is the mean of.
const DIRECTIONS: u32 = 4096;

impl SkyIrradiance {
    pub(super) fn new(sky: &Sky) -> Self {
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
        Self { table }
    }

    /// Whether no light comes from the sky.
    pub(super) fn is_black(&self) -> bool {
        self.table.is_empty()
    }

    /// Irradiance / π on a surface with a unit normal.
    pub(super) fn by_pi(&self, normal: Vec3) -> Vec3 {
        let place = (normal.y.clamp(-1.0, 1.0) + 1.0) * 0.5 * INTERVALS as f32;
        let below = (place as usize).min(INTERVALS - 1);
        match self.table.get(below..below + 2) {
            Some([a, b]) => a.lerp(*b, place - below as f32),
            _ => Vec3::ZERO,
        }
    }
}

/// The share of the sky's irradiance that each texel sees, by colour: a ratio of two sums over the same rays, so that an
/// open sky has no noise.
pub(super) fn seen_share(
    sky: &Sky,
    texels: &Texels,
    about: &LightRaysAbout<'_>,
    knobs: LightKnobs,
) -> Vec<Vec3> {
    let alone = match texels.effort {
        Effort::Whole { rays } => Some(disc_points(rays)),
        Effort::Shared => None,
    };
    let pattern = Pattern::of_disc(knobs.sky_rays as usize);
    let cast = |index: usize| {
        let texel = &texels.all[index];
        let (mut seen, mut whole) = (Vec3::ZERO, Vec3::ZERO);
        if !texel.exists {
            return (seen, whole);
        }
        let mut cast = |disc: Vec2| {
            let direction = above(texel.normal, disc);
            let radiance = sky_radiance(sky, direction);
            whole += radiance;
            if texel.sees(about, direction, f32::MAX) {
                seen += radiance;
            }
        };
        match &alone {
            Some(all) => all.iter().for_each(|&disc| cast(disc)),
            None => pattern.of_slot(texels.slot(index)).for_each(cast),
        }
        (seen, whole)
    };
    let sums = (0..texels.all.len()).into_par_iter().with_min_len(256).map(cast);
    let (seen, whole): (Vec<Vec3>, Vec<Vec3>) = sums.unzip();
    // Each sum by itself: the mean of ratios of a few rays would favour directions in which the sky is dark.
    let shared = |sums| if knobs.filter { smoothed(sums, texels) } else { sums };
    let (seen, whole) = (shared(seen), shared(whole));
    let ratio = |seen: f32, whole: f32| if whole > 0.0 { seen / whole } else { 0.0 };
    let share = |(seen, whole): (Vec3, Vec3)| {
        Vec3::new(ratio(seen.x, whole.x), ratio(seen.y, whole.y), ratio(seen.z, whole.z))
    };
    seen.into_par_iter().zip(whole).map(share).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_even_sky_has_the_same_irradiance_for_every_normal() {
        let sky = Sky { zenith: Vec3::ONE, horizon: Vec3::ONE, ground: Vec3::ONE };
        let irradiance = SkyIrradiance::new(&sky);
        for y in [-1.0, -0.3, 0.0, 0.7, 1.0] {
            let normal = Vec3::new((1.0f32 - y * y).sqrt(), y, 0.0);
            assert!((irradiance.by_pi(normal) - Vec3::ONE).abs().max_element() < 1e-5);
        }
        assert!(SkyIrradiance::new(&Sky::BLACK).is_black());
    }

    #[test]
    fn the_table_is_the_integral_of_the_gradient() {
        // Upwards: ∫ lerp(horizon, zenith, y) over the cosine-weighted hemisphere has a mean height of 2/3.
        let sky = Sky { zenith: Vec3::ONE, horizon: Vec3::ZERO, ground: Vec3::ZERO };
        let up = SkyIrradiance::new(&sky).by_pi(Vec3::Y);
        assert!((up.x - 2.0 / 3.0).abs() < 1e-3, "{up}");
    }
}
