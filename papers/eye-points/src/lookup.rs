//! What a reflected ray meets, looked up in a map.
//!
//! A map is seen from the middle of its reflector, and a reflected ray begins on the reflector's surface. The paper looks the
//! ray's direction up and accepts the error of parallax. Steps of an impostor remove most of it (Szirmay-Kalos et al.,
//! "Approximate Ray-Tracing on the GPU with Distance Impostors", 2005): what a texel sees is extended, the ray meets
//! that, and the direction from the middle to the place where it does is looked up next. Their impostor is a sphere of the
//! texel's range. A plane through the ranges of the texel and its neighbours fits walls, and needs fewer steps.

use glam::DVec3;

use argus_sampler::plug::IndexMaps;

/// Steps after the first lookup, for reflections within a degree of traced ones in most pixels.
pub const STEPS: u32 = 3;
/// A ray is met by a plane at most at this many times the texel's range: beyond it, noise of ranges decides.
const FARTHEST: f64 = 8.0;

/// The texel that shows what a ray meets. `origin` is relative to the middle of the map, metres; `direction` is a unit
/// vector. Without steps it is the texel of the direction.
#[inline]
pub fn lookup(maps: &IndexMaps, map: usize, origin: DVec3, direction: DVec3, steps: u32) -> usize {
    let mut texel = maps.texel_of(map, direction);
    for _ in 0..steps {
        // Sky has no parallax.
        let towards = match maps.get(texel) {
            None => direction,
            Some((_, range)) => {
                let along = match plane(maps, map, texel, origin, direction) {
                    Some(t) if t > 0.0 && t < FARTHEST * range => t,
                    _ => sphere(range, origin, direction),
                };
                origin + direction * along
            }
        };
        let next = maps.texel_of(map, if towards == DVec3::ZERO { direction } else { towards });
        if next == texel {
            break;
        }
        texel = next;
    }
    texel
}

/// Distance along a ray to the sphere of a range about the middle. A sphere that lies behind the ray's origin is met at the
/// origin.
#[inline]
fn sphere(range: f64, origin: DVec3, direction: DVec3) -> f64 {
    let along = origin.dot(direction);
    let squared = along * along - origin.length_squared() + range * range;
    (squared.max(0.0).sqrt() - along).max(0.0)
}

/// Distance along a ray to the plane that a texel and its neighbours see; `None` for sky. The neighbour on each axis is the
/// one whose range differs less: the other may see something else.
#[inline]
fn plane(maps: &IndexMaps, map: usize, texel: usize, origin: DVec3, direction: DVec3) -> Option<f64> {
    let surface = maps.plane(map, texel)?;
    let t = (1.0 - surface.dot(origin)) / surface.dot(direction);
    t.is_finite().then_some(t)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::IndexMaps;
    use crate::MappedReflector;

    /// A map whose texels see the inside of a room, and the true range along any ray.
    fn room(side: u32) -> (IndexMaps, impl Fn(DVec3, DVec3) -> f64) {
        let half = DVec3::new(3.0, 2.0, 4.0);
        let reflector = MappedReflector {
            instance: 0,
            center: DVec3::ZERO,
            radius: 0.5,
            curvature: 2.0,
            side,
            front: None,
        };
        let maps = IndexMaps::new(&[reflector]);
        let range = move |origin: DVec3, direction: DVec3| {
            let wall = half * direction.signum();
            ((wall - origin) / direction).min_element()
        };
        for texel in 0..maps.texels() {
            let (_, direction) = maps.direction_of(texel);
            maps.write(texel, range(DVec3::ZERO, direction.normalize()), 1);
        }
        (maps, range)
    }

    /// Share of rays from a ball whose lookup is within 1° and 5% of the range.
    fn right(maps: &IndexMaps, range: impl Fn(DVec3, DVec3) -> f64, steps: u32) -> f64 {
        let mut counts = [0; 2];
        for i in 0..40 {
            for j in 0..40 {
                let (u, v) = (f64::from(i) / 40.0 * std::f64::consts::TAU, f64::from(j) / 40.0 * 2.0 - 0.99);
                let ring = (1.0 - v * v).sqrt();
                let normal = DVec3::new(ring * u.cos(), v, ring * u.sin());
                let direction = (normal + DVec3::new(0.21, 0.43, -0.37)).normalize();
                let (origin, truth) = (normal * 0.5, range(normal * 0.5, direction));
                let texel = lookup(maps, 0, origin, direction, steps);
                let (_, middle) = maps.direction_of(texel);
                let found = middle.normalize() * maps.get(texel).unwrap().1 - origin;
                let is_right = found.angle_between(direction).to_degrees() <= 1.0
                    && (found.length() / truth - 1.0).abs() <= 0.05;
                counts[usize::from(is_right)] += 1;
            }
        }
        f64::from(counts[1]) / f64::from(counts[0] + counts[1])
    }

    #[test]
    fn three_steps_find_what_the_ray_meets_where_one_lookup_does_not() {
        let (maps, range) = room(512);
        let [plain, stepped] = [0, STEPS].map(|steps| right(&maps, &range, steps));
        assert!(plain < 0.25, "{plain}");
        assert!(stepped > 0.75, "{stepped}");
        assert!(right(&maps, &range, 12) >= stepped, "more steps never lose");
    }

    #[test]
    fn sky_and_a_surface_within_the_reflector_end_the_search() {
        let reflector = MappedReflector {
            instance: 0,
            center: DVec3::ZERO,
            radius: 1.0,
            curvature: 1.0,
            side: 32,
            front: None,
        };
        let maps = IndexMaps::new(&[reflector]);
        let direction = DVec3::new(0.6, 0.64, 0.48);
        let sky = lookup(&maps, 0, DVec3::X, direction, STEPS);
        assert_eq!(sky, maps.texel_of(0, direction));
        (0..maps.texels()).for_each(|texel| maps.write(texel, 0.25, 3));
        let within = lookup(&maps, 0, DVec3::X, direction, STEPS);
        assert_eq!(within, maps.texel_of(0, DVec3::X), "at the ray's origin");
    }
}
