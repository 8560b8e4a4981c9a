//! Motion: nodes whose animations move the instances and lights that hang from them.
//!
//! [`Scene::at`] is a pure function of time, so every process that has the scene has the same pose. All
//! animations of a file play together, each over and over: an animation's length is its last key, and time
//! is taken modulo that. A channel that begins later than its animation holds its first value until then; one
//! that ends earlier holds its last. Where two animations move the same property of a node, which glTF leaves
//! open, the first one in the file counts. What is not played: skins, morph targets and the cameras of the
//! file, which stay where they are at time zero; the loader says so.

mod sweep;
mod track;

use std::collections::BTreeMap;

use glam::{DAffine3, DQuat, DVec3, Quat, Vec3};

use crate::{Instance, Light, Lighting, Scene};

/// A node of the file's hierarchy, kept so that animations can move what hangs from it.
#[derive(Debug, Clone, PartialEq)]
pub struct Node {
    /// As the file names it, or empty.
    pub name: String,
    /// Index of its parent in [`Scene::nodes`], always smaller than its own.
    pub parent: Option<u32>,
    /// Where it lies in its parent while nothing moves it.
    pub rest: Rest,
    /// Indices into [`Lighting::lights`] of what stands at its origin and shines along its -z.
    pub lights: Vec<u32>,
}

/// A node's own transform, from node to parent.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Rest {
    /// Scaled first, then rotated, then translated; channels replace one of the three.
    Parts(Parts),
    /// A matrix, which may shear: no channel moves such a node (glTF 2.0, section 3.6.3.2).
    Matrix(DAffine3),
}

/// What a node's transform is made of.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Parts {
    /// Metres.
    pub translation: DVec3,
    /// Unit quaternion.
    pub rotation: DQuat,
    /// Factors.
    pub scale: DVec3,
}

impl Default for Parts {
    fn default() -> Self {
        Self { translation: DVec3::ZERO, rotation: DQuat::IDENTITY, scale: DVec3::ONE }
    }
}

impl Parts {
    /// Node to parent.
    pub fn parent_from_node(&self) -> DAffine3 {
        DAffine3::from_scale_rotation_translation(self.scale, self.rotation, self.translation)
    }
}

impl Rest {
    /// Node to parent.
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
    /// Factors.
    Scale(Vec<Vec3>),
}

/// How values between two keys are found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Interpolation {
    /// The earlier key's.
    Step,
    /// On the line (translation, scale) or the shorter arc (rotation) between them.
    Linear,
    /// Cubic Hermite; the track holds in-tangent, value, out-tangent for each key.
    CubicSpline,
}

/// One animated property of one node.
#[derive(Debug, Clone, PartialEq)]
pub struct Channel {
    /// Index into [`Scene::nodes`].
    pub node: u32,
    /// Key times, seconds, ascending; several may be equal, and then the last of them counts.
    pub times_secs: Vec<f32>,
    /// Values at the keys.
    pub track: Track,
    /// Between the keys.
    pub interpolation: Interpolation,
}

/// A named set of channels that play together.
#[derive(Debug, Clone, PartialEq)]
pub struct Animation {
    /// As the file names it, or empty.
    pub name: String,
    /// What it moves.
    pub channels: Vec<Channel>,
}

impl Animation {
    /// How long it plays before it begins again, seconds: its last key. 0 where it has none above zero, and then
    /// it holds its first pose.
    pub fn length_secs(&self) -> f64 {
        let last = |channel: &Channel| channel.times_secs.last().map_or(0.0, |&t| f64::from(t));
        // `max` passes a NaN over.
        self.channels.iter().map(last).fold(0.0, f64::max)
    }

    /// Where in its loop it is at a scene time; 0 for a time that is not finite.
    fn phase(&self, time_secs: f64) -> f64 {
        let phase = time_secs.rem_euclid(self.length_secs());
        if phase.is_finite() { phase } else { 0.0 }
    }
}

/// Everything of a scene that depends on time.
#[derive(Debug, Clone, PartialEq)]
pub struct Pose {
    /// As many as the scene has, in its order. A transform that overflowed is not finite, and its instance is
    /// then nowhere.
    pub instances: Vec<Instance>,
    /// Lights, sky and exposure.
    pub lighting: Lighting,
}

/// The channels that count: for each node that any moves, its translation's, rotation's and scale's, with the
/// animation that each belongs to.
type Drivers<'a> = BTreeMap<u32, [Option<(&'a Animation, &'a Channel)>; 3]>;

impl Scene {
    /// Whether time changes what there is to see: a channel of an animation that lasts moves an instance or a
    /// light.
    pub fn is_animated(&self) -> bool {
        let lasting = self.animations.iter().filter(|animation| animation.length_secs() > 0.0);
        let mut moved = vec![false; self.nodes.len()];
        for channel in lasting.flat_map(|animation| &animation.channels) {
            if let Some(moved) = moved.get_mut(channel.node as usize) {
                *moved = true;
            }
        }
        self.inherit(&mut moved);
        let moves = |node: u32| moved.get(node as usize).copied().unwrap_or(false);
        self.instances.iter().filter_map(|instance| instance.node).any(moves)
            || self.nodes.iter().zip(&moved).any(|(node, &moved)| moved && !node.lights.is_empty())
    }

    /// The scene at a time, seconds. What no animation moves is exactly what the scene's own lists hold; so is all
    /// of it at time zero, if a loader made the scene.
    pub fn at(&self, time_secs: f64) -> Pose {
        let mut pose = Pose { instances: self.instances.clone(), lighting: self.lighting.clone() };
        let drivers = self.drivers();
        if drivers.is_empty() {
            return pose;
        }
        let mut moved = vec![false; self.nodes.len()];
        drivers.keys().for_each(|&node| moved[node as usize] = true);
        self.inherit(&mut moved);
        let world_from_node = self.world_from_nodes(&drivers, time_secs);
        for instance in &mut pose.instances {
            if let Some(node) = instance.node.map(|node| node as usize).filter(|&node| moved[node]) {
                instance.world_from_mesh = world_from_node[node];
            }
        }
        for ((node, world_from_node), _) in
            self.nodes.iter().zip(&world_from_node).zip(&moved).filter(|(_, moved)| **moved)
        {
            for &light in &node.lights {
                if let Some(light) = pose.lighting.lights.get_mut(light as usize) {
                    place_light(light, world_from_node);
                }
            }
        }
        pose
    }

    /// Where each node lies in the world at a time.
    fn world_from_nodes(&self, drivers: &Drivers<'_>, time_secs: f64) -> Vec<DAffine3> {
        let mut world: Vec<DAffine3> = Vec::with_capacity(self.nodes.len());
        for (index, node) in (0u32..).zip(&self.nodes) {
            let parent_from_node = match (drivers.get(&index), node.rest) {
                (Some(driven), Rest::Parts(parts)) => posed(parts, driven, time_secs).parent_from_node(),
                (_, rest) => rest.parent_from_node(),
            };
            let parent = node.parent.and_then(|parent| world.get(parent as usize));
            world.push(parent.map_or(parent_from_node, |parent| *parent * parent_from_node));
        }
        world
    }

    /// The channels that count.
    fn drivers(&self) -> Drivers<'_> {
        let mut drivers = Drivers::new();
        for animation in &self.animations {
            for channel in &animation.channels {
                let node = self.nodes.get(channel.node as usize);
                if node.is_some_and(|node| matches!(node.rest, Rest::Parts(_))) && channel.is_whole() {
                    let driven = &mut drivers.entry(channel.node).or_default()[channel.property()];
                    driven.get_or_insert((animation, channel));
                }
            }
        }
        drivers
    }

    /// Marks what hangs from marked nodes.
    fn inherit(&self, marked: &mut [bool]) {
        for (index, node) in self.nodes.iter().enumerate() {
            marked[index] |= node.parent.is_some_and(|parent| marked[parent as usize]);
        }
    }
}

/// A node's parts at a time: what no channel drives is as at rest.
fn posed(rest: Parts, driven: &[Option<(&Animation, &Channel)>; 3], time_secs: f64) -> Parts {
    let [translation, rotation, scale] = driven;
    let vector = |driver: &Option<(&Animation, &Channel)>, rest: DVec3| {
        driver.and_then(|(animation, channel)| channel.vector_at(animation.phase(time_secs))).unwrap_or(rest)
    };
    let turned = rotation.and_then(|(animation, channel)| channel.rotation_at(animation.phase(time_secs)));
    Parts {
        translation: vector(translation, rest.translation),
        rotation: turned.unwrap_or(rest.rotation),
        scale: vector(scale, rest.scale),
    }
}

/// Puts a light where its node is. Without a direction left, where the node's scale is zero, it keeps the last.
fn place_light(light: &mut Light, world_from_node: &DAffine3) {
    let at = world_from_node.translation;
    let along = world_from_node.transform_vector3(DVec3::NEG_Z);
    let (place, turn) = match light {
        Light::Directional { direction, .. } => (None, Some(direction)),
        Light::Point { position, .. } => (Some(position), None),
        Light::Spot { position, direction, .. } => (Some(position), Some(direction)),
    };
    if let Some(position) = place.filter(|_| at.is_finite()) {
        *position = at;
    }
    if let Some(direction) = turn {
        *direction = along.try_normalize().unwrap_or(*direction);
    }
}

#[cfg(test)]
mod tests;
