//! Replaces a scene's lights by a single one.

use argus_scene::{Light, Lighting, Scene, Sky};
use glam::Vec3;

use crate::papers::megaviews::Emitter;

/// Lights a scene by this light alone under a black sky. Its intensity follows the scene's size.
pub(super) fn replace(scene: &mut Scene, emitter: &Emitter) {
    let intensity = Vec3::splat((scene.bounds().size().length() * 0.5).powi(2) as f32);
    let light = match *emitter {
        Emitter::Point { position } => Light::Point { position, intensity, range: None, radius: 0.0 },
        Emitter::Spot { position, direction, half_angle } => Light::Spot {
            position,
            direction: direction.normalize(),
            intensity,
            range: None,
            inner_cone: half_angle * 0.9,
            outer_cone: half_angle,
            radius: 0.0,
        },
    };
    scene.lighting = Lighting { lights: vec![light], sky: Sky::BLACK, exposure: 1.0 };
}
