//! Settings of samples, except their cameras.

use argus_scene::{InvalidField, PlaneFormat};

use crate::Indirect;

/// How a sample stores radiance.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum RadianceFormat {
    /// 4 bytes a texel: three mantissas of 9 bits and a shared exponent. The error is up to 2⁻⁹ of the brightest channel.
    #[default]
    SharedExponent,
    /// 8 bytes a texel: a relative error of up to 2⁻¹¹ in each channel.
    HalfFloat,
}

/// Settings of samples. Each trades quality for time or bytes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SamplerKnobs {
    /// Sub-samples of a texel, on a regular grid: 1, 4 or 16. Visibility costs time for each; shading costs time for each
    /// triangle that the texel shows.
    pub sub_samples: u32,
    /// Mantissa bits of the stored inverse range, 8 to 23. The relative error is at most 2^-(bits + 1).
    pub range_bits: u32,
    /// How radiance is stored.
    pub radiance: RadianceFormat,
    /// Indirect light.
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
    /// Checks all ranges.
    ///
    /// # Errors
    /// The field that is out of range.
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
    /// The plane format.
    pub fn plane(self) -> PlaneFormat {
        match self {
            Self::SharedExponent => PlaneFormat::Rgb9e5Ufloat,
            Self::HalfFloat => PlaneFormat::Rgba16Float,
        }
    }
}
