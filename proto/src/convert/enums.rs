//! The enums that exist in the vocabulary and on the wire, and structs with the same fields on both sides.

use argus_scene::effects::{EffectKind, Paid};
use argus_scene::{
    Detail, Effect, Holes, InvalidField, LightLevel, MapSource, MegaViews, Output, PathSettings, PlaneFormat,
    PlaneKind, PointSettings, Preset, SampleId, Search, Served, Visibility,
};

use super::{known, unspecified};
use crate::v1;

/// An enum of the vocabulary that travels as a number.
pub trait WireEnum: Sized {
    /// The number on the wire.
    fn number(self) -> i32;

    /// The value of a number from the wire; `None` for "unspecified".
    ///
    /// # Errors
    /// [`InvalidField`] of `field` if the number is unknown.
    fn open(number: i32, field: &'static str) -> Result<Option<Self>, InvalidField>;

    /// The value of a number from the wire.
    ///
    /// # Errors
    /// [`InvalidField`] of `field` if the number is unknown or unspecified.
    fn from_number(number: i32, field: &'static str) -> Result<Self, InvalidField> {
        Self::open(number, field)?.ok_or_else(|| unspecified(field))
    }
}

/// Declares pairs of enums with equal variants. `or X` names a variant that has no number: it travels as "unspecified".
macro_rules! wire_enums {
    ($($type:ident, $wire:ident: $($variant:ident)+ $(, or $absent:ident)?;)*) => { $(
        impl WireEnum for $type {
            fn number(self) -> i32 {
                match self {
                    $(Self::$absent => v1::$wire::Unspecified,)?
                    $(Self::$variant => v1::$wire::$variant,)+
                }
                .into()
            }

            fn open(number: i32, field: &'static str) -> Result<Option<Self>, InvalidField> {
                Ok(match known(number, field)? {
                    v1::$wire::Unspecified => None,
                    $(v1::$wire::$variant => Some(Self::$variant),)+
                })
            }
        }
    )* };
}

wire_enums! {
    Detail, Detail: FewRays Half HalfFewRays Quarter, or Full;
    Effect, Effect: AlphaCutout Emission Specular Transmission NormalMap PunctualLights Sky Animation;
    EffectKind, EffectKind: Sun PointLights SpotLights Shadows SoftShadows Emitters SkyVisibility Highlights Reflection
        Transmission Indirect Glow Particles CutOuts Transparency Animation;
    Holes, Holes: Mark Trace;
    LightLevel, LightLevel: Direct Coarse Full;
    MapSource, VplMaps: Unshadowed Exact Imperfect MegaViews ManyLods;
    Output, Output: Color Range Mask Source Confidence Radiance Depth Normal Instance Material Flow;
    Paid, Paid: Sample View Epoch Pose;
    PlaneFormat, PlaneFormat: Rgb9e5Ufloat Rgba16Float R32Float Rg16Snorm Rgba8Unorm R32Uint;
    PlaneKind, PlaneKind: Radiance InverseRange Normal Specular Reflector ProbeSphere LightVisibility;
    Preset, Preset: Interactive Balanced Exact;
    Search, Search: Splat Linear Seeded Pyramid;
    Visibility, Visibility: Raster Trace Cpu;
}

/// Declares pairs of structs with equal fields.
macro_rules! wire_structs {
    ($($type:ident, $wire:ident: $($field:ident)+;)*) => { $(
        impl From<$type> for v1::$wire {
            fn from($type { $($field),+ }: $type) -> Self {
                Self { $($field),+ }
            }
        }

        impl From<v1::$wire> for $type {
            fn from(v1::$wire { $($field),+ }: v1::$wire) -> Self {
                Self { $($field),+ }
            }
        }
    )* };
}

wire_structs! {
    MegaViews, MegaViewsSampling: map_side levels block;
    PathSettings, PathIndirect: level rays bounces gather;
    PointSettings, PointIndirect: levels map_side block bounces sharing;
    SampleId, SampleId: version camera;
    Served, Served: warped other_sample traced unresolved;
}

/// A level of light from a wire enum's number; unspecified is the best one.
///
/// # Errors
/// [`InvalidField`] of `field` if the number is unknown.
pub fn light_level(number: i32, field: &'static str) -> Result<LightLevel, InvalidField> {
    Ok(LightLevel::open(number, field)?.unwrap_or(LightLevel::Full))
}
