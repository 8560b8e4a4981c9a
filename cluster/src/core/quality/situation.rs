//! Features of a view that are known before it is rendered.

use argus_scene::rig::{CandidateCameras, VisibilityQuery};
use argus_scene::{Bounds, Camera, OmniLayout, Rig, SampleCamera};
use serde::{Deserialize, Serialize};

/// Features of a view among the sample cameras of a rig, on which errors may depend smoothly.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Situation(pub [f64; Situation::FEATURES]);

impl Situation {
    /// Number of features.
    pub const FEATURES: usize = 12;

    /// The situation of a view of `height` rows among the cameras of a rig.
    pub fn new(
        camera: &Camera,
        height: u32,
        (rig, sight): (&Rig, Option<&dyn VisibilityQuery>),
        bounds: &Bounds,
    ) -> Self {
        let extent = bounds.size().max_element().max(1e-12);
        let axis = (camera.target - camera.eye).normalize_or_zero();
        let focus = camera.eye + axis * focus_distance(camera, bounds);
        let reach = (focus - camera.eye).length().max(1e-9 * extent);
        let spacing = match *rig {
            Rig::Cell { spacing, .. } => spacing,
            Rig::TileCorners { tiles, .. } => {
                let size = bounds.size();
                (size.x / f64::from(tiles[0])).max(size.z / f64::from(tiles[1]))
            }
        };
        let pixels_per_radian = 0.5 * f64::from(height) / camera.tan_half_fov(height, height).y.max(1e-9);
        let nearest = rig.nearest_among(camera, 2, CandidateCameras { refined: &[], sight });
        let nearest: Vec<SampleCamera> = nearest.into_iter().filter_map(|i| rig.camera(i).ok()).collect();
        let center = |i: usize| nearest.get(i).or(nearest.first()).map_or(camera.eye, SampleCamera::center);
        // The angle between the directions of the view and of the sample, as seen from the subject.
        let angle = |i: usize| {
            let to_sample = (center(i) - focus).normalize_or(-axis);
            to_sample.dot(-axis).clamp(-1.0, 1.0).acos()
        };
        let sampled = nearest.first().map_or(pixels_per_radian, texels_per_radian);
        let sample_reach = (center(0) - focus).length().max(1e-9 * extent);
        let density = (pixels_per_radian / reach) / (sampled / sample_reach);
        let at = (camera.eye - bounds.center()) / extent;
        Self([
            (1.0 + (center(0) - camera.eye).length() / spacing.max(1e-12)).ln(),
            angle(0),
            angle(1),
            density.log2(),
            pixels_per_radian.log2(),
            (reach / extent).ln(),
            axis.x,
            axis.y,
            axis.z,
            at.x,
            at.y,
            at.z,
        ])
    }
}

/// Assumed distance of the view's subject: the middle of the view axis within the scene's box, or the distance to the
/// box's middle if the axis misses it.
fn focus_distance(camera: &Camera, bounds: &Bounds) -> f64 {
    let axis = (camera.target - camera.eye).normalize_or_zero();
    let inverse = axis.recip();
    let (a, b) = ((bounds.min - camera.eye) * inverse, (bounds.max - camera.eye) * inverse);
    // Along a coordinate axis that the view axis does not follow, it is in the slab everywhere or nowhere.
    let along = |i: usize| {
        let (low, high) = (a[i].min(b[i]), a[i].max(b[i]));
        if low.is_finite() && high.is_finite() { (low, high) } else { (f64::NEG_INFINITY, f64::INFINITY) }
    };
    let (near, far) = (0..3)
        .map(along)
        .fold((0.0_f64, f64::INFINITY), |(near, far), (low, high)| (near.max(low), far.min(high)));
    match near < far && far.is_finite() {
        true => 0.5 * (near + far),
        false => (bounds.center() - camera.eye).length(),
    }
}

/// Texels per radian of a sample camera, along its axis.
fn texels_per_radian(camera: &SampleCamera) -> f64 {
    match camera {
        SampleCamera::Perspective { camera, width, height } => {
            0.5 * f64::from(*height) / camera.tan_half_fov(*width, *height).y.max(1e-9)
        }
        // A face covers a right angle; so does half of a paraboloid's hemisphere, a little more coarsely.
        SampleCamera::Omni { layout, .. } => match layout {
            OmniLayout::CubeFaces { face: side }
            | OmniLayout::DualParaboloid { side }
            | OmniLayout::ReflectionProbes { side, .. } => 0.5 * f64::from(*side),
        },
    }
}
