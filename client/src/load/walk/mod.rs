//! Walks of a load's viewers. They stay in free space: before a load, range views show what stands around each viewpoint.
//!
//! A walk is a function of the scene, the viewer's number and the time, so that loads with the same walk are compared, and their
//! references are rendered once.

mod explore;
mod jumps;
mod looping;
mod pose;
mod roam;
mod surroundings;
#[cfg(test)]
mod tests;
mod trail;

use std::fmt;
use std::str::FromStr;
use std::sync::Arc;
use std::time::Duration;

use argus_scene::{Camera, InvalidField};
use serde::{Deserialize, Serialize};

use self::jumps::Jumps;
use self::looping::Looping;
use self::pose::Walk;
use self::roam::Roam;
use super::schedule::Cameras;
use crate::{Client, ClientError};

/// How the viewers of a load move.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum WalkKind {
    /// Each viewer swings about one of the scene's viewpoints, over and over.
    #[default]
    Loop,
    /// Four groups of people walk through the scene and do not come back the same way.
    Roam,
    /// A viewer stands for some seconds, then stands at another place.
    Jumps,
    /// Each viewer stands at one of the scene's viewpoints.
    Rest,
}

impl WalkKind {
    /// All kinds.
    pub const ALL: [Self; 4] = [Self::Loop, Self::Roam, Self::Jumps, Self::Rest];

    /// The kind's name in options and reports.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Loop => "loop",
            Self::Roam => "roam",
            Self::Jumps => "jumps",
            Self::Rest => "rest",
        }
    }
}

impl fmt::Display for WalkKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for WalkKind {
    type Err = InvalidField;

    fn from_str(name: &str) -> Result<Self, InvalidField> {
        let unknown =
            || InvalidField::new("walk", format!("must be loop, roam, jumps or rest, not {name:?}"));
        Self::ALL.into_iter().find(|kind| kind.name() == name).ok_or_else(unknown)
    }
}

/// The cameras of a walk that is to last for a time; after it, viewers who roam turn back. The service renders the range views that
/// keep the walk in free space: no light is computed for them.
///
/// # Errors
/// A range view is not answered.
pub async fn walk(client: &Client, kind: WalkKind, lasts: Duration) -> Result<Cameras, ClientError> {
    let viewpoints: Vec<Camera> = client.description().cameras.iter().map(|named| named.camera).collect();
    let probe = async |at| surroundings::probe(client, at).await;
    let bounds = client.description().bounds;
    let walk: Arc<dyn Walk> = match kind {
        WalkKind::Loop => Arc::new(Looping::new(client.description(), &probe).await?),
        WalkKind::Roam => Arc::new(Roam::new(&viewpoints, bounds, lasts, &probe).await?),
        WalkKind::Jumps => Arc::new(Jumps::new(&viewpoints, bounds, &probe).await?),
        WalkKind::Rest => Arc::new(Rest(viewpoints)),
    };
    Ok(Arc::new(move |viewer, secs| walk.camera(viewer, secs)))
}

/// Viewers who stand at the scene's viewpoints, in turn.
#[derive(Debug)]
struct Rest(Vec<Camera>);

impl Walk for Rest {
    fn camera(&self, viewer: u32, _: f64) -> Camera {
        self.0[viewer as usize % self.0.len()]
    }
}
