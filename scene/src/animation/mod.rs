//! Nodes, and the animations that move them.

pub(crate) mod track;

use glam::{DAffine3, DQuat, DVec3, Quat, Vec3};

/// A node of the file's hierarchy, kept so that animations can move its children, instances and lights.
#[derive(Debug, Clone, PartialEq)]
pub struct Node {
    /// As the file names it, or empty.
    pub name: String,
    /// Index of its parent in [`crate::Scene::nodes`], always smaller than its own.
    pub parent: Option<u32>,
    /// Its transform when no animation moves it.
    pub rest: Rest,
    /// Indices into [`crate::Lighting::lights`] of the lights at its origin, which shine along its −z.
    pub lights: Vec<u32>,
}

/// A node's own transform, from node to parent.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Rest {
    /// Scaled first, then rotated, then translated; channels replace one of the three.
    Parts(Parts),
    /// A matrix, which may shear; no channel moves such a node (glTF 2.0, section 3.6.3.2).
    Matrix(DAffine3),
}

/// Translation, rotation and scale of a node.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Parts {
    /// Metres.
    pub translation: DVec3,
    /// Unit quaternion.
    pub rotation: DQuat,
    /// Scale factors.
    pub scale: DVec3,
}

impl Default for Parts {
    fn default() -> Self {
        Self { translation: DVec3::ZERO, rotation: DQuat::IDENTITY, scale: DVec3::ONE }
    }
}

impl Parts {
    /// The transform from node to parent.
    pub fn parent_from_node(&self) -> DAffine3 {
        DAffine3::from_scale_rotation_translation(self.scale, self.rotation, self.translation)
    }
}

impl Rest {
    /// The transform from node to parent.
    pub fn parent_from_node(&self) -> DAffine3 {
        match self {
            Self::Parts(parts) => parts.parent_from_node(),
            Self::Matrix(matrix) => *matrix,
        }
    }
}

/// Values of one animated property over time.
#[derive(Debug, Clone, PartialEq)]
pub enum Track {
    /// Metres.
    Translation(Vec<Vec3>),
    /// Unit quaternions, but for the tangents of a cubic spline.
    Rotation(Vec<Quat>),
    /// Scale factors.
    Scale(Vec<Vec3>),
    /// Weights of morph targets: for each value, one of each target.
    Weights(Vec<f32>),
}

/// Interpolation between two keys.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Interpolation {
    /// The earlier key's value.
    Step,
    /// On the line (translation, scale) or the shorter arc (rotation) between them.
    Linear,
    /// Cubic Hermite; the track holds in-tangent, value, out-tangent for each key.
    CubicSpline,
}

/// One animated property of one node.
#[derive(Debug, Clone, PartialEq)]
pub struct Channel {
    /// Index into [`crate::Scene::nodes`].
    pub node: u32,
    /// Key times in seconds, ascending. Of equal times the last key counts.
    pub times_secs: Vec<f32>,
    /// Values at the keys.
    pub track: Track,
    /// Interpolation between the keys.
    pub interpolation: Interpolation,
}

/// A named set of channels that play together.
#[derive(Debug, Clone, PartialEq)]
pub struct Animation {
    /// As the file names it, or empty.
    pub name: String,
    /// The animated properties.
    pub channels: Vec<Channel>,
}

impl Animation {
    /// Seconds until it repeats: the time of its last key. 0 if no key is above zero; it then holds its first pose.
    pub fn length_secs(&self) -> f64 {
        let last = |channel: &Channel| channel.times_secs.last().map_or(0.0, |&t| f64::from(t));
        // `max` ignores NaN.
        self.channels.iter().map(last).fold(0.0, f64::max)
    }

    /// Time within its loop in seconds; 0 if the scene time is not finite.
    pub(crate) fn phase(&self, time_secs: f64) -> f64 {
        let phase = time_secs.rem_euclid(self.length_secs());
        if phase.is_finite() { phase } else { 0.0 }
    }
}
