//! A search along a ray: what it looks for, and what it has found.

use std::cmp::Ordering;

use glam::{DVec2, DVec3};

use crate::transparency::{Layer, is_met, shown};

/// The nearest surface along a ray.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// Index into [`Scene::instances`].
    pub instance: u32,
    /// Index of the triangle in the instance's mesh.
    pub triangle: u32,
    /// Weights of the triangle's second and third corner; the first has what remains to 1.
    pub barycentric: DVec2,
    /// Distance from the ray's origin, metres.
    pub range: f64,
    /// World space, metres.
    pub position: DVec3,
    /// Whether the front is seen: the mesh's corners run counter-clockwise. A mirroring transform does not change a
    /// mesh's front (glTF 2.0, section 3.7.2.1).
    pub front: bool,
}

/// What a search makes of surfaces that hide a part of what is behind them: [`crate::transparency`].
pub(super) enum Partial {
    /// They are layers.
    Layers(Vec<Layer<Hit>>),
    /// One is met or not.
    Chance,
    /// The share that passes all of them.
    Passed(f32),
}

/// The limits of a search along a ray, and its hit so far; metres.
pub(super) struct Search {
    pub(super) nearest: Option<Hit>,
    pub(super) partial: Partial,
    /// The search ends at this range.
    pub(super) reach: f64,
    /// A hit nearer than this ends the search.
    pub(super) enough: f64,
    /// Whether the ray is one of light: single-sided triangles block it both ways, and glass lets it pass.
    pub(super) of_light: bool,
}

impl Search {
    /// A search for the nearest surface at any range.
    pub(super) fn nearest(partial: Partial, of_light: bool) -> Self {
        Self { nearest: None, partial, reach: f64::INFINITY, enough: 0.0, of_light }
    }

    /// A search for any surface up to a range.
    pub(super) fn any(partial: Partial, reach: f64, of_light: bool) -> Self {
        Self { nearest: None, partial, reach, enough: f64::INFINITY, of_light }
    }

    /// Range from which a further hit no longer matters.
    pub(super) fn limit(&self) -> f64 {
        match self.nearest {
            None => self.reach,
            Some(hit) if hit.range < self.enough => 0.0,
            Some(hit) => (hit.range * (1.0 + SAME_PLACE)).min(self.reach),
        }
    }
}

/// What a ray of sight sees.
#[derive(Debug, Clone, PartialEq)]
pub struct Seen {
    /// Transparent surfaces, front to back.
    pub layers: Vec<Layer<Hit>>,
    /// The surface behind them; `None` for the sky.
    pub behind: Option<Hit>,
}

impl Seen {
    /// The surface that the ray shows.
    pub fn shown(&self) -> Option<Hit> {
        shown(&self.layers).map_or(self.behind, |layer| Some(self.layers[layer].surface))
    }

    /// Each surface, `None` for the sky, with its share of the ray's radiance.
    pub fn shares(&self) -> impl Iterator<Item = (Option<&Hit>, f32)> {
        let mut through = 1.0;
        let front = self.layers.iter().map(|layer| (Some(&layer.surface), layer.alpha));
        let all = front.chain([(self.behind.as_ref(), 1.0)]);
        let shares = all.map(move |(surface, alpha)| {
            let share = through * alpha;
            through *= 1.0 - alpha;
            (surface, share)
        });
        shares.filter(|&(_, share)| share > 0.0)
    }
}

/// Whether `a` is nearer; of equal ranges, whether it has the lower (instance, triangle).
pub(super) fn precedes(a: &Hit, b: &Hit) -> bool {
    order(a, b).is_lt()
}

/// From near to far; of equal ranges, by (instance, triangle).
pub(super) fn order(a: &Hit, b: &Hit) -> Ordering {
    a.range.total_cmp(&b.range).then((a.instance, a.triangle).cmp(&(b.instance, b.triangle)))
}

/// Ranges of an instance that differ by less than this share are of one place.
pub(super) const SAME_PLACE: f64 = 1e-9;

/// Whether a ray that brings one surface meets this one, by [`crate::transparency`].
pub(super) fn is_met_at(hit: &Hit, coverage: f32) -> bool {
    let weights = [hit.barycentric.x as f32, hit.barycentric.y as f32];
    is_met(coverage, [hit.instance, hit.triangle], weights)
}
