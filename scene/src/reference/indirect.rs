//! Indirect diffuse light, by path tracing.
//!
//! Indirect light reaches a visible point after emission by a surface or diffuse reflection at one surface or more.
//! Point lights are sampled at every vertex of a path, with a shadow ray: light on a *second* surface is shadowed,
//! although direct light in [`crate::shading`] is not. The sky lights only the visible point, as in shading, and is
//! not reflected further.
//!
//! Every estimate is unbiased; its noise falls with the root of [`Indirect::paths`]. Random numbers follow from pixel
//! and path, so an image is the same at every rendering.

use glam::{DVec2, DVec3, Vec3};

use super::corners::Corners;
use super::{Hit, Tracer};
use crate::light_sampling::{cosine_direction, disc_point, r2};
use crate::shading::{Surface, incident, sky_radiance};
use crate::{InvalidField, Light};

/// Settings of the path tracer for indirect light.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Indirect {
    /// Paths per visible point, at least 1; the noise falls with their root.
    pub paths: u32,
    /// Reflections between light and visible point, at most 64; with 0 only emission counts.
    pub bounces: u32,
}

impl Indirect {
    /// Rejects settings that cannot be traced.
    ///
    /// # Errors
    /// The field out of range.
    pub fn validate(&self) -> Result<(), InvalidField> {
        match self {
            Self { paths: 0, .. } => Err(InvalidField::new("indirect.paths", "must be at least 1")),
            Self { bounces: 65.., .. } => Err(InvalidField::new("indirect.bounces", "must be at most 64")),
            Self { .. } => Ok(()),
        }
    }
}

/// Distance of a path's start from its surface, as a share of its coordinates: more than the error of an
/// intersection, less than any modelled detail.
const OFF_SURFACE: f64 = 1e-10;

impl Tracer {
    /// Irradiance by π of indirect light at a visible point, met along the unit `direction`; `seed` selects the random
    /// numbers.
    pub fn indirect_by_pi(
        &self,
        hit: &Hit,
        surface: &Surface,
        direction: DVec3,
        indirect: Indirect,
        seed: u64,
    ) -> Vec3 {
        let Some(start) = Start::new(self, hit, surface, direction) else { return Vec3::ZERO };
        let rotation = DVec2::new(Random::new(seed).next(), Random::new(!seed).next());
        let path = |index: u32| {
            let first = (r2(index) + rotation).fract();
            let random = Random::new(seed ^ (u64::from(index) + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15));
            self.radiance_from(start, first, indirect.bounces, random)
        };
        let sum: DVec3 = (0..indirect.paths).map(|index| path(index).as_dvec3()).sum();
        (sum / f64::from(indirect.paths.max(1))).as_vec3()
    }

    /// Radiance along one path that leaves a surface with cosine distribution about its normal.
    fn radiance_from(&self, start: Start, first: DVec2, bounces: u32, mut random: Random) -> Vec3 {
        let (mut radiance, mut throughput) = (Vec3::ZERO, Vec3::ONE);
        let (mut from, mut square) = (start, first);
        for bounce in 0..=bounces {
            let direction = cosine_direction(from.normal, disc_point(square));
            // Interpolated normals allow directions below the triangle, from which no light comes.
            if !(direction.dot(from.side) > 0.0) {
                break;
            }
            let Some(hit) = self.trace_light(from.position, direction) else {
                // What the sky sends to the visible point itself is direct light.
                if bounce > 0 && self.blocks_sky() {
                    radiance += throughput * sky_radiance(&self.pose.lighting.sky, direction.as_vec3());
                }
                break;
            };
            let surface = self.surface(&hit, direction, DVec3::ZERO, DVec3::ZERO);
            // The back of a single-sided lamp blocks light and sends none.
            let material = self.material_of(&hit);
            let shines = !material.unlit && (hit.front || material.double_sided);
            if shines && (bounce > 0 || !self.lights_by_emitters()) {
                radiance += throughput * surface.emissive;
            }
            if bounce == bounces {
                break;
            }
            let Some(next) = Start::new(self, &hit, &surface, direction) else { break };
            throughput *= surface.albedo;
            radiance += throughput * self.direct_by_pi(&surface, next);
            if throughput.max_element() == 0.0 {
                break;
            }
            (from, square) = (next, DVec2::new(random.next(), random.next()));
        }
        radiance
    }

    /// Irradiance by π of point lights on a surface, with shadows.
    fn direct_by_pi(&self, surface: &Surface, start: Start) -> Vec3 {
        let mut sum = Vec3::ZERO;
        for light in &self.pose.lighting.lights {
            let (to_light, irradiance) = incident(light, surface.position);
            let cosine = surface.normal.dot(to_light);
            if !(cosine > 0.0 && irradiance.max_element() > 0.0) {
                continue;
            }
            let (towards, distance) = match *light {
                Light::Directional { direction, .. } => (-direction, f64::INFINITY),
                Light::Point { position, .. } | Light::Spot { position, .. } => {
                    (position - start.position, (position - start.position).length())
                }
            };
            if towards.dot(start.side) > 0.0 {
                let passed = self.passed(start.position, towards, distance);
                sum += irradiance * (cosine * passed * std::f32::consts::FRAC_1_PI);
            }
        }
        sum
    }
}

/// Start of a path at a surface.
#[derive(Debug, Clone, Copy)]
struct Start {
    /// Just off the surface, on the visible side.
    position: DVec3,
    /// Unit shading normal.
    normal: DVec3,
    /// The triangle's normal, on the same side.
    side: DVec3,
}

impl Start {
    /// `None` if the triangle has no normal in world space.
    fn new(tracer: &Tracer, hit: &Hit, surface: &Surface, direction: DVec3) -> Option<Self> {
        let instance = &tracer.pose.instances[hit.instance as usize];
        let mesh = &tracer.scene.meshes[instance.mesh as usize];
        let [a, b, c] = Corners::new(mesh, hit.triangle, hit.barycentric).each(&mesh.positions)?;
        let m = instance.world_from_mesh.matrix3;
        let edges = [m * (b - a).as_dvec3(), m * (c - a).as_dvec3()];
        let side = edges[0].normalize_or_zero().cross(edges[1].normalize_or_zero()).try_normalize()?;
        let side = if side.dot(direction) > 0.0 { -side } else { side };
        let off = OFF_SURFACE * surface.position.abs().max_element().max(hit.range);
        Some(Self { position: surface.position + side * off, normal: surface.normal.as_dvec3(), side })
    }
}

/// SplitMix64 (Steele, Lea, Flood: "Fast Splittable Pseudorandom Number Generators", 2014).
struct Random(u64);

impl Random {
    fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// The next number in 0..1.
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ self.0 >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ z >> 31) >> 11) as f64 * (-53f64).exp2()
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;
    use std::sync::Arc;

    use glam::{DAffine3, Vec4};

    use super::*;
    use crate::{Instance, Lighting, Material, Mesh, Scene, Sky};

    /// A ball of triangles with its front inside: `rings` × 2·`rings` patches.
    fn hollow_ball(rings: u32) -> Mesh {
        let mut mesh = Mesh::default();
        for i in 0..=rings {
            for j in 0..=2 * rings {
                let polar = f64::from(i) / f64::from(rings) * TAU / 2.0;
                let turn = f64::from(j) / f64::from(2 * rings) * TAU;
                let p = DVec3::new(polar.sin() * turn.cos(), polar.cos(), polar.sin() * turn.sin()).as_vec3();
                mesh.positions.push(p);
                mesh.normals.push(-p);
            }
        }
        let row = 2 * rings + 1;
        for i in 0..rings {
            for j in 0..2 * rings {
                let (a, b) = (i * row + j, (i + 1) * row + j);
                mesh.indices.extend([a, b, a + 1, a + 1, b, b + 1]);
            }
        }
        mesh
    }

    fn scene(mesh: Mesh, material: Material, lights: Vec<Light>, offset: DVec3) -> Arc<Scene> {
        Arc::new(Scene {
            meshes: vec![mesh],
            instances: vec![Instance {
                mesh: 0,
                node: None,
                world_from_mesh: DAffine3::from_translation(offset),
            }],
            materials: vec![material],
            lighting: Lighting { lights, sky: Sky::BLACK, exposure: 1.0 },
            ..Scene::default()
        })
    }

    fn grey(albedo: f32) -> Material {
        Material { base_color: Vec4::new(albedo, albedo, albedo, 1.0), ..Material::default() }
    }

    fn indirect_at(scene: &Arc<Scene>, eye: DVec3, direction: DVec3, indirect: Indirect) -> Vec3 {
        let tracer = Tracer::new(Arc::clone(scene));
        let hit = tracer.trace(eye, direction).expect("the ball is closed");
        let surface = tracer.surface(&hit, direction, DVec3::ZERO, DVec3::ZERO);
        tracer.indirect_by_pi(&hit, &surface, direction, indirect, 7)
    }

    #[test]
    fn in_a_furnace_radiance_is_the_sum_of_all_reflections() {
        let material = Material { emissive: Vec3::splat(2.0), ..grey(0.5) };
        for offset in [DVec3::ZERO, DVec3::new(1e6, -2e6, 3e6)] {
            let scene = scene(hollow_ball(12), material.clone(), Vec::new(), offset);
            for (bounces, whole) in [(0, 2.0), (1, 3.0), (4, 3.875)] {
                let indirect = Indirect { paths: 64, bounces };
                let direction = DVec3::new(0.3, -0.5, 0.7).normalize();
                let found = indirect_at(&scene, offset + DVec3::new(0.1, 0.2, 0.0), direction, indirect);
                // Facets' normals are the ball's: a few directions lead below the facet and are lost.
                assert!((found - whole).abs().max_element() < 0.02 * whole, "{bounces} bounces: {found}");
            }
        }
    }

    #[test]
    fn light_from_a_balls_middle_is_scaled_by_the_albedo_at_each_reflection() {
        let lit = Light::Point {
            position: DVec3::ZERO,
            intensity: Vec3::splat(std::f32::consts::PI),
            range: None,
            radius: 0.0,
        };
        let scene = scene(hollow_ball(48), grey(0.6), vec![lit], DVec3::ZERO);
        for (bounces, whole) in [(1, 0.6), (3, 0.6 + 0.36 + 0.216)] {
            let found =
                indirect_at(&scene, DVec3::ZERO, DVec3::new(0.2, 0.4, 0.9), Indirect { paths: 256, bounces });
            assert!((found - whole).abs().max_element() < 0.02 * whole, "{bounces} bounces: {found}");
        }
    }

    #[test]
    fn an_occluder_before_the_light_blocks_its_reflection() {
        // Floor and wall; a light behind the wall as seen from the floor.
        let square = |o: Vec3, x: Vec3, y: Vec3| [o - x - y, o + x - y, o + x + y, o - x + y];
        let floor = square(Vec3::ZERO, Vec3::X * 4.0, Vec3::Z * -4.0);
        let wall = square(Vec3::new(-1.0, 2.0, 0.0), Vec3::Y * 2.0, Vec3::Z * 4.0);
        let mesh = Mesh {
            positions: floor.into_iter().chain(wall).collect(),
            normals: [[Vec3::Y; 4], [Vec3::X; 4]].concat(),
            indices: vec![0, 1, 2, 0, 2, 3, 4, 5, 6, 4, 6, 7],
            ..Mesh::default()
        };
        let found = |x: f64| {
            let position = DVec3::new(x, 1.0, 0.0);
            let lit = Light::Point { position, intensity: Vec3::ONE, range: None, radius: 0.0 };
            let scene = scene(mesh.clone(), grey(0.5), vec![lit], DVec3::ZERO);
            indirect_at(&scene, DVec3::new(1.0, 3.0, 0.0), DVec3::NEG_Y, Indirect { paths: 64, bounces: 1 })
        };
        assert!(found(0.0).x > 0.0);
        assert_eq!(found(-2.0), Vec3::ZERO);
    }

    #[test]
    fn the_back_of_a_single_sided_lamp_blocks_light_and_sends_none() {
        let square = |o: Vec3, x: Vec3, y: Vec3| [o - x - y, o + x - y, o + x + y, o - x + y];
        let floor = square(Vec3::ZERO, Vec3::X * 4.0, Vec3::Z * -4.0);
        let found = |across: Vec3| {
            let lamp = square(Vec3::Y, Vec3::X * 4.0, across * 4.0);
            let mesh = Mesh {
                positions: floor.into_iter().chain(lamp).collect(),
                indices: vec![0, 1, 2, 0, 2, 3, 4, 5, 6, 4, 6, 7],
                ..Mesh::default()
            };
            let material = Material { emissive: Vec3::ONE, double_sided: false, ..grey(0.5) };
            let scene = scene(mesh, material, Vec::new(), DVec3::ZERO);
            let eye = DVec3::new(0.0, 0.5, 0.0);
            indirect_at(&scene, eye, DVec3::NEG_Y, Indirect { paths: 64, bounces: 0 })
        };
        assert!(found(Vec3::Z).x > 0.5, "its front");
        assert_eq!(found(Vec3::NEG_Z), Vec3::ZERO, "its back");
    }

    #[test]
    fn zero_paths_and_too_many_bounces_are_rejected_by_field() {
        let field = |paths, bounces| Indirect { paths, bounces }.validate().map_err(|e| e.field);
        assert_eq!(field(1, 0), Ok(()));
        assert_eq!(field(0, 1).unwrap_err(), "indirect.paths");
        assert_eq!(field(1, 65).unwrap_err(), "indirect.bounces");
    }
}
