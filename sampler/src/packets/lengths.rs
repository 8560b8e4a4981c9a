//! Distances along a few rays from one place, each of a length of its own.

use glam::DVec3;

use super::lanes::{LANES, Lanes, Plain};
use super::packet::Nearest;
use super::{About, PacketTracer};

/// Vectors of a packet, where there are more rays than one holds: such rays are spread over a whole view, and share little.
const VECTORS: usize = 2;

/// A ray from the place that all start from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Ray {
    /// Which way, and how long one unit of distance is.
    pub(crate) direction: DVec3,
    /// Nothing farther away is of interest, in units of the direction.
    pub(crate) most: f32,
}

impl PacketTracer {
    /// How far along each ray the nearest surface is, in units of its direction; `None` where there is none before the ray ends.
    /// A ray that is not finite or has no direction meets nothing. Everything is done on the thread that asks.
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

    /// At most as many rays as a packet holds, and at least one.
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
            // Lanes that are left over repeat the last ray, which costs nothing.
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

/// The ray, or one that ends where it starts.
fn usable(ray: Ray) -> Ray {
    let Ray { direction, most } = ray;
    match direction.as_vec3().is_finite() && direction.as_vec3() != glam::Vec3::ZERO && most > 0.0 {
        true => ray,
        false => Ray { direction: DVec3::Z, most: 0.0 },
    }
}
