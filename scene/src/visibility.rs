//! Visibility backends: methods to find visible triangles.

use serde::{Deserialize, Serialize};

/// Method to find the triangle of each sub-sample. All agree except along edges. Which is cheapest depends on device,
/// scene and size, so it is measured once, before the first sample is rendered
/// ([`crate::Sampler::measure_backends`]).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Visibility {
    /// The device's rasteriser.
    #[default]
    Raster,
    /// Packets of rays on the GPU, for devices with subgroups of 8 lanes or more; elsewhere the rasteriser.
    Trace,
    /// Packets of rays on the processor.
    Cpu,
}

impl Visibility {
    /// All backends.
    pub const ALL: [Self; 3] = [Self::Raster, Self::Trace, Self::Cpu];

    /// Its name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Raster => "raster",
            Self::Trace => "trace",
            Self::Cpu => "cpu",
        }
    }
}
