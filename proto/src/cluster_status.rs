//! The status of a cluster, as JSON and tables show it. Its one definition is [`v1::StatusResponse`].

use argus_scene::{CellReport, Visibility};
use serde::{Serialize, Serializer};

use crate::convert::{self, WireEnum as _};
use crate::v1;

impl v1::StatusResponse {
    /// Counts since the coordinator started; zeros if the message lacks them.
    pub fn counts(&self) -> v1::Counters {
        self.counters.unwrap_or_default()
    }

    /// Progress of refinement; zeros if the message lacks it.
    pub fn refined(&self) -> v1::Refinements {
        self.refinements.unwrap_or_default()
    }

    /// How open views are answered and sources bought; zeros if the message has no market.
    pub fn priced(&self) -> v1::Market {
        self.market.unwrap_or_default()
    }

    /// The scene's name; empty if the message lacks it.
    pub fn scene_name(&self) -> &str {
        scene_name(&self.scene)
    }

    /// The visibility backend: `raster`, `trace` or `cpu`; empty until it is chosen.
    pub fn visibility_name(&self) -> &'static str {
        visibility_name(self.visibility)
    }

    /// The light of the served version: `direct`, `coarse` or `full`.
    pub fn light_name(&self) -> &'static str {
        light_name(self.light)
    }
}

impl v1::SceneStatus {
    /// The user's name of the scene's file or generator; empty if the message lacks it.
    pub fn scene_name(&self) -> &str {
        scene_name(&self.scene)
    }
}

impl v1::WorkerStatus {
    /// `sampler`, `compositor`, `both`, `draining`, `idle`, or `unknown` to this release.
    pub fn role_name(&self) -> &'static str {
        role_name(self.role)
    }
}

impl v1::LightCells {
    /// Share of the pixels that asked for cells which cells lit, 0 to 1; 0 if none asked.
    pub fn lit_share(&self) -> f64 {
        self.pixels_lit as f64 / self.pixels.max(1) as f64
    }
}

impl From<CellReport> for v1::LightCells {
    fn from(of: CellReport) -> Self {
        Self {
            pages: of.pages as u64,
            cells: of.cells as u64,
            bytes: of.bytes as u64,
            filled: of.filled,
            fill_ms: of.fill_ms,
            waiting: of.waiting as u64,
            pixels: of.pixels,
            pixels_lit: of.pixels_lit,
            pages_taken: of.pages_taken,
            take_ms: of.take_ms,
            pages_kept: of.pages_kept,
            pages_touched: of.pages_touched,
            pages_older: of.pages_older as u64,
            faces_kept: of.faces_kept,
            faces_changed: of.faces_changed,
        }
    }
}

fn scene_name(scene: &Option<v1::SceneRef>) -> &str {
    scene.as_ref().map_or("", |scene| &scene.name)
}

fn visibility_name(number: i32) -> &'static str {
    Visibility::from_number(number, "visibility").map_or("", |visibility| visibility.name())
}

fn light_name(number: i32) -> &'static str {
    convert::light_level(number, "light").map_or("unknown", |light| light.name())
}

fn role_name(number: i32) -> &'static str {
    match v1::Role::try_from(number) {
        Ok(v1::Role::Sampler) => "sampler",
        Ok(v1::Role::Compositor) => "compositor",
        Ok(v1::Role::Both) => "both",
        Ok(v1::Role::Draining) => "draining",
        Ok(v1::Role::Idle) => "idle",
        Ok(v1::Role::Unspecified) | Err(_) => "unknown",
    }
}

pub(crate) fn scene<S: Serializer>(scene: &Option<v1::SceneRef>, to: S) -> Result<S::Ok, S::Error> {
    to.serialize_str(scene_name(scene))
}

pub(crate) fn visibility<S: Serializer>(number: &i32, to: S) -> Result<S::Ok, S::Error> {
    to.serialize_str(visibility_name(*number))
}

pub(crate) fn light<S: Serializer>(number: &i32, to: S) -> Result<S::Ok, S::Error> {
    to.serialize_str(light_name(*number))
}

pub(crate) fn role<S: Serializer>(number: &i32, to: S) -> Result<S::Ok, S::Error> {
    to.serialize_str(role_name(*number))
}

/// Unknown numbers become 0, since JSON has no NaN and scripts expect a number.
pub(crate) fn number<S: Serializer>(value: &f64, to: S) -> Result<S::Ok, S::Error> {
    to.serialize_f64(if value.is_finite() { *value } else { 0.0 })
}

/// An absent part becomes one of zeros.
pub(crate) fn or_default<S: Serializer, T: Serialize + Default + Copy>(
    part: &Option<T>,
    to: S,
) -> Result<S::Ok, S::Error> {
    part.unwrap_or_default().serialize(to)
}
