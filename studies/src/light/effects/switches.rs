//! Effects that are switched, and what goes with them.

use argus_scene::effects::EffectKind;
use argus_scene::{EffectPlan, LightEffects};

/// Effects that a request can switch.
pub(super) const SWITCHABLE: [EffectKind; 4] =
    [EffectKind::Shadows, EffectKind::SoftShadows, EffectKind::SkyVisibility, EffectKind::Emitters];

/// Effects that cast rays and light nothing; `None` if every effect may light something.
pub(super) fn neutral(plan: &EffectPlan) -> Option<LightEffects> {
    let is_dark = plan.row(EffectKind::Emitters).is_some_and(|row| !row.on && row.bound == 0.0);
    is_dark.then_some(LightEffects { emitters: true, ..LightEffects::NONE })
}

/// Whether some effects include one. Soft shadows have no effect without shadows.
pub(super) fn is_on(effects: LightEffects, effect: EffectKind) -> bool {
    match effect {
        EffectKind::Shadows => effects.shadows,
        EffectKind::SoftShadows => effects.shadows && effects.soft_shadows,
        EffectKind::SkyVisibility => effects.sky_visibility,
        EffectKind::Emitters => effects.emitters,
        _ => false,
    }
}

/// Effects with one switched on or off. Soft shadows need shadows, and go with them.
pub(super) fn switched(effects: LightEffects, effect: EffectKind, on: bool) -> LightEffects {
    match effect {
        EffectKind::Shadows => {
            LightEffects { shadows: on, soft_shadows: effects.soft_shadows && on, ..effects }
        }
        EffectKind::SoftShadows => {
            LightEffects { shadows: effects.shadows || on, soft_shadows: on, ..effects }
        }
        EffectKind::SkyVisibility => LightEffects { sky_visibility: on, ..effects },
        EffectKind::Emitters => LightEffects { emitters: on, ..effects },
        _ => effects,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn effects_are_switched_with_those_that_need_them() {
        let none = LightEffects::NONE;
        let soft = switched(none, EffectKind::SoftShadows, true);
        assert_eq!(soft, LightEffects { shadows: true, soft_shadows: true, ..none });
        assert_eq!(switched(soft, EffectKind::Shadows, false), none);
        assert_eq!(switched(soft, EffectKind::SoftShadows, false), LightEffects { shadows: true, ..none });
        for effect in SWITCHABLE {
            assert!(is_on(switched(none, effect, true), effect) && !is_on(none, effect));
            assert!(!is_on(switched(LightEffects::ALL, effect, false), effect));
        }
    }
}
