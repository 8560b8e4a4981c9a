//! Animated scenes of tests.
#![allow(dead_code, reason = "each test binary uses a part")]

use std::sync::Arc;

use argus_scene::animation::{Animation, Channel, Interpolation, Node, Parts, Rest, Track};
use argus_scene::deformation::{Deformation, Joint, MorphTarget, Shape, Skin};
use argus_scene::{Camera, Light, Scene};
use glam::{DAffine3, DQuat, DVec3, Quat, Vec3};

use crate::common::*;

/// Δt of these tests, seconds.
pub(crate) const EPOCH_SECS: f64 = 0.25;

/// A floor and a ball that stand still; a ball that goes round the middle while it grows, a lamp above it.
pub(crate) fn scene() -> Scene {
    let mut scene = empty_scene();
    scene.materials.push(argus_scene::Material {
        base_color: glam::Vec4::new(0.9, 0.3, 0.2, 1.0),
        ..argus_scene::Material::default()
    });
    place(&mut scene, quad(Vec3::ZERO, Vec3::X * 6.0, Vec3::NEG_Z * 6.0, 3.0, 0), DAffine3::IDENTITY);
    place(&mut scene, ball(0, 16), DAffine3::from_translation(DVec3::new(0.0, 1.0, 0.0)));
    place(&mut scene, ball(1, 24), DAffine3::IDENTITY);
    scene.instances[2].node = Some(1);
    let node = |parent, translation, lights| Node {
        name: String::new(),
        parent,
        rest: Rest::Parts(Parts { translation, ..Parts::default() }),
        lights,
    };
    scene.lighting.lights.push(Light::Point {
        position: DVec3::ZERO,
        intensity: Vec3::splat(3.0),
        range: None,
        radius: 0.0,
    });
    scene.nodes = vec![
        node(None, DVec3::ZERO, vec![]),
        node(Some(0), DVec3::new(2.5, 0.8, 0.0), vec![]),
        node(Some(1), DVec3::new(0.0, 2.0, 0.0), vec![1]),
    ];
    let quarters = (0..=4).map(|i| Quat::from_rotation_y(i as f32 * std::f32::consts::FRAC_PI_2)).collect();
    let around = Channel {
        node: 0,
        times_secs: vec![0.0, 1.0, 2.0, 3.0, 4.0],
        track: Track::Rotation(quarters),
        interpolation: Interpolation::Linear,
    };
    let grow = Channel {
        node: 1,
        times_secs: vec![0.0, 4.0],
        track: Track::Scale(vec![Vec3::splat(0.5), Vec3::splat(0.8)]),
        interpolation: Interpolation::Linear,
    };
    scene.animations = vec![Animation { name: "round".to_owned(), channels: vec![around, grow] }];
    let pose = scene.at(0.0);
    (scene.instances, scene.lighting) = (pose.instances, pose.lighting);
    scene
}

/// The scene with an egg whose foot stands still and whose top is drawn round the middle, while a target squeezes it.
pub(crate) fn scene_that_deforms() -> Scene {
    let mut scene = scene();
    let mut egg = ball(1, 16);
    let vertices = egg.positions.len();
    let joint = |node, from: DVec3| Joint { node, joint_from_mesh: DAffine3::from_translation(-from) };
    let rest = Shape {
        origin: DVec3::ZERO,
        positions: egg.positions.clone(),
        normals: egg.normals.clone(),
        tangents: egg.tangents.clone(),
    };
    let squeezed = egg.positions.iter().map(|p| Vec3::new(0.0, 0.0, -0.6 * p.z)).collect();
    let share = |p: &Vec3| (p.y * 0.5 + 0.5).clamp(0.0, 1.0);
    let target = MorphTarget { positions: squeezed, ..MorphTarget::default() };
    egg.deformation = Some(Arc::new(Deformation {
        rest,
        node: 3,
        targets: vec![target],
        weights: vec![0.0],
        skin: Some(Skin {
            joints: Arc::new(vec![joint(3, DVec3::ZERO), joint(1, DVec3::new(0.0, 0.8, 0.0))]),
            first: (0..=vertices as u32).map(|i| 2 * i).collect(),
            influences: egg.positions.iter().flat_map(|p| [(0, 1.0 - share(p)), (1, share(p))]).collect(),
        }),
        flattens: false,
        flat_normals: false,
    }));
    let foot = Parts { translation: DVec3::new(-2.0, 1.2, 1.0), ..Parts::default() };
    scene.nodes.push(Node { name: String::new(), parent: None, rest: Rest::Parts(foot), lights: vec![] });
    let squeeze = Channel {
        node: 3,
        times_secs: vec![0.0, 2.0, 4.0],
        track: Track::Weights(vec![0.0, 1.0, 0.0]),
        interpolation: Interpolation::Linear,
    };
    scene.animations[0].channels.push(squeeze);
    place(&mut scene, egg, DAffine3::IDENTITY);
    // Pebbles keep the bounds, and so the near plane, those of the scene that stands still.
    for corner in [DVec3::new(-8.0, -2.0, -8.0), DVec3::new(8.0, 5.0, 8.0)] {
        let small = DAffine3::from_scale_rotation_translation(DVec3::splat(0.01), DQuat::IDENTITY, corner);
        place(&mut scene, ball(0, 4), small);
    }
    let posed = Arc::new(scene).posed(0.0);
    Arc::unwrap_or_clone(posed)
}

pub(crate) fn camera() -> Camera {
    Camera::look_at(DVec3::new(0.5, 3.5, 7.5), DVec3::new(0.0, 0.8, 0.0))
}
