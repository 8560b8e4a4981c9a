//! Deferred shading: what the eye sees in reflections is requested, and shaded once (sections 4.1.2 and 4.1.3).

use argus_scene::Sky;
use argus_scene::shading::sky_radiance;
use glam::{DVec2, DVec3, Vec3};
use rayon::prelude::*;

use argus_sampler::plug::{IndexMaps, MappedReflector, Requests};

use super::lookup::lookup;

/// A pixel of the eye in which a reflector is seen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReflectivePixel {
    /// Index into the list of reflectors.
    pub reflector: u32,
    /// What the pixel's central ray meets, metres, world space.
    pub position: DVec3,
    /// Unit shading normal there, on the visible side.
    pub normal: DVec3,
    /// Change of the position to the next pixel on the right and below, metres.
    pub position_steps: [DVec3; 2],
    /// Change of the normal to the next pixel on the right and below.
    pub normal_steps: [DVec3; 2],
}

impl ReflectivePixel {
    /// Origin and unit direction of the reflected ray at an offset from the pixel's middle, in pixels.
    pub fn ray(&self, eye: DVec3, offset: DVec2) -> (DVec3, DVec3) {
        let [right, down] = self.position_steps;
        let position = self.position + right * offset.x + down * offset.y;
        let [right, down] = self.normal_steps;
        let normal = (self.normal + right * offset.x + down * offset.y).normalize_or(self.normal);
        let direction = (position - eye).normalize_or(-normal);
        (position, direction - 2.0 * direction.dot(normal) * normal)
    }
}

/// What the taps of the eye look up.
pub struct Lookups<'a> {
    /// The maps.
    pub maps: &'a IndexMaps,
    /// Their reflectors.
    pub reflectors: &'a [MappedReflector],
    /// The eye, metres, world space.
    pub eye: DVec3,
    /// The reflective pixels.
    pub pixels: &'a [ReflectivePixel],
    /// Offsets of taps, in pixels.
    pub taps: &'a [DVec2],
    /// Impostor steps of a lookup.
    pub steps: u32,
}

impl Lookups<'_> {
    /// The texel of a tap, and the tap's direction.
    #[inline]
    pub(super) fn texel(&self, pixel: &ReflectivePixel, tap: DVec2) -> (usize, DVec3) {
        let map = pixel.reflector as usize;
        let (origin, direction) = pixel.ray(self.eye, tap);
        let about = origin - self.reflectors[map].center;
        (lookup(self.maps, map, about, direction, self.steps), direction)
    }

    /// Marks what all taps meet. `count` is the number of ids, and `id_of` gives that of a texel: the point that it sees, or
    /// the texel itself.
    pub fn request(&self, count: usize, id_of: impl Fn(usize, u32) -> u32 + Sync) -> Requests {
        let mut requests = Requests::none(count);
        let mut texels = vec![0u32; self.pixels.len() * self.taps.len()];
        let of_pixel = texels.par_chunks_mut(self.taps.len().max(1)).zip(self.pixels).with_min_len(64);
        of_pixel.for_each(|(texels, pixel)| {
            for (found, &tap) in texels.iter_mut().zip(self.taps) {
                let (texel, _) = self.texel(pixel, tap);
                *found = texel as u32;
                if let Some((seen, _)) = self.maps.get(texel) {
                    requests.add(id_of(texel, seen));
                }
            }
        });
        requests.texels = texels;
        requests.counted()
    }

    /// The mean radiance that each pixel's taps meet. `shaded` has that of all requested ids, ascending.
    pub fn mirror(
        &self,
        requests: &Requests,
        shaded: &[Vec3],
        sky: &Sky,
        id_of: impl Fn(usize, u32) -> u32 + Sync,
    ) -> Vec<Vec3> {
        let taps = self.taps.len();
        let radiance = |(number, pixel): (usize, &ReflectivePixel)| {
            let mut sum = Vec3::ZERO;
            for (tap, &offset) in self.taps.iter().enumerate() {
                let texel = match requests.texels.get(number * taps + tap) {
                    Some(&texel) => texel as usize,
                    None => self.texel(pixel, offset).0,
                };
                sum += match self.maps.get(texel) {
                    Some((seen, _)) => shaded[requests.slot(id_of(texel, seen))],
                    None => sky_radiance(sky, pixel.ray(self.eye, offset).1.as_vec3()),
                };
            }
            sum / taps.max(1) as f32
        };
        self.pixels.par_iter().enumerate().with_min_len(64).map(radiance).collect()
    }

    /// Where each pixel's central tap says that its ray ends, metres, world space; `None` for the sky.
    pub fn met(&self) -> Vec<Option<DVec3>> {
        let met = |pixel: &ReflectivePixel| {
            let (texel, _) = self.texel(pixel, DVec2::ZERO);
            let (_, range) = self.maps.get(texel)?;
            let (map, direction) = self.maps.direction_of(texel);
            Some(self.reflectors[map].center + direction.normalize() * range)
        };
        self.pixels.par_iter().map(met).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ray_is_reflected_about_the_normal_at_the_tap() {
        let pixel = ReflectivePixel {
            reflector: 0,
            position: DVec3::ZERO,
            normal: DVec3::Y,
            position_steps: [DVec3::X * 0.1, DVec3::Z * 0.1],
            normal_steps: [DVec3::X * 0.2, DVec3::ZERO],
        };
        let eye = DVec3::new(-3.0, 4.0, 0.0);
        let (origin, direction) = pixel.ray(eye, DVec2::ZERO);
        assert_eq!(origin, DVec3::ZERO);
        assert!((direction - DVec3::new(0.6, 0.8, 0.0)).length() < 1e-12);
        let (origin, direction) = pixel.ray(eye, DVec2::new(2.0, 0.0));
        assert_eq!(origin, DVec3::X * 0.2);
        let (to_eye, normal) = ((eye - origin).normalize(), DVec3::new(0.4, 1.0, 0.0).normalize());
        assert!((direction.angle_between(normal) - to_eye.angle_between(normal)).abs() < 1e-9);
    }
}
