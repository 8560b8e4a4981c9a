//! Sources of samples: triangles, or an octree of the scene's surfaces.

use std::fmt;

use serde::{Deserialize, Serialize};

use crate::{InvalidField, Rig, RigKind, RigSettings};

/// Source of samples, the same for all samples of a set on every worker. Direct views, and single pixels that no
/// sample saw, always come from triangles.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Sampling {
    /// The triangles, each sample on its own: exact.
    #[default]
    Triangles,
    /// An octree of the scene's surfaces (MegaViews, Kol et al. 2018). Surfaces are shaded once for all samples, and one
    /// traversal serves many sample cameras. Only for omni cameras ([`Rig::Cell`]).
    MegaViews(MegaViews),
}

/// Settings of octree maps; `argus-lab study method omni-maps` measures the cost of each.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct MegaViews {
    /// Texels on a side of a map's hemisphere, 8 to 1024. More are sharper; cost grows with the square.
    pub map_side: u32,
    /// Levels of the scene's octree below its root, 1 to 10. More are sharper and cost time and memory.
    pub levels: u32,
    /// Edge, in cameras, of the block of the rig's lattice whose maps are rendered together and share similar parts:
    /// 1 (each map on its own), 2 or 4.
    pub block: u32,
}

/// Most bytes of the maps of one block: four arrays of 128 MiB, the smallest limit of devices for a binding.
const MOST_BLOCK_BYTES: u64 = 512 << 20;

impl Default for MegaViews {
    /// Texels about twice as wide as those of a cube with faces of 512, and cells of 1/500 of the scene.
    fn default() -> Self {
        Self { map_side: 512, levels: 9, block: 1 }
    }
}

impl fmt::Display for MegaViews {
    /// All settings, short, as in a frame's provenance.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { map_side, levels, block } = self;
        write!(f, "maps of {map_side} from {levels} levels")?;
        if *block > 1 { write!(f, " in blocks of {block}") } else { Ok(()) }
    }
}

impl Sampling {
    /// All names, as on the command line.
    pub const NAMES: [&str; 2] = ["triangles", "megaviews"];

    /// Its name on the command line, without settings.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Triangles => Self::NAMES[0],
            Self::MegaViews(_) => Self::NAMES[1],
        }
    }

    /// Number of samples that are cheaper to render together. All of them are then finished at the same time.
    pub fn batch(&self) -> usize {
        match self {
            Self::Triangles => 1,
            // The corners of a cell, for which one viewer waits.
            Self::MegaViews(_) => 8,
        }
    }

    /// The rig settings of a user; if unset, the kind of rig that these samples need.
    pub fn rig_settings(&self, settings: RigSettings) -> RigSettings {
        match self {
            Self::Triangles => settings,
            Self::MegaViews(_) => RigSettings { kind: settings.kind.or(Some(RigKind::Cell)), ..settings },
        }
    }

    /// Rejects settings that are out of range, and rigs whose cameras these samples do not support.
    ///
    /// # Errors
    /// `sampling` or one of its settings, by name.
    pub fn validate(&self, rig: &Rig) -> Result<(), InvalidField> {
        let Self::MegaViews(MegaViews { map_side, levels, block }) = *self else { return Ok(()) };
        if !matches!(rig, Rig::Cell { .. }) {
            let reason =
                "megaviews renders omni cameras, and those of the rig tile-corners are not: take --rig cell";
            return Err(InvalidField::new("sampling", reason));
        }
        InvalidField::within("sampling.map_side", map_side, 8..=1024)?;
        InvalidField::within("sampling.levels", levels, 1..=10)?;
        if ![1, 2, 4].contains(&block) {
            return Err(InvalidField::new("sampling.block", format!("must be 1, 2 or 4, not {block}")));
        }
        let bytes = u64::from(block).pow(3) * u64::from(map_side).pow(2) * 16;
        if bytes > MOST_BLOCK_BYTES {
            let reason = format!(
                "of {block} with maps of {map_side} takes {} MiB for one block, and {} are the most",
                bytes >> 20,
                MOST_BLOCK_BYTES >> 20
            );
            return Err(InvalidField::new("sampling.block", reason));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::Bounds;

    #[test]
    fn every_setting_out_of_range_and_the_wrong_rig_are_named() {
        let cell = Rig::Cell { origin: DVec3::ZERO, spacing: 1.0, face: 64 };
        let bounds = Bounds { min: DVec3::ZERO, max: DVec3::ONE };
        let tiles = Rig::TileCorners { bounds, tiles: [1, 1], height: 1.0, size: [4, 4] };
        let default = MegaViews::default();
        let field = |settings, rig| Sampling::MegaViews(settings).validate(rig).unwrap_err().field;
        assert_eq!(Sampling::MegaViews(default).validate(&cell), Ok(()));
        assert_eq!(Sampling::Triangles.validate(&tiles), Ok(()));
        assert_eq!(field(default, &tiles), "sampling");
        assert_eq!(field(MegaViews { map_side: 2048, ..default }, &cell), "sampling.map_side");
        assert_eq!(field(MegaViews { levels: 0, ..default }, &cell), "sampling.levels");
        assert_eq!(field(MegaViews { block: 3, ..default }, &cell), "sampling.block");
        assert_eq!(field(MegaViews { block: 4, map_side: 1024, ..default }, &cell), "sampling.block");
    }
}
