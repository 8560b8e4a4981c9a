//! Settings of point-based indirect light.

use std::fmt;

use serde::{Deserialize, Serialize};

use crate::InvalidField;

/// Settings of point-based indirect light. `argus-lab study method virtual-lights` measures the cost of each.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct PointSettings {
    /// Levels of the scene's octree below its root, 1 to 10: the resolution of the light's sources.
    pub levels: u32,
    /// Texels on a side of a hemisphere of a receiver's map, 8 to 256.
    pub map_side: u32,
    /// Sub-samples on a side of the blocks that share one or two receivers, 1 to 16.
    pub block: u32,
    /// Most reflections between a light and the visible surface, 1 to 4.
    pub bounces: u32,
    /// Whether nearby receivers share nodes (MegaViews); otherwise the octree is traversed for each receiver alone
    /// (ManyLoDs).
    pub sharing: bool,
}

impl Default for PointSettings {
    fn default() -> Self {
        Self { levels: 7, map_side: 16, block: 8, bounces: 1, sharing: true }
    }
}

impl fmt::Display for PointSettings {
    /// All fields in short form, for provenance.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { levels, map_side, block, bounces, sharing } = self;
        let shared = if *sharing { "shared" } else { "own" };
        write!(
            f,
            "points of {levels} levels and {bounces} bounces, {shared} maps of {map_side} for blocks of {block}"
        )
    }
}

impl PointSettings {
    /// Checks all ranges.
    ///
    /// # Errors
    /// The field that is out of range.
    pub fn validate(&self) -> Result<(), InvalidField> {
        InvalidField::within("indirect.levels", self.levels, 1..=10)?;
        InvalidField::within("indirect.map_side", self.map_side, 8..=256)?;
        InvalidField::within("indirect.block", self.block, 1..=16)?;
        InvalidField::within("indirect.bounces", self.bounces, 1..=4).map(drop)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_setting_out_of_range_is_named() {
        let default = PointSettings::default();
        assert_eq!(default.validate(), Ok(()));
        let cases = [
            (PointSettings { levels: 0, ..default }, "indirect.levels"),
            (PointSettings { levels: 11, ..default }, "indirect.levels"),
            (PointSettings { map_side: 7, ..default }, "indirect.map_side"),
            (PointSettings { block: 0, ..default }, "indirect.block"),
            (PointSettings { block: 17, ..default }, "indirect.block"),
            (PointSettings { bounces: 5, ..default }, "indirect.bounces"),
        ];
        for (settings, field) in cases {
            assert_eq!(settings.validate().unwrap_err().field, field);
        }
    }
}
