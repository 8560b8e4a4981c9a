//! The value of a channel at a time (glTF 2.0, section 3.11 and appendix C).

use std::ops::{Add, Mul};

use glam::{DQuat, DVec3, DVec4};

use super::{Channel, Interpolation, Track};

/// The position of a time among the keys.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Place {
    /// Exactly at a key, or before the first or after the last.
    At(usize),
    /// After a key: the share of the way to the next one, and the span's length in seconds.
    After(usize, f64, f64),
}

impl Channel {
    /// Which of translation, rotation, scale and weights it drives: 0 to 3.
    pub(crate) fn property(&self) -> usize {
        match self.track {
            Track::Translation(_) => 0,
            Track::Rotation(_) => 1,
            Track::Scale(_) => 2,
            Track::Weights(_) => 3,
        }
    }

    /// Whether it has keys and as many values as needed.
    pub(crate) fn is_whole(&self) -> bool {
        let values = match &self.track {
            Track::Translation(values) | Track::Scale(values) => values.len(),
            Track::Rotation(values) => values.len(),
            Track::Weights(_) => self.targets() * self.times_secs.len() * self.values_a_key(),
        };
        let whole = values == self.times_secs.len() * self.values_a_key();
        let weights =
            matches!(&self.track, Track::Weights(weights) if !weights.is_empty() && weights.len() == values);
        !self.times_secs.is_empty() && (whole && self.property() < 3 || weights)
    }

    /// The number of targets whose weights it drives.
    fn targets(&self) -> usize {
        let Track::Weights(weights) = &self.track else { return 0 };
        weights.len() / (self.times_secs.len() * self.values_a_key()).max(1)
    }

    fn values_a_key(&self) -> usize {
        if self.interpolation == Interpolation::CubicSpline { 3 } else { 1 }
    }

    /// The translation or scale at a time in seconds from the animation's start. `None` for a rotation channel or a
    /// value that is not finite.
    pub fn vector_at(&self, time_secs: f64) -> Option<DVec3> {
        let (Track::Translation(values) | Track::Scale(values)) = &self.track else { return None };
        let value = |at: usize| values.get(at).map(|v| v.as_dvec3());
        let found = match (self.place(time_secs), self.interpolation) {
            (Place::At(key), Interpolation::CubicSpline) => value(3 * key + 1),
            (Place::At(key) | Place::After(key, ..), Interpolation::Step) | (Place::At(key), _) => value(key),
            (Place::After(key, share, _), Interpolation::Linear) => {
                Some(value(key)?.lerp(value(key + 1)?, share))
            }
            (Place::After(key, share, secs), Interpolation::CubicSpline) => {
                let [from, out, into, to] = [1, 2, 3, 4].map(|i| value(3 * key + i));
                Some(hermite([from?, out? * secs, into? * secs, to?], share))
            }
        };
        found.filter(|vector| vector.is_finite())
    }

    /// The rotation at a time in seconds, of unit length; the identity if the keys are zero. `None` for other channels.
    pub fn rotation_at(&self, time_secs: f64) -> Option<DQuat> {
        let Track::Rotation(values) = &self.track else { return None };
        let value = |at: usize| values.get(at).map(|q| q.as_dquat());
        let found = match (self.place(time_secs), self.interpolation) {
            (Place::At(key), Interpolation::CubicSpline) => value(3 * key + 1)?,
            (Place::At(key) | Place::After(key, ..), Interpolation::Step) | (Place::At(key), _) => {
                value(key)?
            }
            (Place::After(key, share, _), Interpolation::Linear) => {
                slerp(unit(value(key)?), unit(value(key + 1)?), share)
            }
            (Place::After(key, share, secs), Interpolation::CubicSpline) => {
                let [from, out, into, to] = [1, 2, 3, 4].map(|i| value(3 * key + i).map(DVec4::from));
                DQuat::from_vec4(hermite([from?, out? * secs, into? * secs, to?], share))
            }
        };
        found.is_finite().then(|| unit(found))
    }

    /// The weights of all targets at a time in seconds from the animation's start. `None` for other channels, or if one is
    /// not finite.
    pub fn weights_at(&self, time_secs: f64) -> Option<Vec<f32>> {
        let Track::Weights(values) = &self.track else { return None };
        let (targets, place) = (self.targets(), self.place(time_secs));
        let weight = |target: usize| {
            let value = |at: usize| values.get(at * targets + target).map(|&w| f64::from(w));
            let found = match (place, self.interpolation) {
                (Place::At(key), Interpolation::CubicSpline) => value(3 * key + 1),
                (Place::At(key) | Place::After(key, ..), Interpolation::Step) | (Place::At(key), _) => {
                    value(key)
                }
                (Place::After(key, share, _), Interpolation::Linear) => {
                    Some(value(key)? * (1.0 - share) + value(key + 1)? * share)
                }
                (Place::After(key, share, secs), Interpolation::CubicSpline) => {
                    let [from, out, into, to] = [1, 2, 3, 4].map(|i| value(3 * key + i));
                    Some(hermite([from?, out? * secs, into? * secs, to?], share))
                }
            };
            found.map(|weight| weight as f32).filter(|weight| weight.is_finite())
        };
        (0..targets).map(weight).collect()
    }

    /// Smallest and largest weights of all targets. A Hermite curve lies within its Bézier points. `None` for other channels.
    pub(crate) fn weights_hull(&self) -> Option<[Vec<f32>; 2]> {
        let Track::Weights(values) = &self.track else { return None };
        let targets = self.targets();
        let mut hull = [vec![f32::INFINITY; targets], vec![f32::NEG_INFINITY; targets]];
        let mut extend = |target: usize, weight: f32| {
            hull[0][target] = hull[0][target].min(weight);
            hull[1][target] = hull[1][target].max(weight);
        };
        let width = self.values_a_key() * targets;
        for (key, (values, &time)) in values.chunks_exact(width.max(1)).zip(&self.times_secs).enumerate() {
            for target in 0..targets {
                if self.interpolation != Interpolation::CubicSpline {
                    extend(target, values[target]);
                    continue;
                }
                let [into, value, out] = [0, 1, 2].map(|part| values[part * targets + target]);
                let before = key.checked_sub(1).map_or(time, |key| self.times_secs[key]);
                let after = self.times_secs.get(key + 1).copied().unwrap_or(time);
                extend(target, value);
                extend(target, value - into * (time - before) / 3.0);
                extend(target, value + out * (after - time) / 3.0);
            }
        }
        (!values.is_empty()).then_some(hull)
    }

    /// Finds the keys around a time. Before the first key it is the first, after the last the last. Of equal times
    /// the last key counts, so that no span has zero length.
    fn place(&self, time_secs: f64) -> Place {
        let times = &self.times_secs;
        let later = times.partition_point(|&t| f64::from(t) <= time_secs);
        if later == 0 || later == times.len() {
            return Place::At(later.saturating_sub(1));
        }
        let (from, to) = (f64::from(times[later - 1]), f64::from(times[later]));
        Place::After(later - 1, (time_secs - from) / (to - from), to - from)
    }
}

/// Scales to unit length; the identity if that is impossible.
pub(crate) fn unit(q: DQuat) -> DQuat {
    let most = q.x.abs().max(q.y.abs()).max(q.z.abs()).max(q.w.abs());
    // Divided by the largest part first, since squares of tiny numbers are zero. Written so that NaN fails.
    if most > 0.0 && most.is_finite() { (q / most).normalize() } else { DQuat::IDENTITY }
}

/// The angle in radians between two unit quaternions along the shorter arc, and the sign of the second one on that
/// arc. Uses the tangent, which stays exact where the textbook's cosine is flat.
pub(crate) fn arc(a: DQuat, b: DQuat) -> (f64, DQuat) {
    let b = if a.dot(b) < 0.0 { -b } else { b };
    (2.0 * (a - b).length().atan2((a + b).length()), b)
}

/// Interpolates along the shorter arc between unit quaternions (Shoemake, "Animating rotation with quaternion
/// curves", 1985).
pub(crate) fn slerp(a: DQuat, b: DQuat, share: f64) -> DQuat {
    let (angle, b) = arc(a, b);
    let sine = angle.sin();
    if sine < 1e-9 {
        return unit(a * (1.0 - share) + b * share);
    }
    unit(a * (((1.0 - share) * angle).sin() / sine) + b * ((share * angle).sin() / sine))
}

/// Cubic Hermite interpolation. The inputs are value, tangent, tangent, value, with tangents times the span's length.
fn hermite<V: Copy + Mul<f64, Output = V> + Add<Output = V>>([from, out, into, to]: [V; 4], t: f64) -> V {
    let (t2, t3) = (t * t, t * t * t);
    from * (2.0 * t3 - 3.0 * t2 + 1.0)
        + out * (t3 - 2.0 * t2 + t)
        + to * (3.0 * t2 - 2.0 * t3)
        + into * (t3 - t2)
}
