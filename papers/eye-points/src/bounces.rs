//! Reflections of reflections, by lookups alone (section 4.1.4).
//!
//! A tap may meet a point of another reflector. Rays reflected from there are looked up in the map of that reflector, and so on:
//! no pass over the scene is added. What is shaded once a point is its diffuse part; what it reflects depends on the map
//! that sees it, and is found again for each tap. A point is seen from the middle of the map that shows it.

use argus_scene::Sky;
use argus_scene::shading::sky_radiance;
use glam::{DVec2, DVec3, Vec3};
use rayon::prelude::*;

use super::lookup::lookup;
use super::{Lookups, Reflected, ReflectivePixel, Requests, Stages};
use argus_sampler::plug::IndexMaps;

/// How a map sees a place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sight {
    /// The middle of the map, metres, world space.
    pub from: DVec3,
    /// Direction towards the place, and those of the next texel on either axis; not of unit length.
    pub directions: [DVec3; 3],
}

/// A reflective place that a map sees.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mirror {
    /// Its reflector, and how its normal changes from texel to texel of the map that sees it.
    pub pixel: ReflectivePixel,
    /// Reflected radiance towards the map's middle, over arriving radiance.
    pub reflectance: Vec3,
}

/// The surfaces that ids stand for.
pub trait Surfaces: Sync {
    /// Radiance of an id, equal in all directions.
    fn diffuse(&self, id: u32) -> Vec3;

    /// An id as a mirror; `None` for a surface of no reflector with a map.
    fn mirror(&self, id: u32, sight: &Sight) -> Option<Mirror>;
}

/// What pixels reflect after several bounces.
pub struct Bounces<'a, S> {
    /// Maps, pixels and the taps of the first bounce.
    pub lookups: Lookups<'a>,
    /// Offsets of taps of the second bounce and all after it, in texels of the map that sees a place. The paper takes four.
    pub later_taps: &'a [DVec2],
    /// Number of bounces, at least 1.
    pub bounces: u32,
    /// The surfaces.
    pub surfaces: &'a S,
}

impl<S: Surfaces> Bounces<'_, S> {
    /// Requests, shades and looks up what the pixels reflect. `count` is the number of ids, and `id_of` gives that of a texel
    /// from the id that is stored there.
    pub fn reflect(&self, sky: &Sky, count: usize, id_of: impl Fn(usize, u32) -> u32 + Sync) -> Reflected {
        let mut stages = Stages::new();
        let requests = Requests::none(count);
        self.each_pixel(sky, &id_of, &|id| {
            requests.add(id);
            Vec3::ZERO
        });
        let requests = requests.counted();
        let ids = requests.ids();
        stages.end("request");
        let shaded: Vec<Vec3> =
            ids.par_iter().with_min_len(64).map(|&id| self.surfaces.diffuse(id)).collect();
        stages.end("shade");
        let radiance = self.each_pixel(sky, &id_of, &|id| shaded[requests.slot(id)]);
        stages.end("mirror");
        let bytes = requests.bytes() + size_of_val(&shaded[..]);
        Reflected { radiance, shades: shaded.len(), bytes, stages: stages.all() }
    }

    fn each_pixel(
        &self,
        sky: &Sky,
        id_of: &(impl Fn(usize, u32) -> u32 + Sync),
        diffuse: &(impl Fn(u32) -> Vec3 + Sync),
    ) -> Vec<Vec3> {
        let walk = Walk { bounces: self, sky, id_of, diffuse };
        let of_pixel = |pixel: &ReflectivePixel| walk.arriving(pixel, self.lookups.eye, 1);
        self.lookups.pixels.par_iter().with_min_len(16).map(of_pixel).collect()
    }
}

/// A walk along all taps of a pixel.
struct Walk<'a, 'b, S, I, D> {
    bounces: &'a Bounces<'b, S>,
    sky: &'a Sky,
    id_of: &'a I,
    diffuse: &'a D,
}

impl<S: Surfaces, I: Fn(usize, u32) -> u32, D: Fn(u32) -> Vec3> Walk<'_, '_, S, I, D> {
    /// Mean radiance that arrives along reflected rays of a bounce.
    fn arriving(&self, pixel: &ReflectivePixel, eye: DVec3, bounce: u32) -> Vec3 {
        let Bounces { lookups, later_taps, bounces, surfaces } = self.bounces;
        let taps = if bounce == 1 { lookups.taps } else { later_taps };
        let maps: &IndexMaps = lookups.maps;
        let map = pixel.reflector as usize;
        let center = lookups.reflectors[map].center;
        let mut sum = Vec3::ZERO;
        for &tap in taps {
            let (origin, direction) = pixel.ray(eye, tap);
            let texel = lookup(maps, map, origin - center, direction, lookups.steps);
            let Some((seen, _)) = maps.get(texel) else {
                sum += sky_radiance(self.sky, direction.as_vec3());
                continue;
            };
            let id = (self.id_of)(texel, seen);
            sum += (self.diffuse)(id);
            if bounce < *bounces {
                let sight = Sight { from: center, directions: maps.neighbourhood(texel) };
                if let Some(mirror) = surfaces.mirror(id, &sight) {
                    sum += mirror.reflectance * self.arriving(&mirror.pixel, center, bounce + 1);
                }
            }
        }
        sum / taps.len().max(1) as f32
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{MappedReflector, STEPS};

    /// Two reflectors whose maps see only each other, or only a lamp. Ids: 0 and 1 are the reflectors, 2 is the lamp.
    struct Facing;

    impl Surfaces for Facing {
        fn diffuse(&self, id: u32) -> Vec3 {
            if id == 2 { Vec3::ONE } else { Vec3::ZERO }
        }

        fn mirror(&self, id: u32, sight: &Sight) -> Option<Mirror> {
            if id == 2 {
                return None;
            }
            assert_eq!(sight.from.x, f64::from(1 - id) * 10.0, "seen from the other map");
            Some(Mirror { pixel: pixel(id), reflectance: Vec3::splat(0.5) })
        }
    }

    fn pixel(reflector: u32) -> ReflectivePixel {
        ReflectivePixel {
            reflector,
            position: DVec3::X * f64::from(reflector) * 10.0 + DVec3::Y,
            normal: DVec3::Y,
            position_steps: [DVec3::ZERO; 2],
            normal_steps: [DVec3::ZERO; 2],
        }
    }

    fn radiance(bounces: u32, lamp_in: usize) -> (f32, usize) {
        let reflector = |at: f64| MappedReflector {
            instance: at as u32,
            center: DVec3::X * at * 10.0,
            radius: 1.0,
            curvature: 1.0,
            side: 32,
            front: None,
        };
        let reflectors = [reflector(0.0), reflector(1.0)];
        let maps = IndexMaps::new(&reflectors);
        for texel in 0..maps.texels() {
            let (map, _) = maps.direction_of(texel);
            maps.write(texel, 10.0, if map == lamp_in { 2 } else { 1 - map as u32 });
        }
        let pixels = [pixel(0)];
        let lookups = Lookups {
            maps: &maps,
            reflectors: &reflectors,
            eye: DVec3::new(-5.0, 5.0, 0.0),
            pixels: &pixels,
            taps: &[DVec2::ZERO, DVec2::X],
            steps: STEPS,
        };
        let later = [DVec2::ZERO; 4];
        let found = Bounces { lookups, later_taps: &later, bounces, surfaces: &Facing }.reflect(
            &Sky::BLACK,
            3,
            |_, id| id,
        );
        (found.radiance[0].x, found.shades)
    }

    #[test]
    fn a_second_bounce_finds_the_lamp_that_the_first_does_not() {
        // The first map sees only the second reflector, whose map sees the lamp.
        assert_eq!(radiance(1, 1), (0.0, 1));
        assert_eq!(radiance(2, 1), (0.5, 2));
        assert_eq!(radiance(3, 1), (0.5, 2), "the lamp reflects nothing");
    }

    #[test]
    fn each_point_is_shaded_once_in_however_many_bounces() {
        // Both maps see only each other.
        assert_eq!([1, 2, 3].map(|bounces| radiance(bounces, 7).1), [1, 2, 2]);
        assert_eq!(radiance(3, 7).0, 0.0);
        assert_eq!(radiance(3, 0), (1.0, 1), "the lamp is met at once");
    }
}
