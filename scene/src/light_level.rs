//! Levels of light: how much of a sample set's light a version shows.

use std::fmt;

use serde::{Deserialize, Serialize};

/// How much of the light that a sample set asks for a version of it shows. Light among surfaces takes seconds to prepare, so
/// a service starts without it. Better light comes as later versions. Only sets with indirect light by paths have levels
/// ([`crate::PathSettings::at`]); all others show all of their light from the start.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LightLevel {
    /// Direct light alone: what reaches surfaces from lights, the sky and emitting surfaces.
    Direct,
    /// Indirect light as well, even within cells of twice the set's size.
    Coarse,
    /// All light that the set's specification asks for.
    #[default]
    Full,
}

impl LightLevel {
    /// All levels, ascending.
    pub const ALL: [Self; 3] = [Self::Direct, Self::Coarse, Self::Full];

    /// Name in messages and options.
    pub fn name(self) -> &'static str {
        match self {
            Self::Direct => "direct",
            Self::Coarse => "coarse",
            Self::Full => "full",
        }
    }

    /// The next better level; `None` for the best one.
    pub fn next(self) -> Option<Self> {
        match self {
            Self::Direct => Some(Self::Coarse),
            Self::Coarse => Some(Self::Full),
            Self::Full => None,
        }
    }
}

impl fmt::Display for LightLevel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_ascend_to_the_default() {
        assert!(LightLevel::ALL.is_sorted_by(|a, b| a < b && a.next() == Some(*b)));
        assert_eq!(LightLevel::ALL.last(), Some(&LightLevel::default()));
        assert_eq!(LightLevel::default().next(), None);
    }
}
