//! Animations of nodes, and of the weights of their morph targets.

use glam::{Quat, Vec3};
use gltf::json;
use json::accessor::Type;
use json::animation::{Interpolation as JsonInterpolation, Property};
use json::validation::Checked;

use super::accessor::Reader;
use super::lookup::{Budget, get, name};
use super::nodes::Hierarchy;
use crate::animation::{Animation, Channel, Interpolation, Rest, Track};
use crate::load::parts::Warnings;

/// Reads all animations. A channel that cannot be read is left out with a warning.
///
/// # Errors
/// Channels that together claim more memory than the file can justify.
pub(super) fn read(
    reader: &Reader,
    hierarchy: &Hierarchy,
    budget: &mut Budget,
    warnings: &mut Warnings,
) -> Result<Vec<Animation>, String> {
    let mut animations = Vec::new();
    for (number, animation) in reader.root.animations.iter().enumerate() {
        let mut channels = Vec::new();
        for (k, json) in animation.channels.iter().enumerate() {
            for index in animation.samplers.get(json.sampler.value()).iter().flat_map(|s| [s.input, s.output])
            {
                budget.take(reader.count(index).unwrap_or(0), 32)?;
            }
            match channel(reader, hierarchy, animation, json) {
                Ok(Some(channel)) => channels.push(channel),
                Ok(None) => {}
                Err(reason) => warnings.add(format!("animation {number}, channel {k}: {reason}: left out")),
            }
        }
        if !channels.is_empty() {
            animations.push(Animation { name: name(&animation.name), channels });
        }
    }
    Ok(animations)
}

/// Reads one channel; `None` if it moves a node that is not drawn.
fn channel(
    reader: &Reader,
    hierarchy: &Hierarchy,
    animation: &json::Animation,
    json: &json::animation::Channel,
) -> Result<Option<Channel>, String> {
    get(&reader.root.nodes, json.target.node, "node")?;
    let Some(node) = hierarchy.index_of[json.target.node.value()] else { return Ok(None) };
    let of_weights = json.target.path == Checked::Valid(Property::MorphTargetWeights);
    if !of_weights && matches!(hierarchy.nodes[node as usize].rest, Rest::Matrix(_)) {
        return Err("its node is placed by a matrix, which no channel may move".to_owned());
    }
    let sampler = get(&animation.samplers, json.sampler, "sampler")?;
    let interpolation = match sampler.interpolation {
        Checked::Valid(JsonInterpolation::Linear) => Interpolation::Linear,
        Checked::Valid(JsonInterpolation::Step) => Interpolation::Step,
        Checked::Valid(JsonInterpolation::CubicSpline) => Interpolation::CubicSpline,
        Checked::Invalid => return Err("unknown interpolation".to_owned()),
    };
    let times_secs: Vec<f32> =
        reader.floats::<1>(sampler.input, &[Type::Scalar])?.into_iter().map(|[t]| t).collect();
    let vectors = || -> Result<Vec<Vec3>, String> {
        Ok(reader.floats::<3>(sampler.output, &[Type::Vec3])?.into_iter().map(Vec3::from).collect())
    };
    let track = match json.target.path {
        Checked::Valid(Property::Translation) => Track::Translation(vectors()?),
        Checked::Valid(Property::Scale) => Track::Scale(vectors()?),
        Checked::Valid(Property::Rotation) => {
            let values = reader.floats::<4>(sampler.output, &[Type::Vec4])?;
            let unit = |q: [f32; 4]| {
                let q = Quat::from_array(q);
                // The tangents of a cubic spline are not rotations.
                let scale = if interpolation == Interpolation::CubicSpline { 1.0 } else { q.length() };
                if scale > 0.0 { q / scale } else { Quat::IDENTITY }
            };
            Track::Rotation(values.into_iter().map(unit).collect())
        }
        Checked::Valid(Property::MorphTargetWeights) => {
            let weights = reader.floats::<1>(sampler.output, &[Type::Scalar])?;
            Track::Weights(weights.into_iter().map(|[weight]| weight).collect())
        }
        Checked::Invalid => return Err("unknown property".to_owned()),
    };
    let (count, finite) = match &track {
        Track::Translation(v) | Track::Scale(v) => (v.len(), v.iter().all(|v| v.is_finite())),
        Track::Rotation(q) => (q.len(), q.iter().all(|q| q.is_finite())),
        Track::Weights(w) => (w.len(), w.iter().all(|w| w.is_finite())),
    };
    let per_key = if interpolation == Interpolation::CubicSpline { 3 } else { 1 };
    // Weights are of all targets of the mesh.
    let targets = if of_weights { count / times_secs.len().saturating_mul(per_key).max(1) } else { 1 };
    let per_key = per_key * targets.max(1);
    if times_secs.is_empty() || Some(count) != times_secs.len().checked_mul(per_key) {
        return Err(format!("{} keys but {count} values", times_secs.len()));
    }
    let ascending = times_secs.windows(2).all(|w| w[0] <= w[1]) && times_secs.iter().all(|t| t.is_finite());
    if !finite || !ascending {
        return Err("its keys are not finite or not in order".to_owned());
    }
    Ok(Some(Channel { node, times_secs, track, interpolation }))
}
