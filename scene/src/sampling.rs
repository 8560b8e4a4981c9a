//! How samples come about.

use std::fmt;

use serde::{Deserialize, Serialize};

use crate::{InvalidField, Rig, RigKind, RigKnobs};

/// What a sampler renders samples from: alike in all samples of a set, whoever renders them. Direct views, and single
/// pixels that no sample saw, come from triangles always.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Sampling {
    /// The triangles, each sample by itself: exact.
    #[default]
    Triangles,
    /// An octree of the scene's surfaces, which are shaded once for all samples, traversed together with the sample
    /// cameras (MegaViews, Kol et al. 2018). Omni cameras alone ([`Rig::Cell`]).
    MegaViews(MegaViews),
}

/// What maps of an octree are like; `argus study omni-maps` shows what each of the knobs costs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct MegaViews {
    /// Texels on a side of a map's hemisphere, 8 to 1024.
    pub map_side: u32,
    /// Levels of the scene's octree below its root, 1 to 10.
    pub levels: u32,
    /// Cameras along an edge of the block of the rig's lattice whose maps are rendered together and share what looks
    /// alike from them: 1, where each is traversed by itself, 2 or 4.
    pub block: u32,
}

/// Most bytes of the maps of one block: what devices bind that bind least, which is 128 MiB an array, in four arrays.
const MOST_BLOCK_BYTES: u64 = 512 << 20;

impl Default for MegaViews {
    /// Texels about twice as wide as those of a cube whose faces have 512, and cells of a five-hundredth of the scene.
    fn default() -> Self {
        Self { map_side: 512, levels: 9, block: 1 }
    }
}

impl fmt::Display for MegaViews {
    /// All of them in a few words.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { map_side, levels, block } = self;
        write!(f, "maps of {map_side} from {levels} levels")?;
        if *block > 1 { write!(f, " in blocks of {block}") } else { Ok(()) }
    }
}

impl Sampling {
    /// Names of all, as users write them.
    pub const NAMES: [&str; 2] = ["triangles", "megaviews"];

    /// As users write it, without its knobs.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Triangles => Self::NAMES[0],
            Self::MegaViews(_) => Self::NAMES[1],
        }
    }

    /// Samples that it pays to render together, though the first of them is then done no sooner than the last.
    pub fn batch(&self) -> usize {
        match self {
            Self::Triangles => 1,
            // The corners of a cell: what one viewer waits for.
            Self::MegaViews(_) => 8,
        }
    }

    /// What a user said about the rig, with the rule that such samples need where nobody said which.
    pub fn rig_knobs(&self, knobs: RigKnobs) -> RigKnobs {
        match self {
            Self::Triangles => knobs,
            Self::MegaViews(_) => RigKnobs { kind: knobs.kind.or(Some(RigKind::Cell)), ..knobs },
        }
    }

    /// Rejects knobs that are out of range, and a rig whose cameras such samples cannot be taken with.
    ///
    /// # Errors
    /// `sampling` or one of its knobs, by name.
    pub fn validate(&self, rig: &Rig) -> Result<(), InvalidField> {
        let Self::MegaViews(MegaViews { map_side, levels, block }) = *self else { return Ok(()) };
        if !matches!(rig, Rig::Cell { .. }) {
            let reason =
                "megaviews renders omni cameras, and those of the rig tile-corners are not: take --rig cell";
            return Err(InvalidField::new("sampling", reason));
        }
        if !(8..=1024).contains(&map_side) {
            let reason = format!("must be 8 to 1024 texels, not {map_side}");
            return Err(InvalidField::new("sampling.map_side", reason));
        }
        if !(1..=10).contains(&levels) {
            return Err(InvalidField::new("sampling.levels", format!("must be 1 to 10, not {levels}")));
        }
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
    fn every_knob_out_of_range_is_named_and_so_is_the_wrong_rig() {
        let cell = Rig::Cell { origin: DVec3::ZERO, spacing: 1.0, face: 64 };
        let bounds = Bounds { min: DVec3::ZERO, max: DVec3::ONE };
        let tiles = Rig::TileCorners { bounds, tiles: [1, 1], height: 1.0, size: [4, 4] };
        let default = MegaViews::default();
        let field = |knobs, rig| Sampling::MegaViews(knobs).validate(rig).unwrap_err().field;
        assert_eq!(Sampling::MegaViews(default).validate(&cell), Ok(()));
        assert_eq!(Sampling::Triangles.validate(&tiles), Ok(()));
        assert_eq!(field(default, &tiles), "sampling");
        assert_eq!(field(MegaViews { map_side: 2048, ..default }, &cell), "sampling.map_side");
        assert_eq!(field(MegaViews { levels: 0, ..default }, &cell), "sampling.levels");
        assert_eq!(field(MegaViews { block: 3, ..default }, &cell), "sampling.block");
        assert_eq!(field(MegaViews { block: 4, map_side: 1024, ..default }, &cell), "sampling.block");
    }
}
