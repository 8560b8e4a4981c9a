//! What a service is asked for: which effects, and by which method.

use std::collections::BTreeMap;
use std::fmt;
use std::str::FromStr;

use serde::Serialize;

use super::row::EffectKind;
use crate::{Indirect, InvalidField, LightEffects, Metering, ReflectionCost, Reflections, Scene};

/// Which of the effects that can be switched a sample set has.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Effects {
    /// Those that the scene has a cause for, and that may change a pixel by half a byte.
    #[default]
    Auto,
    /// Every one, whether or not the scene has a cause for it.
    All,
    /// No effect.
    None,
    /// Some effects, and no other.
    List(LightEffects),
}

impl Effects {
    /// All effects that may be rendered, whatever the scene calls for.
    pub fn most(self) -> LightEffects {
        match self {
            Self::Auto | Self::All => LightEffects::ALL,
            Self::None => LightEffects::NONE,
            Self::List(effects) => effects,
        }
    }
}

impl fmt::Display for Effects {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Auto => f.write_str("auto"),
            Self::All => f.write_str("all"),
            Self::None => f.write_str("none"),
            Self::List(effects) => effects.fmt(f),
        }
    }
}

impl FromStr for Effects {
    type Err = InvalidField;

    /// `auto`, `all`, `none`, or names with commas between: see [`LightEffects`].
    fn from_str(text: &str) -> Result<Self, InvalidField> {
        match text.trim() {
            "auto" => Ok(Self::Auto),
            "all" => Ok(Self::All),
            "none" => Ok(Self::None),
            list => list.parse().map(Self::List).map_err(|InvalidField { field, reason }| {
                InvalidField::new(
                    field,
                    format!("{reason}; auto stands alone and takes what the scene calls for"),
                )
            }),
        }
    }
}

/// How reflections of the scene are found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum ReflectionRequest {
    /// They are not: surfaces reflect only lights and the sky.
    Off,
    /// By the cheapest of some settings ([`ReflectionCost`]), if effects are automatic or all and the scene calls for it.
    Auto([Reflections; 3]),
    /// By these settings.
    By(Reflections),
}

impl ReflectionRequest {
    /// The cheapest source of usual settings.
    pub const AUTO: Self = Self::Auto(Reflections::USUAL);

    /// The settings that are taken if reflections are on.
    pub(super) fn settled(&self, scene: &Scene) -> Option<(Reflections, ReflectionCost)> {
        match *self {
            Self::Off => None,
            Self::By(settings) => {
                let [cost] = ReflectionCost::of(scene, [settings]);
                Some((settings, cost))
            }
            Self::Auto(all) => {
                let costs = all.into_iter().zip(ReflectionCost::of(scene, all));
                costs.min_by(|(_, a), (_, b)| a.ms.total_cmp(&b.ms))
            }
        }
    }
}

impl Default for ReflectionRequest {
    fn default() -> Self {
        Self::AUTO
    }
}

/// Which effects a service is asked for, and by which methods the costly ones are computed.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct EffectRequest {
    /// Effects that can be switched.
    pub effects: Effects,
    /// Method of indirect light; `None`: paths, if `effects` are automatic or all and the scene calls for them.
    pub indirect: Option<Indirect>,
    /// Whether surfaces reflect the scene, and how that is found.
    pub reflections: ReflectionRequest,
    /// Factor from radiance to display values, by which bounds are scaled; `None`: the scene's.
    pub exposure: Option<f32>,
}

impl EffectRequest {
    /// The light by which exposure is metered: all that may be rendered.
    pub fn metering(&self) -> Metering {
        self.effects.metering(self.indirect)
    }
}

impl Effects {
    /// The light by which exposure is metered, with this method of indirect light: all that may be rendered.
    pub fn metering(self, indirect: Option<Indirect>) -> Metering {
        let is_open = matches!(self, Self::Auto | Self::All);
        let asked = self.most();
        match indirect {
            Some(Indirect::Off) => Metering { effects: asked, indirect: false },
            Some(indirect) => {
                // However it is found, light from surfaces is light that reached them.
                Metering { effects: indirect.effects_with(asked), indirect: true }
            }
            None => Metering { effects: asked, indirect: is_open },
        }
    }
}

/// Milliseconds that effects cost on a device, by earlier measurements. An effect of lights has the cost of one light.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct EffectCosts {
    /// Milliseconds by effect; effects that were never measured are absent.
    pub ms: BTreeMap<EffectKind, f64>,
}
