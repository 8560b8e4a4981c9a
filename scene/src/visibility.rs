//! How triangles are seen.

use serde::{Deserialize, Serialize};

/// A way to find which triangle each sub-sample sees. All agree but along edges; which is cheapest depends on device,
/// scene and size, so that it is measured, once, before the first sample is rendered
/// ([`crate::Sampler::ways`]).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Visibility {
    /// By the device's rasteriser.
    #[default]
    Raster,
    /// By packets of rays in compute, where the device's subgroups have 8 lanes or more; elsewhere by the rasteriser.
    Trace,
    /// By packets of rays on the processor.
    Cpu,
}

impl Visibility {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Raster, Self::Trace, Self::Cpu];

    /// As users write it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Raster => "raster",
            Self::Trace => "trace",
            Self::Cpu => "cpu",
        }
    }
}
