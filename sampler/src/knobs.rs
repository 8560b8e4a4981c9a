//! What a user may say about samples, beside where they are taken from.

use argus_scene::{InvalidField, PlaneFormat};

use crate::Indirect;

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
            sub_samples: 4,
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
        if ![1, 4, 16].contains(&self.sub_samples) {
            let reason = format!("must be 1, 4 or 16, not {}", self.sub_samples);
            return Err(InvalidField::new("sampler.sub_samples", reason));
        }
        if !(8..=23).contains(&self.range_bits) {
            let reason = format!("must be 8 to 23, not {}", self.range_bits);
            return Err(InvalidField::new("sampler.range_bits", reason));
        }
        match &self.indirect {
            Indirect::Off => Ok(()),
            Indirect::Vpl(knobs) => knobs.validate(),
            Indirect::Points(knobs) => knobs.validate(),
        }
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
