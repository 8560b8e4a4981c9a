//! Distances along a few rays from one origin, each with its own length.

use glam::DVec3;

use super::lanes::{LANES, Lanes, Plain};
use super::packet::Nearest;
use super::{About, PacketTracer};

/// Vectors of a packet. Few, because such rays are spread over a whole view and share little.
const VECTORS: usize = 2;

/// A ray from the common origin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Ray {
    /// Direction; its length is the unit of distance.
    pub(crate) direction: DVec3,
    /// Length of the ray, in units of the direction.
    pub(crate) most: f32,
}

impl PacketTracer {
    /// Distance to the nearest surface along each ray, in units of its direction. `None` if the ray ends first, is not
    /// finite or has no direction. Runs on the calling thread.
    pub(crate) fn distances(&self, eye: DVec3, rays: &[Ray]) -> Vec<Option<f32>> {
        let mut found = vec![None; rays.len()];
        if eye.is_finite() {
            About::new(self, eye).distances(rays, &mut found);
        }
        found
    }
}

impl About<'_> {
    fn distances(&self, rays: &[Ray], found: &mut [Option<f32>]) {
        #[cfg(target_arch = "x86_64")]
        {
            use super::lanes::avx2::Avx2;

            #[target_feature(enable = "avx2")]
            fn with_avx2(about: &About<'_>, rays: &[Ray], found: &mut [Option<f32>]) {
                about.distances_by::<Avx2>(rays, found);
            }
            if is_x86_feature_detected!("avx2") {
                // SAFETY: the processor has what the function is compiled for.
                return unsafe { with_avx2(self, rays, found) };
            }
        }
        self.distances_by::<Plain>(rays, found);
    }

    #[inline(always)]
    fn distances_by<L: Lanes>(&self, mut rays: &[Ray], mut found: &mut [Option<f32>]) {
        let mut stack = Vec::new();
        while !rays.is_empty() {
            let share = if rays.len() > LANES { LANES * VECTORS } else { LANES }.min(rays.len());
            let (some, rest) = rays.split_at(share);
            let (out, left) = std::mem::take(&mut found).split_at_mut(share);
            match share > LANES {
                true => self.some_distances::<L, VECTORS>(some, out, &mut stack),
                false => self.some_distances::<L, 1>(some, out, &mut stack),
            }
            (rays, found) = (rest, left);
        }
    }

    /// Traces one packet of at least one ray.
    #[inline(always)]
    fn some_distances<L: Lanes, const V: usize>(
        &self,
        rays: &[Ray],
        found: &mut [Option<f32>],
        stack: &mut Vec<u32>,
    ) {
        let mut packet = [[L::splat(0.0); 3]; V];
        let mut nearest = Nearest::none();
        for (v, packet) in packet.iter_mut().enumerate() {
            // Unused lanes repeat the last ray.
            let ray = |lane: usize| usable(rays[(v * LANES + lane).min(rays.len() - 1)]);
            let lanes: [Ray; LANES] = std::array::from_fn(ray);
            let along = |axis: usize| L::from_array(lanes.map(|ray| ray.direction[axis] as f32));
            *packet = [along(0), along(1), along(2)];
            nearest.t[v] = L::from_array(lanes.map(|ray| ray.most));
        }
        self.packet(&packet, &mut nearest, stack);
        for (at, found) in found.iter_mut().enumerate() {
            let (v, lane) = (at / LANES, at % LANES);
            let hit = nearest.ids[v][lane][0] != 0;
            *found = hit.then(|| nearest.t[v].to_array()[lane]);
        }
    }
}

/// The ray, or a ray of length 0 if it is invalid.
fn usable(ray: Ray) -> Ray {
    let Ray { direction, most } = ray;
    match direction.as_vec3().is_finite() && direction.as_vec3() != glam::Vec3::ZERO && most > 0.0 {
        true => ray,
        false => Ray { direction: DVec3::Z, most: 0.0 },
    }
}
