//! Effects of light that reaches a surface directly, each of which can be off.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use crate::InvalidField;

/// Which effects direct light has. They change the bytes of samples, so they are part of a set's specification.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LightEffects {
    /// Surfaces block directional, point and spot lights.
    pub shadows: bool,
    /// Shadows have penumbras, by the extent of their light. Has no effect without `shadows`.
    pub soft_shadows: bool,
    /// Surfaces block the sky.
    pub sky_visibility: bool,
    /// Emitting triangles light other surfaces, and are blocked.
    pub emitters: bool,
}

impl LightEffects {
    /// No effect: lights and sky pass through surfaces, and emitters light nothing but themselves.
    pub const NONE: Self =
        Self { shadows: false, soft_shadows: false, sky_visibility: false, emitters: false };

    /// All effects.
    pub const ALL: Self = Self { shadows: true, soft_shadows: true, sky_visibility: true, emitters: true };

    /// Whether any effect is on: whether surfaces are lit by rays.
    pub fn any(self) -> bool {
        self.shadows || self.sky_visibility || self.emitters
    }

    /// Bit i is the i-th field.
    pub fn bits(self) -> u32 {
        let on = self.flags().map(|(_, on)| on);
        (0..).zip(on).map(|(bit, on)| u32::from(on) << bit).sum()
    }

    /// The effects of some bits.
    ///
    /// # Errors
    /// `effects`, for a bit that has no effect.
    pub fn from_bits(bits: u32) -> Result<Self, InvalidField> {
        if bits >= 16 {
            return Err(InvalidField::new("effects", format!("has unknown bits: {bits:#b}")));
        }
        let has = |bit: u32| bits >> bit & 1 == 1;
        Ok(Self { shadows: has(0), soft_shadows: has(1), sky_visibility: has(2), emitters: has(3) })
    }

    fn flags(self) -> [(&'static str, bool); 4] {
        let Self { shadows, soft_shadows, sky_visibility, emitters } = self;
        [
            ("shadows", shadows),
            ("soft-shadows", soft_shadows),
            ("sky-visibility", sky_visibility),
            ("emitters", emitters),
        ]
    }
}

impl fmt::Display for LightEffects {
    /// `none`, or the names of those that are on, with commas between.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let on: Vec<&str> = self.flags().into_iter().filter(|(_, on)| *on).map(|(name, _)| name).collect();
        if on.is_empty() { f.write_str("none") } else { f.write_str(&on.join(",")) }
    }
}

impl FromStr for LightEffects {
    type Err = InvalidField;

    /// `all`, `none`, or names with commas between. Soft shadows include shadows.
    fn from_str(text: &str) -> Result<Self, InvalidField> {
        let mut effects = Self::NONE;
        for name in text.split(',') {
            match name.trim() {
                "all" => effects = Self::ALL,
                "none" => {}
                "shadows" => effects.shadows = true,
                "soft-shadows" => (effects.shadows, effects.soft_shadows) = (true, true),
                "sky-visibility" => effects.sky_visibility = true,
                "emitters" => effects.emitters = true,
                other => {
                    let reason = format!(
                        "has no `{other}`: all, none, or some of shadows, soft-shadows, sky-visibility, emitters"
                    );
                    return Err(InvalidField::new("effects", reason));
                }
            }
        }
        Ok(effects)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_and_bits_bring_back_every_combination() {
        for bits in 0..16 {
            let effects = LightEffects::from_bits(bits).unwrap();
            assert_eq!(effects.bits(), bits);
            // Soft shadows without shadows have no effect and no name of their own.
            if effects.shadows || !effects.soft_shadows {
                assert_eq!(effects.to_string().parse(), Ok(effects));
            }
        }
        assert_eq!("all".parse(), Ok(LightEffects::ALL));
        assert!(LightEffects::from_bits(16).is_err());
        assert!("shadow".parse::<LightEffects>().unwrap_err().to_string().contains("`shadow`"));
    }
}
