//! Exact maps of VPLs, by rays through the centres of texels: the reference at that resolution.

use argus_scene::{Bounds, paraboloid};
use glam::DVec3;
use rayon::prelude::*;

use super::paths::Vpl;
use argus_sampler::plug::{PacketTracer, Surfaces, mixed};

/// Distances as f32 bits, two hemispheres of `side`² texels a VPL. The largest f32 without a hit, and in directions that
/// a VPL does not light.
pub(crate) fn exact(tracer: &PacketTracer, vpls: &[Vpl], side: u32) -> Vec<u32> {
    let texels = 2 * side * side;
    let rays: Vec<(u32, DVec3)> = (0..texels)
        .filter(|&texel| paraboloid::is_inside(texel, side))
        .map(|texel| (texel, paraboloid::center_of(texel, side)))
        .collect();
    let mut maps = vec![f32::MAX.to_bits(); vpls.len() * texels as usize];
    maps.par_chunks_mut(texels as usize).zip(vpls).for_each(|(map, vpl)| {
        let normal = vpl.normal.as_dvec3();
        let shines = |direction: &DVec3| direction.dot(normal) > 0.0 || normal == DVec3::ZERO;
        for &(texel, direction) in rays.iter().filter(|(_, direction)| shines(direction)) {
            if let Some(hit) = tracer.nearest(vpl.position, direction, f64::from(f32::MAX)) {
                map[texel as usize] = (hit.t as f32).to_bits();
            }
        }
    });
    maps
}

/// Random points on a scene's surfaces, uniform by area, relative to `root`.
pub(crate) fn surface_points(surfaces: &Surfaces, bounds: Bounds, count: u32, seed: u32) -> Vec<[f32; 4]> {
    let root = bounds.center();
    let mut triangles = Vec::new();
    let mut area = 0.0;
    for corners in surfaces.triangles() {
        let at = corners.map(|corner| corner - root);
        let own = (at[1] - at[0]).cross(at[2] - at[0]).length() * 0.5;
        if own > 0.0 && own.is_finite() {
            area += own;
            triangles.push((area, at));
        }
    }
    let point = |index: u32| {
        let number = |k: u64| mixed(u64::from(seed) << 40 ^ u64::from(index) << 4 ^ k);
        // Stratified over the scene's area.
        let wanted = (f64::from(index) + number(0)) / f64::from(count) * area;
        let at = triangles.partition_point(|(up_to, _)| *up_to <= wanted).min(triangles.len() - 1);
        let [a, b, c] = triangles[at].1;
        let (root_of_u, v) = (number(1).sqrt(), number(2));
        let p = a + (b - a) * (root_of_u * (1.0 - v)) + (c - a) * (root_of_u * v);
        p.as_vec3().extend(0.0).to_array()
    };
    if triangles.is_empty() { Vec::new() } else { (0..count).into_par_iter().map(point).collect() }
}
