//! Motion: animated nodes move the instances and lights that hang from them.
//!
//! [`Scene::at`] is a pure function of time, so every process with the scene has the same pose. Animations play together
//! in loops: an animation's length is its last key, and time is taken modulo that. Before its first key a channel holds
//! its first value, after its last key its last. An animation does not play if one before it moves a property that it
//! moves, too: of the walk and the run of a character, one plays. Shapes are posed by [`Scene::posed`]. The file's cameras
//! are not animated; the loader warns.

mod shapes;
mod sweep;

use std::collections::BTreeMap;

use glam::{DAffine3, DVec3};

use crate::animation::{Animation, Channel, Parts, Rest};
use crate::{Instance, Light, Lighting, Scene};

/// The instances and lights of a scene at one time.
#[derive(Debug, Clone, PartialEq)]
pub struct Pose {
    /// Same number and order as in the scene. An instance whose transform overflowed is not finite and is not drawn.
    pub instances: Vec<Instance>,
    /// Lights, sky and exposure.
    pub lighting: Lighting,
}

/// The active channels: for each moved node, those of translation, rotation, scale and weights, each with its animation.
pub(crate) type Drivers<'a> = BTreeMap<u32, [Option<(&'a Animation, &'a Channel)>; 4]>;

impl Scene {
    /// Whether time changes the image: an animation of some length moves an instance or a light, or changes a shape.
    pub fn is_animated(&self) -> bool {
        let moved = self.moved(&self.drivers());
        let moves = |node: u32| moved.get(node as usize).copied().unwrap_or(false);
        self.instances.iter().filter_map(|instance| instance.node).any(moves)
            || self.nodes.iter().zip(&moved).any(|(node, &moved)| moved && !node.lights.is_empty())
            || self.deforms_by_time()
    }

    /// For each node, whether an animation of some length moves it or a node above.
    pub(crate) fn moved(&self, drivers: &Drivers<'_>) -> Vec<bool> {
        let mut moved = vec![false; self.nodes.len()];
        for (&node, driven) in drivers {
            moved[node as usize] = driven[..3].iter().flatten().any(|(by, _)| by.length_secs() > 0.0);
        }
        self.inherit(&mut moved);
        moved
    }

    /// The scene at a time in seconds. Parts without animation equal the scene's own lists; at time zero, so
    /// does everything in a scene made by a loader.
    pub fn at(&self, time_secs: f64) -> Pose {
        let mut pose = Pose { instances: self.instances.clone(), lighting: self.lighting.clone() };
        let drivers = self.drivers();
        if drivers.is_empty() {
            return pose;
        }
        let mut moved = vec![false; self.nodes.len()];
        for (&node, driven) in &drivers {
            moved[node as usize] = driven[..3].iter().any(Option::is_some);
        }
        self.inherit(&mut moved);
        let world_from_node = self.world_from_nodes(&drivers, time_secs);
        for instance in &mut pose.instances {
            if let Some(node) = instance.node.map(|node| node as usize).filter(|&node| moved[node]) {
                instance.world_from_mesh = self.placed(instance, &world_from_node[node]);
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

    /// The transform from each node to the world at a time.
    pub(crate) fn world_from_nodes(&self, drivers: &Drivers<'_>, time_secs: f64) -> Vec<DAffine3> {
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

    /// The active channels: those of the animations that play.
    pub(crate) fn drivers(&self) -> Drivers<'_> {
        let mut drivers = Drivers::new();
        for animation in &self.animations {
            let _ = self.drive(&mut drivers, animation);
        }
        drivers
    }

    /// Adds the channels of an animation. Returns the animation in its way if there is one, which it does not play beside.
    fn drive<'a>(&self, drivers: &mut Drivers<'a>, animation: &'a Animation) -> Option<&'a Animation> {
        let is_active = |channel: &Channel| {
            let node = self.nodes.get(channel.node as usize);
            channel.is_whole()
                && node.is_some_and(|node| channel.property() == 3 || matches!(node.rest, Rest::Parts(_)))
        };
        let active = || animation.channels.iter().filter(|channel| is_active(channel));
        let in_the_way =
            |channel: &Channel| drivers.get(&channel.node).and_then(|driven| driven[channel.property()]);
        if let Some((other, _)) = active().find_map(in_the_way) {
            return Some(other);
        }
        for channel in active() {
            let driven = &mut drivers.entry(channel.node).or_default()[channel.property()];
            driven.get_or_insert((animation, channel));
        }
        None
    }

    /// The animations that do not play, each with the one in its way.
    pub fn not_playing(&self) -> Vec<(&Animation, &Animation)> {
        let mut drivers = Drivers::new();
        self.animations.iter().filter_map(|one| Some((one, self.drive(&mut drivers, one)?))).collect()
    }

    /// Plays an animation before all others: by its name, or else by its number from 0. It becomes part of the hash.
    ///
    /// # Errors
    /// There is no such animation: the line names those that there are.
    #[cfg(feature = "loaders")]
    pub(crate) fn play(mut self, name: &str) -> Result<Self, String> {
        let by_name = self.animations.iter().position(|animation| animation.name == name);
        let by_number = || name.parse().ok().filter(|&number: &usize| number < self.animations.len());
        let Some(first) = by_name.or_else(by_number) else {
            let names: Vec<&str> = self.animations.iter().map(|animation| animation.name.as_str()).collect();
            return Err(format!("it has no animation {name:?}; it has {names:?}"));
        };
        let silent = self.not_playing_warning();
        self.animations[..=first].rotate_right(1);
        self.warnings.retain(|line| Some(line) != silent.as_ref());
        self.warnings.extend(self.not_playing_warning());
        self.begin();
        let chosen = format!("{} animation:{name}", self.hash);
        self.hash = crate::SceneHash(*blake3::hash(chosen.as_bytes()).as_bytes());
        Ok(self)
    }

    /// The warning that some animations do not play, and how to choose one.
    #[cfg(feature = "loaders")]
    pub(crate) fn not_playing_warning(&self) -> Option<String> {
        let silent = self.not_playing();
        let (_, other) = silent.first()?;
        let shown: Vec<String> =
            silent.iter().take(8).map(|(animation, _)| format!("{:?}", animation.name)).collect();
        let more = silent.len().checked_sub(shown.len() + 1).map_or("", |_| ", …");
        Some(format!(
            "{} of {} animations move what {:?} moves, and do not play: {}{more}. FILE+animation:NAME plays one of them",
            silent.len(),
            self.animations.len(),
            other.name,
            shown.join(", ")
        ))
    }

    /// For each node, whether it is one of these or hangs from one.
    pub fn hanging_from(&self, nodes: impl IntoIterator<Item = u32>) -> Vec<bool> {
        let mut marked = vec![false; self.nodes.len()];
        for node in nodes {
            if let Some(node) = marked.get_mut(node as usize) {
                *node = true;
            }
        }
        self.inherit(&mut marked);
        marked
    }

    /// Marks all descendants of marked nodes.
    pub(crate) fn inherit(&self, marked: &mut [bool]) {
        for (index, node) in self.nodes.iter().enumerate() {
            marked[index] |= node.parent.is_some_and(|parent| marked[parent as usize]);
        }
    }
}

/// A node's transform at a time: parts without a channel are as at rest.
fn posed(rest: Parts, driven: &[Option<(&Animation, &Channel)>; 4], time_secs: f64) -> Parts {
    let [translation, rotation, scale, _] = driven;
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

/// Moves a light to its node. If the node's scale is zero, the light keeps its last direction.
pub(crate) fn place_light(light: &mut Light, world_from_node: &DAffine3) {
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
