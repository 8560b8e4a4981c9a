//! The bounds of everything that a scene shows at any time.
//!
//! The box that each animated node sweeps in its parent is found independently of other animations, since animations
//! of different lengths meet in every combination. So the bounds are never too small, and as tight as boxes in the
//! nodes' own axes can be.
//!
//! Boxes of boxes along a skeleton would be several times as large as its character. So the boxes of a character's joints
//! are looked at in many moments instead, if all that moves has one length.

use glam::{DAffine3, DQuat, DVec3};

use super::Drivers;
use crate::animation::track::{arc, slerp, unit};
use crate::animation::{Animation, Channel, Interpolation, Parts, Rest, Track};
use crate::{Bounds, Scene};

/// Largest step in radians between tested rotations. Between two steps a point leaves the hull of both by half a per
/// cent of its distance.
const STEP: f64 = std::f64::consts::PI / 16.0;

/// Most poses of nodes that are looked at, over all moments.
const MOST_POSES: usize = 1 << 20;

/// The closest ancestor that moves (or the node itself), or the world.
#[derive(Clone, Copy)]
struct Anchor {
    node: Option<u32>,
    anchor_from_node: DAffine3,
}

impl Scene {
    /// The box around all vertices of placed triangles, at all times of an animated scene. Vertices that joints move are
    /// within the boxes that their joints sweep.
    pub fn bounds(&self) -> Bounds {
        // Wherever clients move nodes, what hangs on the bounds stays as it is.
        if let Some(moved) = &self.by_request {
            return moved.base.bounds();
        }
        let drivers = self.drivers();
        let mut anchors: Vec<Anchor> = Vec::with_capacity(self.nodes.len());
        for (index, node) in (0u32..).zip(&self.nodes) {
            let parent = node.parent.and_then(|parent| anchors.get(parent as usize).copied());
            let above = parent.unwrap_or(Anchor { node: None, anchor_from_node: DAffine3::IDENTITY });
            let moves = drivers.get(&index).is_some_and(|driven| driven[..3].iter().any(Option::is_some));
            anchors.push(match moves {
                true => Anchor { node: Some(index), anchor_from_node: DAffine3::IDENTITY },
                false => {
                    let anchor_from_node = above.anchor_from_node * node.rest.parent_from_node();
                    Anchor { anchor_from_node, ..above }
                }
            });
        }

        let mut world = Bounds::EMPTY;
        let mut about: Vec<Bounds> = vec![Bounds::EMPTY; self.nodes.len()];
        let mut extend = |anchor: Option<&Anchor>, in_world: &DAffine3, point: DVec3| match anchor {
            Some(Anchor { node: Some(node), anchor_from_node }) => {
                about[*node as usize].extend(anchor_from_node.transform_point3(point));
            }
            _ => world.extend(in_world.transform_point3(point)),
        };
        let deforming = self.deforming_meshes();
        for instance in &self.instances {
            let (mesh, deforms) = (&self.meshes[instance.mesh as usize], deforming[instance.mesh as usize]);
            let anchor = instance.node.and_then(|node| anchors.get(node as usize));
            let Some(deformation) = mesh.deformation.as_ref().filter(|_| deforms) else {
                for position in &mesh.positions {
                    extend(anchor, &instance.world_from_mesh, mesh.origin + position.as_dvec3());
                }
                continue;
            };
            let driver = drivers.get(&deformation.node).and_then(|driven| driven[3]);
            let hull = driver.and_then(|(_, channel)| channel.weights_hull());
            let hull = hull.filter(|[least, _]| least.len() == deformation.targets.len());
            let [least, most] =
                hull.unwrap_or_else(|| [deformation.weights.clone(), deformation.weights.clone()]);
            for vertex in 0..deformation.rest.positions.len() {
                let reach = deformation.reach(vertex, &least, &most);
                let Some(skin) = &deformation.skin else {
                    corners(reach).for_each(|corner| extend(anchor, &instance.world_from_mesh, corner));
                    continue;
                };
                // A vertex is a weighted mean of its places in the spaces of its joints.
                let influences = skin.influences_of(vertex);
                for (joint, _) in influences {
                    let Some(joint) = skin.joints.get(usize::from(*joint)) else { continue };
                    let anchor = anchors.get(joint.node as usize);
                    let in_world = anchor.map_or(DAffine3::IDENTITY, |anchor| anchor.anchor_from_node);
                    corners(reach).for_each(|corner| {
                        extend(anchor, &in_world, joint.joint_from_mesh.transform_point3(corner));
                    });
                }
                if influences.is_empty() {
                    corners(reach).for_each(|corner| extend(None, &DAffine3::IDENTITY, corner));
                }
            }
        }
        let is_skinned = |mesh: &crate::Mesh| mesh.deformation.as_ref().is_some_and(|by| by.skin.is_some());
        let has_skins =
            self.meshes.iter().zip(&deforming).any(|(mesh, &deforms)| deforms && is_skinned(mesh));
        if let Some(moments) = moments(&drivers, self.nodes.len()).filter(|_| has_skins) {
            return self.seen_in(&moments, &drivers, &about, world);
        }
        // Children come after their parents, so a node's box is complete when it is swept.
        for (&node, driven) in
            drivers.iter().rev().filter(|(_, driven)| driven[..3].iter().any(Option::is_some))
        {
            let Rest::Parts(rest) = self.nodes[node as usize].rest else { continue };
            let swept = sweep(about[node as usize], rest, driven);
            let parent = self.nodes[node as usize].parent.and_then(|p| anchors.get(p as usize).copied());
            let above = parent.unwrap_or(Anchor { node: None, anchor_from_node: DAffine3::IDENTITY });
            let bounds = match above.node {
                Some(anchor) => &mut about[anchor as usize],
                None => &mut world,
            };
            for corner in corners(swept) {
                bounds.extend(above.anchor_from_node.transform_point3(corner));
            }
        }
        world
    }

    /// `world`, and the boxes about nodes in some moments. Between two moments a corner leaves the hull of both by at most a
    /// quarter of its way, if what it turns by is less than a quarter turn.
    fn seen_in(&self, moments: &[f64], drivers: &Drivers<'_>, about: &[Bounds], mut world: Bounds) -> Bounds {
        let mut last: Vec<DVec3> = Vec::new();
        for &time_secs in moments {
            let world_from_nodes = self.world_from_nodes(drivers, time_secs);
            let placed = about.iter().zip(&world_from_nodes);
            let corners = placed.flat_map(|(of, by)| corners(*of).map(|corner| by.transform_point3(corner)));
            let now: Vec<DVec3> = corners.collect();
            for (at, &corner) in now.iter().enumerate() {
                let margin = last.get(at).map_or(0.0, |last| (corner - *last).length() * 0.25);
                world.extend(corner - margin);
                world.extend(corner + margin);
            }
            last = now;
        }
        world
    }
}

/// All keys and the middles between them, or fewer for many nodes, in seconds; `None` if animations differ in length.
fn moments(drivers: &Drivers<'_>, nodes: usize) -> Option<Vec<f64>> {
    let driving = || drivers.values().flatten().flatten();
    let length = driving().map(|(animation, _)| animation.length_secs()).next()?;
    if driving().any(|(animation, _)| animation.length_secs() != length) {
        return None;
    }
    let mut keys: Vec<f64> =
        driving().flat_map(|(_, channel)| &channel.times_secs).map(|&t| f64::from(t)).collect();
    // An animation begins again in the moment of its last key.
    keys.retain(|&time| time > 0.0 && time < length);
    keys.extend([0.0, length.next_down().max(0.0)]);
    // Margins follow the way between two moments, which is long between few keys.
    keys.extend((1..64).map(|i| length * f64::from(i) / 64.0));
    keys.sort_by(f64::total_cmp);
    keys.dedup();
    let most = (MOST_POSES / (2 * nodes.max(1))).clamp(8, 256);
    let thinned: Vec<f64> =
        keys.iter().copied().step_by(keys.len().div_ceil(most)).chain(keys.last().copied()).collect();
    let middles = thinned.windows(2).map(|pair| (pair[0] + pair[1]) * 0.5);
    let mut moments: Vec<f64> = thinned.iter().copied().chain(middles).collect();
    moments.sort_by(f64::total_cmp);
    Some(moments)
}

/// The box that a box in a node sweeps in the node's parent.
fn sweep(of: Bounds, rest: Parts, driven: &[Option<(&Animation, &Channel)>; 4]) -> Bounds {
    let channel = |property: usize| driven[property].map(|(_, channel)| channel);
    let at = |point: DVec3| Bounds { min: point, max: point };
    let scale = channel(2).and_then(hull).unwrap_or_else(|| at(rest.scale));
    let moved = channel(0).and_then(hull).unwrap_or_else(|| at(rest.translation));
    let mut scaled = Bounds::EMPTY;
    for corner in corners(of) {
        scaled.extend(corner * scale.min);
        scaled.extend(corner * scale.max);
    }
    let turned = match channel(1) {
        Some(channel) => turned(scaled, channel),
        None => rotated(scaled, [rest.rotation], 0.0),
    };
    if turned.is_empty() {
        return turned;
    }
    Bounds { min: turned.min + moved.min, max: turned.max + moved.max }
}

/// The box around all values of a translation or scale. A line lies between its ends, and a Hermite curve within its
/// Bézier points.
fn hull(channel: &Channel) -> Option<Bounds> {
    let (Track::Translation(values) | Track::Scale(values)) = &channel.track else { return None };
    let mut hull = Bounds::EMPTY;
    if channel.interpolation != Interpolation::CubicSpline {
        values.iter().for_each(|value| hull.extend(value.as_dvec3()));
        return (!hull.is_empty()).then_some(hull);
    }
    let keys = values.as_chunks::<3>().0;
    keys.iter().for_each(|[_, value, _]| hull.extend(value.as_dvec3()));
    for (times, keys) in channel.times_secs.windows(2).zip(keys.windows(2)) {
        let third = (f64::from(times[1]) - f64::from(times[0])) / 3.0;
        hull.extend(keys[0][1].as_dvec3() + keys[0][2].as_dvec3() * third);
        hull.extend(keys[1][1].as_dvec3() - keys[1][0].as_dvec3() * third);
    }
    (!hull.is_empty()).then_some(hull)
}

/// The box around a box in all orientations of a channel.
fn turned(of: Bounds, channel: &Channel) -> Bounds {
    let Track::Rotation(values) = &channel.track else { return of };
    let keys = || values.iter().map(|q| unit(q.as_dquat()));
    match channel.interpolation {
        Interpolation::Step => rotated(of, keys(), 0.0),
        Interpolation::Linear => {
            let mut all = rotated(of, keys().take(1), 0.0);
            for (a, b) in keys().zip(keys().skip(1)) {
                // A quaternion turns by twice its angle.
                let angle = 2.0 * arc(a, b).0;
                let steps = (angle / STEP).ceil().max(1.0);
                let sagitta = 1.0 - (angle / steps * 0.5).cos();
                let along = (0..=steps as u32).map(|i| slerp(a, b, f64::from(i) / steps));
                all = union(all, rotated(of, along, sagitta));
            }
            all
        }
        // Between keys, a spline may take any rotation.
        Interpolation::CubicSpline => {
            let radius = reach(of);
            if of.is_empty() { of } else { Bounds { min: DVec3::splat(-radius), max: DVec3::splat(radius) } }
        }
    }
}

/// The box around a box in several orientations, grown by a share of its reach.
fn rotated(of: Bounds, orientations: impl IntoIterator<Item = DQuat>, share: f64) -> Bounds {
    let mut all = Bounds::EMPTY;
    for orientation in orientations {
        for corner in corners(of) {
            all.extend(orientation * corner);
        }
    }
    let margin = reach(of) * share;
    if all.is_empty() { all } else { Bounds { min: all.min - margin, max: all.max + margin } }
}

/// Distance of the farthest corner from the origin.
fn reach(of: Bounds) -> f64 {
    corners(of).map(DVec3::length).fold(0.0, f64::max)
}

fn union(a: Bounds, b: Bounds) -> Bounds {
    Bounds { min: a.min.min(b.min), max: a.max.max(b.max) }
}

/// The corners of a box; none if it is empty.
fn corners(of: Bounds) -> impl Iterator<Item = DVec3> {
    let pick = move |bit: usize, axis: usize| if bit >> axis & 1 == 0 { of.min[axis] } else { of.max[axis] };
    (0..if of.is_empty() { 0 } else { 8 }).map(move |i| DVec3::new(pick(i, 0), pick(i, 1), pick(i, 2)))
}
