//! Placement of views: points that light reaches, traced from the light (instant radiosity, Keller 1997), or
//! random points.

use std::f64::consts::{FRAC_PI_2, TAU};

use argus_megaviews::many_views::ViewPoint;
use argus_scene::reference::{Hit, Tracer};
use argus_scene::{Bounds, Pose};
use glam::DVec3;
use rand::rngs::SmallRng;
use rand::{Rng as _, SeedableRng as _};

/// How views are placed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Placement {
    /// Where rays from the light first hit a surface.
    SingleBounce,
    /// There, and where three further diffuse bounces hit a surface.
    FourBounce,
    /// Uniform in the scene's bounds, with random directions.
    Random,
}

/// A light that places views.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Emitter {
    /// A point light that emits in every direction.
    Point {
        /// Position in world space, metres.
        position: DVec3,
    },
    /// A point light that emits into a cone.
    Spot {
        /// Position in world space, metres.
        position: DVec3,
        /// The cone's axis, of any length but 0.
        direction: DVec3,
        /// Half the cone's angle in radians.
        half_angle: f64,
    },
}

impl Placement {
    /// The name in options and tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::SingleBounce => "single-bounce",
            Self::FourBounce => "four-bounce",
            Self::Random => "random",
        }
    }
}

/// Paths per wanted view that may leave the scene before placement gives up.
const PATIENCE: usize = 64;

/// Places `count` views, the same for the same seed; fewer if the light reaches too little.
pub(crate) fn place(
    tracer: &Tracer,
    pose: &Pose,
    bounds: &Bounds,
    emitter: &Emitter,
    placement: Placement,
    count: usize,
    seed: u64,
) -> Vec<ViewPoint> {
    let mut random = SmallRng::seed_from_u64(seed);
    let mut views = Vec::with_capacity(count);
    if placement == Placement::Random {
        let mut unit = || DVec3::new(random.random(), random.random(), random.random());
        let inside: Vec<DVec3> = (0..count).map(|_| bounds.min + bounds.size() * unit()).collect();
        let looking = inside.into_iter().map(|position| ViewPoint {
            position,
            direction: uniform(&mut random, DVec3::Y, -1.0),
            half_fov: FRAC_PI_2,
        });
        return looking.collect();
    }
    let bounces = if placement == Placement::FourBounce { 4 } else { 1 };
    for _ in 0..count.saturating_mul(PATIENCE) {
        let (mut origin, mut direction) = emitter.ray(&mut random);
        for _ in 0..bounces {
            let Some(hit) = tracer.trace(origin, direction) else { break };
            let normal = normal(tracer, pose, &hit, direction);
            views.push(ViewPoint { position: hit.position, direction: normal, half_fov: FRAC_PI_2 });
            if views.len() == count {
                return views;
            }
            // Offset from the surface by far less than an octree cell, so that the ray does not hit it again.
            origin = hit.position + normal * 1e-6 * (1.0 + hit.position.abs().max_element());
            direction = cosine(&mut random, normal);
        }
    }
    views
}

impl Emitter {
    fn ray(&self, random: &mut SmallRng) -> (DVec3, DVec3) {
        match *self {
            Self::Point { position } => (position, uniform(random, DVec3::Y, -1.0)),
            Self::Spot { position, direction, half_angle } => {
                (position, uniform(random, direction.normalize(), half_angle.cos()))
            }
        }
    }
}

/// A uniform unit direction whose cosine with the axis is at least `least`.
fn uniform(random: &mut SmallRng, axis: DVec3, least: f64) -> DVec3 {
    let cosine = least + (1.0 - least) * random.random::<f64>();
    around(axis, cosine, TAU * random.random::<f64>())
}

/// A unit direction above a surface with cosine-weighted density.
fn cosine(random: &mut SmallRng, normal: DVec3) -> DVec3 {
    let cosine = (1.0 - random.random::<f64>()).sqrt();
    around(normal, cosine, TAU * random.random::<f64>())
}

fn around(axis: DVec3, cosine: f64, turn: f64) -> DVec3 {
    let (right, up) = axis.any_orthonormal_pair();
    let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
    axis * cosine + (right * turn.cos() + up * turn.sin()) * sine
}

/// The unit normal of the hit triangle, on the ray's side.
fn normal(tracer: &Tracer, pose: &Pose, hit: &Hit, direction: DVec3) -> DVec3 {
    let instance = &pose.instances[hit.instance as usize];
    let mesh = &tracer.scene().meshes[instance.mesh as usize];
    let first = 3 * hit.triangle as usize;
    let corner = |i: usize| {
        let position = mesh.positions[mesh.indices[first + i] as usize].as_dvec3();
        instance.world_from_mesh.transform_point3(mesh.origin + position)
    };
    let (a, b, c) = (corner(0), corner(1), corner(2));
    let normal = (b - a).cross(c - a).normalize();
    if normal.dot(direction) > 0.0 { -normal } else { normal }
}
