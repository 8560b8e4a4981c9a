//! What a user may say about samples, beside where they are taken from.

use argus_scene::{Indirect, InvalidField, PlaneFormat, SampleSetInfo, Specification, check_sub_samples};

/// How a sample stores radiance.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum RadianceFormat {
    /// 4 bytes a texel: three mantissas of 9 bits under one exponent, so a relative error of up to 2⁻⁹ of the
    /// brightest channel.
    #[default]
    SharedExponent,
    /// 8 bytes a texel: a relative error of up to 2⁻¹¹ in each channel.
    HalfFloat,
}

/// Quality of samples; each knob trades it for time or bytes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SamplerKnobs {
    /// Sub-samples of a texel, on a regular grid: 1, 4 or 16. Visibility is found for each; shading is paid once a triangle
    /// that the texel shows.
    pub sub_samples: u32,
    /// Mantissa bits that a stored inverse range keeps, 8 to 23: it is off by at most 2^-(bits + 1) of itself.
    pub range_bits: u32,
    /// How radiance is stored.
    pub radiance: RadianceFormat,
    /// Whether surfaces light one another.
    pub indirect: Indirect,
}

impl Default for SamplerKnobs {
    fn default() -> Self {
        Self {
            sub_samples: Specification::USUAL_SUB_SAMPLES,
            range_bits: 16,
            radiance: RadianceFormat::default(),
            indirect: Indirect::default(),
        }
    }
}

impl SamplerKnobs {
    /// Rejects values outside the documented ones.
    ///
    /// # Errors
    /// The knob, by name.
    pub fn validate(&self) -> Result<(), InvalidField> {
        check_sub_samples(self.sub_samples)?;
        if !(8..=23).contains(&self.range_bits) {
            let reason = format!("must be 8 to 23, not {}", self.range_bits);
            return Err(InvalidField::new("sampler.range_bits", reason));
        }
        self.indirect.validate()
    }

    /// Those of a sample set.
    pub fn of(set: &SampleSetInfo) -> Self {
        Self { sub_samples: set.sub_samples, indirect: set.indirect, ..Self::default() }
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
        if set.indirect != self.indirect {
            return differs("indirect", set.indirect.to_string(), self.indirect.to_string());
        }
        Ok(())
    }

    /// Sub-samples along each side of a texel.
    pub(crate) fn side(&self) -> u32 {
        self.sub_samples.isqrt()
    }
}

impl RadianceFormat {
    /// As planes name it.
    pub fn plane(self) -> PlaneFormat {
        match self {
            Self::SharedExponent => PlaneFormat::Rgb9e5Ufloat,
            Self::HalfFloat => PlaneFormat::Rgba16Float,
        }
    }
}
