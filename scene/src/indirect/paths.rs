//! Settings of indirect light by paths between leaves of an octree.

use std::fmt;

use serde::{Deserialize, Serialize};

use crate::{InvalidField, LightLevel};

/// Settings of indirect light by paths. `argus-lab study light indirect` measures the cost.
///
/// The surfaces in each cell of a grid over the scene are *leaf sides*. Each leaf side casts rays once and remembers the
/// leaf sides that they hit. Light then goes from side to side along these links, and visible surfaces gather it by rays
/// of their own.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct PathSettings {
    /// The grid has 2^level cells on a side, 1 to 9. One level more takes about four times the time and memory.
    pub level: u32,
    /// Rays of a leaf side, 1 to 256. Time and memory are proportional; noise falls with the root.
    pub rays: u32,
    /// Most reflections between a light and the visible surface, 1 to 16. One more costs little, because no ray is traced; 5 took
    /// a tenth of a white room's light. Light cells may have 0: surfaces light nothing, and cells keep what is seen of the sky alone.
    pub bounces: u32,
    /// Rays of each gathering texel, 1 to 256; a quarter of the texels gather. Paid by every sample and every direct view.
    pub gather: u32,
}

impl Default for PathSettings {
    fn default() -> Self {
        Self { level: 7, rays: 4, bounces: 16, gather: 4 }
    }
}

impl fmt::Display for PathSettings {
    /// All fields in short form, for provenance.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { level, rays, bounces, gather } = self;
        write!(f, "paths of {bounces} bounces, {rays} rays a leaf side of level {level}, gather {gather}")
    }
}

impl PathSettings {
    /// The settings at a level of light; `None` where there is no indirect light yet. Coarse leaf sides take a quarter of the
    /// time.
    pub fn at(&self, light: LightLevel) -> Option<Self> {
        match light {
            LightLevel::Direct => None,
            LightLevel::Coarse => Some(Self { level: self.level.saturating_sub(1).max(1), ..*self }),
            LightLevel::Full => Some(*self),
        }
    }

    /// Checks all ranges.
    ///
    /// # Errors
    /// The field that is out of range.
    pub fn validate(&self) -> Result<(), InvalidField> {
        InvalidField::within("indirect.level", self.level, 1..=9)?;
        InvalidField::within("indirect.rays", self.rays, 1..=256)?;
        InvalidField::within("indirect.bounces", self.bounces, 1..=16)?;
        InvalidField::within("indirect.gather", self.gather, 1..=256).map(drop)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_setting_out_of_range_is_named() {
        let default = PathSettings::default();
        assert_eq!(default.validate(), Ok(()));
        let cases = [
            (PathSettings { level: 0, ..default }, "indirect.level"),
            (PathSettings { level: 10, ..default }, "indirect.level"),
            (PathSettings { rays: 0, ..default }, "indirect.rays"),
            (PathSettings { bounces: 17, ..default }, "indirect.bounces"),
            (PathSettings { gather: 257, ..default }, "indirect.gather"),
        ];
        for (settings, field) in cases {
            assert_eq!(settings.validate().unwrap_err().field, field);
            assert_ne!(settings.to_string(), default.to_string());
        }
    }
}
