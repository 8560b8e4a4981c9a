//! Settings of samples, except their cameras.

use argus_scene::{
    Indirect, InvalidField, LightEffects, PlaneFormat, SampleSetInfo, Specification, check_sub_samples,
};

/// How a sample stores radiance.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum RadianceFormat {
    /// 4 bytes a texel: three mantissas of 9 bits and a shared exponent. The error is up to 2⁻⁹ of the brightest channel.
    #[default]
    SharedExponent,
    /// 8 bytes a texel: a relative error of up to 2⁻¹¹ in each channel.
    HalfFloat,
}

/// What traces the rays of a tile to lights, sky, emitters and other surfaces, and looks its light cells up. Both have one
/// definition; pixels differ where rays graze an edge, and in the last digits. Lists of pixels and points of reflections are lit on
/// the CPU.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum LightTracer {
    /// The device, if it is no software driver and is measured to be faster; else the CPU.
    #[default]
    Auto,
    /// The CPU.
    Cpu,
    /// The device.
    Device,
}

/// Rays of direct light. Samples of one set have the same: the service uses the defaults, studies compare others.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LightSettings {
    /// Rays of a texel to the sky, 1 to 64. Neighbours in a square of 8×8 cast different ones and share what they find.
    pub sky_rays: u32,
    /// Rays of a texel to emitting triangles, 1 to 64.
    pub emitter_rays: u32,
    /// Whether neighbours on the same surface share what their rays to sky and emitters found.
    pub filter: bool,
    /// What traces them.
    pub tracer: LightTracer,
}

impl Default for LightSettings {
    fn default() -> Self {
        Self { sky_rays: 4, emitter_rays: 4, filter: true, tracer: LightTracer::Auto }
    }
}

impl LightSettings {
    /// Most rays of a texel, to the sky and to emitters.
    pub const MOST_RAYS: u32 = 64;

    /// With one of so many rays, at least one.
    pub(crate) fn divided(self, divisor: u32) -> Self {
        let rays = |rays: u32| rays.div_ceil(divisor.max(1));
        Self { sky_rays: rays(self.sky_rays), emitter_rays: rays(self.emitter_rays), ..self }
    }
}

/// Settings of samples. Each trades quality for time or bytes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SamplerSettings {
    /// Sub-samples of a texel, on a regular grid: 1, 4 or 16. Visibility costs time for each; shading costs time for each
    /// triangle that the texel shows.
    pub sub_samples: u32,
    /// Mantissa bits of the stored inverse range, 8 to 23. The relative error is at most 2^-(bits + 1).
    pub range_bits: u32,
    /// How radiance is stored.
    pub radiance: RadianceFormat,
    /// Effects of direct light. They must go with the indirect light: [`Indirect::check_effects`].
    pub effects: LightEffects,
    /// Rays of direct light.
    pub light: LightSettings,
    /// Indirect light.
    pub indirect: Indirect,
    /// Factor from radiance to display values of views from triangles; `None`: the scene's.
    pub exposure: Option<f32>,
}

impl Default for SamplerSettings {
    fn default() -> Self {
        Self {
            sub_samples: Specification::USUAL_SUB_SAMPLES,
            range_bits: 16,
            radiance: RadianceFormat::default(),
            effects: LightEffects::NONE,
            light: LightSettings::default(),
            indirect: Indirect::default(),
            exposure: None,
        }
    }
}

impl SamplerSettings {
    /// Checks all ranges.
    ///
    /// # Errors
    /// The field that is out of range.
    pub fn validate(&self) -> Result<(), InvalidField> {
        check_sub_samples(self.sub_samples)?;
        if !(8..=23).contains(&self.range_bits) {
            let reason = format!("must be 8 to 23, not {}", self.range_bits);
            return Err(InvalidField::new("sampler.range_bits", reason));
        }
        for (field, rays) in [
            ("sampler.light.sky_rays", self.light.sky_rays),
            ("sampler.light.emitter_rays", self.light.emitter_rays),
        ] {
            if !(1..=LightSettings::MOST_RAYS).contains(&rays) {
                let most = LightSettings::MOST_RAYS;
                return Err(InvalidField::new(field, format!("must be 1 to {most}, not {rays}")));
            }
        }
        if self.exposure.is_some_and(|exposure| !(exposure > 0.0 && exposure.is_finite())) {
            let reason = format!("must be above 0 and finite, not {:?}", self.exposure);
            return Err(InvalidField::new("sampler.exposure", reason));
        }
        self.indirect.validate()?;
        self.indirect.check_effects(self.effects)
    }

    /// Those of a sample set.
    pub fn of(set: &SampleSetInfo) -> Self {
        Self {
            sub_samples: set.sub_samples,
            effects: set.effects,
            indirect: set.indirect,
            exposure: Some(set.lighting.exposure),
            ..Self::default()
        }
    }

    /// Rejects a sample set that was specified otherwise: its samples would not be what their set says.
    ///
    /// # Errors
    /// The field, by name.
    pub(crate) fn check_set(&self, set: &SampleSetInfo) -> Result<(), InvalidField> {
        let differs = |field, theirs: String, ours: String| {
            let reason = format!("{theirs} is asked of a sampler that was made for {ours}");
            Err(InvalidField::new(field, reason))
        };
        if set.sub_samples != self.sub_samples {
            return differs("sub_samples", set.sub_samples.to_string(), self.sub_samples.to_string());
        }
        if set.effects != self.effects {
            return differs("effects", set.effects.to_string(), self.effects.to_string());
        }
        if set.indirect != self.indirect {
            return differs("indirect", set.indirect.to_string(), self.indirect.to_string());
        }
        Ok(())
    }

    /// Sub-samples along each side of a texel.
    pub fn side(&self) -> u32 {
        self.sub_samples.isqrt()
    }
}

impl RadianceFormat {
    /// The plane format.
    pub fn plane(self) -> PlaneFormat {
        match self {
            Self::SharedExponent => PlaneFormat::Rgb9e5Ufloat,
            Self::HalfFloat => PlaneFormat::Rgba16Float,
        }
    }
}

/// The error of a field whose value names a method that this build lacks.
pub fn missing(field: &'static str, name: &str) -> InvalidField {
    InvalidField::new(field, format!("{name} is not in this build, which lacks the feature `papers`"))
}
