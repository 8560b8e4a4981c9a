//! Light that surfaces reflect onto one another, and glowing particles: how a sample set finds it.

mod cells;
mod paths;
mod points;
mod vpl;

use std::fmt;

use serde::{Deserialize, Serialize};

pub use cells::CellSettings;
pub use paths::PathSettings;
pub use points::PointSettings;
pub use vpl::{MOST_VPL_GROUPS, MapSource, VplSettings};

use crate::{InvalidField, LightEffects};

/// How light from surface to surface is found: alike in all samples of a set and in direct views.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Indirect {
    /// None: surfaces are lit by lights and sky alone.
    #[default]
    Off,
    /// Instant radiosity (Keller 1997): paths from the lights leave virtual point lights (VPLs) on the surfaces that
    /// reflect, and every visible surface gathers from some of them. Glowing particles are gathered with them.
    Vpl(VplSettings),
    /// Point-based (Christensen 2008): some of the visible surfaces see small images of an octree of shaded points.
    Points(PointSettings),
    /// Paths between leaves of an octree: leaf sides exchange light along rays that are traced once, and some of the visible
    /// surfaces gather it. Direct light is traced, too: see [`Indirect::effects_with`].
    Paths(PathSettings),
    /// The same leaves of an octree, whose light is gathered in light cells on surfaces, together with that of the sky, once for
    /// all views.
    Cells(CellSettings),
}

impl Indirect {
    /// Rejects settings that are out of range.
    ///
    /// # Errors
    /// `indirect` and the setting's name.
    pub fn validate(&self) -> Result<(), InvalidField> {
        match self {
            Self::Off => Ok(()),
            Self::Vpl(settings) => settings.validate(),
            Self::Points(settings) => settings.validate(),
            Self::Paths(settings) => settings.validate(),
            Self::Cells(settings) => settings.validate(),
        }
    }

    /// The effects of direct light in a set with this indirect light, where `asked` are asked for.
    ///
    /// Paths need shadows, sky visibility and emitters: light that a surface reflects is light that reached it, and a ray that
    /// gathers counts neither sky nor emission, which are direct light. Soft shadows stay as asked, and with no bounces all but the
    /// sky. Virtual point lights and points count emission themselves, so emitters are off.
    #[must_use]
    pub fn effects_with(&self, asked: LightEffects) -> LightEffects {
        match self {
            Self::Off => asked,
            Self::Vpl(settings) if settings.vpls == 0 => asked,
            Self::Cells(settings) if settings.paths.bounces == 0 => {
                LightEffects { sky_visibility: true, ..asked }
            }
            Self::Paths(_) | Self::Cells(_) => {
                LightEffects { shadows: true, sky_visibility: true, emitters: true, ..asked }
            }
            Self::Vpl(_) | Self::Points(_) => LightEffects { emitters: false, ..asked },
        }
    }

    /// Checks that effects of direct light go with this indirect light.
    ///
    /// # Errors
    /// `effects`, if they differ from [`Self::effects_with`].
    pub fn check_effects(&self, effects: LightEffects) -> Result<(), InvalidField> {
        let with = self.effects_with(effects);
        match with == effects {
            true => Ok(()),
            false => Err(InvalidField::new(
                "effects",
                format!("must be {with} with indirect light {self}, not {effects}"),
            )),
        }
    }

    /// What leaves of an octree exchange, where light is found by them.
    pub fn paths(&self) -> Option<PathSettings> {
        match self {
            Self::Paths(settings) => Some(*settings),
            Self::Cells(settings) => Some(settings.paths),
            Self::Off | Self::Vpl(_) | Self::Points(_) => None,
        }
    }

    /// Whether it changes with time though nothing of the scene moves: glowing particles drift.
    pub fn drifts(&self) -> bool {
        matches!(self, Self::Vpl(settings) if settings.particles > 0)
    }
}

impl fmt::Display for Indirect {
    /// The method and all of its settings in a few words.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Off => f.write_str("off"),
            Self::Vpl(settings) => settings.fmt(f),
            Self::Points(settings) => settings.fmt(f),
            Self::Paths(settings) => settings.fmt(f),
            Self::Cells(settings) => settings.fmt(f),
        }
    }
}
