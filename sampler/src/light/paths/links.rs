//! Rays of leaf sides, traced once, and the light that goes along them.

use argus_scene::Sky;
use argus_scene::light_sampling::{disc_point, r2};
use argus_scene::shading::sky_radiance;
use glam::{DVec2, Vec3};
use rayon::prelude::*;

use super::super::pattern::{above, hash};
use super::super::shading_points::ShadingPoint;
use super::leaves::Leaves;
use crate::light_rays::LightRaysAbout;
use crate::surfaces::Surfaces;

/// Target of a ray that leaves the scene.
const SKY: u32 = u32::MAX;
/// Target of a ray that brings no light.
const DARK: u32 = u32::MAX - 1;

/// For each leaf side, the leaf sides that its rays hit.
pub(in crate::light) struct Links {
    targets: Vec<u32>,
    rays: usize,
    /// Directions of rays by cosine, as points of the unit square: each leaf side shifts them.
    squares: Vec<DVec2>,
}

impl Links {
    /// Casts the rays of all leaf sides, `rays` each.
    pub(in crate::light) fn trace(
        leaves: &Leaves,
        surfaces: &Surfaces,
        about: &LightRaysAbout<'_>,
        rays: usize,
    ) -> Self {
        let squares = (0..rays).map(|ray| r2(ray as u32 + 1)).collect();
        let mut links = Self { targets: Vec::new(), rays, squares };
        let target = |index: usize| {
            let point = leaves.texel(surfaces, about, index);
            let number = leaves.sides[index / rays].number();
            let direction = links.direction(number, index % rays, point.normal);
            // Interpolated normals allow directions below the triangle.
            if !(point.exists && direction.dot(point.side) > 0.0) {
                return DARK;
            }
            match about.nearest(point.start, direction, f32::MAX) {
                None => SKY,
                Some(hit) => leaves.hit(point.start, direction, &hit).unwrap_or(DARK),
            }
        };
        let count = leaves.sides.len() * rays;
        links.targets = (0..count).into_par_iter().with_min_len(256).map(target).collect();
        links
    }

    /// Rays of each leaf side.
    pub(in crate::light) fn rays(&self) -> usize {
        self.rays
    }

    /// The unit direction of a ray of the leaf side with that number.
    fn direction(&self, number: u32, ray: usize, normal: Vec3) -> Vec3 {
        let disc = disc_point((self.squares[ray] + hash(number)).fract()).as_vec2();
        above(normal, disc)
    }

    /// Sum of the sky's radiance along the rays of a leaf side that reach it. `points` are where they start.
    pub(in crate::light) fn sky(
        &self,
        leaves: &Leaves,
        side: usize,
        points: &[ShadingPoint],
        sky: &Sky,
    ) -> Vec3 {
        let number = leaves.sides[side].number();
        let targets = &self.targets[side * self.rays..(side + 1) * self.rays];
        let reaches = targets.iter().zip(points).enumerate().filter(|(_, (target, _))| **target == SKY);
        reaches.map(|(ray, (_, point))| sky_radiance(sky, self.direction(number, ray, point.normal))).sum()
    }

    /// Irradiance / π of leaf sides after some bounces from leaf side to leaf side, direct light included.
    pub(in crate::light) fn bounce(&self, leaves: &Leaves, direct: &[Vec3], bounces: u32) -> Vec<Vec3> {
        let mut all = direct.to_vec();
        for _ in 0..bounces {
            let radiance = leaves.reflected(&all);
            let arriving = |(targets, direct): (&[u32], &Vec3)| {
                // Neither sky nor darkness is a leaf side.
                let sum: Vec3 = targets.iter().filter_map(|target| radiance.get(*target as usize)).sum();
                *direct + sum / self.rays as f32
            };
            all = self.targets.par_chunks(self.rays).zip(direct).map(arriving).collect();
        }
        all
    }
}
