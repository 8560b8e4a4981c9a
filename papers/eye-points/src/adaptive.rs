//! The paper's adaptive number of taps: four are added to a pixel until the variance of its colour declines no more (section
//! 4.1.3).

use argus_scene::shading::sky_radiance;
use argus_scene::{Sky, Stage};
use glam::{DVec2, Vec3};
use rayon::prelude::*;

use super::{Lookups, Reflected, Requests, Stages};

/// Taps that are added to a pixel at a time.
const STEP: usize = 4;
/// Radiance of ids that are not shaded yet.
const UNSHADED: Vec3 = Vec3::NAN;

/// What the taps of a pixel have met so far.
#[derive(Debug, Clone, Copy)]
struct Sampled {
    count: u32,
    mean: Vec3,
    /// Sum of the squared differences from the mean.
    squares: Vec3,
    /// Variance of the colour, after the last taps.
    variance: f32,
    /// Whether the last taps have lowered the variance.
    declines: bool,
}

impl Sampled {
    const NONE: Self =
        Self { count: 0, mean: Vec3::ZERO, squares: Vec3::ZERO, variance: f32::INFINITY, declines: true };

    /// With some taps more (Welford, 1962).
    fn and(mut self, taps: impl Iterator<Item = Vec3>) -> Self {
        for radiance in taps {
            self.count += 1;
            let before = radiance - self.mean;
            self.mean += before / self.count as f32;
            self.squares += before * (radiance - self.mean);
        }
        let variance = self.squares.element_sum() / self.count.saturating_sub(1).max(1) as f32;
        // No variance is below none.
        self.declines = variance < self.variance && variance > 0.0;
        self.variance = variance;
        self
    }
}

/// Requests, shades and looks up what pixels reflect, with as many of the taps as each pixel needs, and the number of lookups.
/// Each id is shaded once. Arguments are those of [`super::reflect`].
pub fn reflect_adaptively(
    lookups: &Lookups<'_>,
    sky: &Sky,
    count: usize,
    id_of: impl Fn(usize, u32) -> u32 + Sync,
    shade: impl Fn(u32) -> Vec3 + Sync,
) -> (Reflected, u64) {
    let mut shaded = vec![UNSHADED; count];
    let mut pixels = vec![Sampled::NONE; lookups.pixels.len()];
    let mut active: Vec<u32> = (0..pixels.len() as u32).collect();
    let (mut shades, mut made, mut largest) = (0, 0, 0);
    let mut stages: [Stage; 3] = ["request", "shade", "mirror"].map(|name| Stage::new(name, 0.0));
    for taps in evenly_ordered(lookups.taps).chunks(STEP) {
        let mut clock = Stages::new();
        let requests = Requests::none(count);
        let mut texels = vec![0u32; active.len() * taps.len()];
        let of_pixel = texels.par_chunks_mut(taps.len()).zip(&active).with_min_len(64);
        of_pixel.for_each(|(texels, &pixel)| {
            for (found, &tap) in texels.iter_mut().zip(taps) {
                let (texel, _) = lookups.texel(&lookups.pixels[pixel as usize], tap);
                *found = texel as u32;
                let id = lookups.maps.get(texel).map(|(seen, _)| id_of(texel, seen));
                if let Some(id) = id.filter(|&id| shaded[id as usize].is_nan()) {
                    requests.add(id);
                }
            }
        });
        let fresh = requests.ids();
        clock.end("request");
        let radiance: Vec<Vec3> = fresh.par_iter().with_min_len(64).map(|&id| shade(id)).collect();
        fresh.iter().zip(radiance).for_each(|(&id, radiance)| shaded[id as usize] = radiance);
        clock.end("shade");
        let met = |pixel: u32, texel: u32, tap: DVec2| match lookups.maps.get(texel as usize) {
            Some((seen, _)) => shaded[id_of(texel as usize, seen) as usize],
            None => sky_radiance(sky, lookups.pixels[pixel as usize].ray(lookups.eye, tap).1.as_vec3()),
        };
        let sample = |(texels, &pixel): (&[u32], &u32)| {
            let taps = texels.iter().zip(taps).map(|(&texel, &tap)| met(pixel, texel, tap));
            pixels[pixel as usize].and(taps)
        };
        let sampled: Vec<Sampled> =
            texels.par_chunks(taps.len()).zip(&active).with_min_len(64).map(sample).collect();
        active.iter().zip(sampled).for_each(|(&pixel, sampled)| pixels[pixel as usize] = sampled);
        clock.end("mirror");
        stages.iter_mut().zip(clock.all()).for_each(|(sum, stage)| sum.ms += stage.ms);
        made += texels.len() as u64;
        shades += fresh.len();
        largest = largest.max(requests.bytes() + size_of_val(&texels[..]));
        active.retain(|&pixel| pixels[pixel as usize].declines);
    }
    let bytes = size_of_val(&shaded[..]) + size_of_val(&pixels[..]) + largest;
    let radiance = pixels.into_iter().map(|pixel| pixel.mean).collect();
    (Reflected { radiance, shades, bytes, stages: stages.into() }, made)
}

/// Taps in an order in which the first few are spread over all: steps near the golden section of their number.
fn evenly_ordered(taps: &[DVec2]) -> Vec<DVec2> {
    let count = taps.len();
    let divisor = |mut a: usize, mut b: usize| {
        while b > 0 {
            (a, b) = (b, a % b);
        }
        a
    };
    let golden = (count as f64 * 0.618).round() as usize;
    let step = (golden..).find(|&step| divisor(step, count) == 1).unwrap_or(1);
    (0..count).map(|k| taps[k * step % count]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use argus_sampler::plug::taps;

    use crate::{IndexMaps, MappedReflector, ReflectivePixel, STEPS, reflect};
    use glam::DVec3;

    #[test]
    fn a_reordered_tap_is_still_there_and_the_first_four_surround_the_middle() {
        for count in [0, 1, 2, 4, 9, 25, 100] {
            let (all, ordered) = (taps(count.max(1)), evenly_ordered(&taps(count.max(1))));
            assert!(ordered.iter().all(|tap| all.contains(tap)));
            assert!(all.iter().all(|tap| ordered.contains(tap)), "{count}");
        }
        let first = &evenly_ordered(&taps(25))[..STEP];
        let farthest = first.iter().map(|tap| tap.length()).fold(0.0, f64::max);
        assert!(farthest > 0.35, "of 0.56: {farthest}");
        assert!(evenly_ordered(&[]).is_empty());
    }

    #[test]
    fn variance_that_no_longer_declines_or_is_none_ends_a_pixel() {
        let grey = |values: &[f32]| values.iter().map(|&v| Vec3::splat(v)).collect::<Vec<_>>();
        let same = Sampled::NONE.and(grey(&[0.5; 4]).into_iter());
        assert!(!same.declines && same.mean == Vec3::splat(0.5));
        let first = Sampled::NONE.and(grey(&[0.0, 1.0, 0.0, 1.0]).into_iter());
        assert!(first.declines);
        assert!((first.variance - 1.0).abs() < 1e-6, "three channels of a third each: {}", first.variance);
        assert!(first.and(grey(&[0.5; 4]).into_iter()).declines);
        assert!(!first.and(grey(&[2.0, -2.0, 2.0, -2.0]).into_iter()).declines);
    }

    /// A map whose ids are its texels; its upper half sees a chequered wall, and the rest a plain one.
    fn chequered(id: u32) -> Vec3 {
        let (column, row) = (id % 32, id / 32 % 32);
        Vec3::splat(if row < 16 { ((column + row) % 2) as f32 } else { 0.25 })
    }

    #[test]
    fn plain_pixels_take_four_taps_and_others_come_close_to_all_taps() {
        let reflector = MappedReflector {
            instance: 0,
            center: DVec3::ZERO,
            radius: 0.5,
            curvature: 2.0,
            side: 32,
            front: None,
        };
        let maps = IndexMaps::new(&[reflector]);
        (0..maps.texels()).for_each(|texel| maps.write(texel, 3.0, texel as u32));
        let pixel = |i: i32| ReflectivePixel {
            reflector: 0,
            position: DVec3::Z * 0.5,
            normal: DVec3::new(f64::from(i) * 0.01, f64::from(i % 7) * 0.05, 1.0).normalize(),
            position_steps: [DVec3::X * 0.01, DVec3::Y * 0.01],
            normal_steps: [DVec3::X * 0.05, DVec3::Y * 0.05],
        };
        let pixels: Vec<ReflectivePixel> = (-40..40).map(pixel).collect();
        let (eye, taps) = (DVec3::Z * 4.0, taps(25));
        let lookups = Lookups {
            maps: &maps,
            reflectors: &[reflector],
            eye,
            pixels: &pixels,
            taps: &taps,
            steps: STEPS,
        };
        let go = |shade: &(dyn Fn(u32) -> Vec3 + Sync)| {
            reflect_adaptively(&lookups, &Sky::BLACK, maps.texels(), |texel, _| texel as u32, shade)
        };
        let (plain, made) = go(&|_| Vec3::ONE);
        assert_eq!(made, 4 * pixels.len() as u64);
        assert!(plain.radiance.iter().all(|radiance| *radiance == Vec3::ONE));
        let (adaptive, made) = go(&chequered);
        let all = reflect(&lookups, &Sky::BLACK, maps.texels(), |texel, _| texel as u32, chequered);
        assert!(made > 4 * pixels.len() as u64 && made < 25 * pixels.len() as u64, "{made}");
        assert!(adaptive.shades <= all.shades && adaptive.shades > 0);
        let off = adaptive.radiance.iter().zip(&all.radiance).map(|(a, b)| (a.x - b.x).abs());
        let off = off.sum::<f32>() / pixels.len() as f32;
        assert!(off > 0.0 && off < 0.15, "{off}");
    }

    #[test]
    fn no_pixel_and_no_tap_are_no_lookup() {
        let maps = IndexMaps::new(&[]);
        let lookups =
            Lookups { maps: &maps, reflectors: &[], eye: DVec3::ZERO, pixels: &[], taps: &[], steps: STEPS };
        let (found, made) = reflect_adaptively(&lookups, &Sky::BLACK, 0, |_, id| id, |_| Vec3::ONE);
        assert_eq!((found.radiance.len(), found.shades, made), (0, 0, 0));
    }
}
