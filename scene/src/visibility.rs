//! Visibility backends: methods to find visible triangles.

use serde::{Deserialize, Serialize};

use crate::Sampling;
use crate::frame::INDIRECT_BY;

/// Method to find the triangle of each sub-sample. All agree except along edges. Which is cheapest depends on device,
/// scene and size, so it is measured once, before the first sample of a generation is rendered
/// ([`crate::Sampler::ways`]).
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

/// Separator in [`crate::Provenance::device`] between the kind of device and the visibility backend.
const TRIANGLES_BY: &str = "; triangles by ";

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

    /// The kind of device followed by the backend, unless that is the rasteriser, as in [`crate::Provenance::device`].
    pub fn on_device(self, kind: &str) -> String {
        match self {
            Self::Raster => kind.to_owned(),
            _ => format!("{kind}{TRIANGLES_BY}{}", self.name()),
        }
    }

    /// The kind of device in a [`crate::Provenance::device`], and the backend if it names a known one.
    pub fn of_device(device: &str) -> (&str, Option<Self>) {
        let (device, _) = Sampling::of_device(device);
        let device = device.split_once(INDIRECT_BY).map_or(device, |(device, _)| device);
        match device.split_once(TRIANGLES_BY) {
            Some((kind, name)) => (kind, Self::ALL.into_iter().find(|way| way.name() == name)),
            None => (device, Some(Self::Raster)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::MegaViews;

    #[test]
    fn a_device_name_keeps_its_backend() {
        for way in Visibility::ALL {
            let device = way.on_device("llvmpipe");
            assert_eq!(Visibility::of_device(&device), ("llvmpipe", Some(way)));
            let mapped = Sampling::MegaViews(MegaViews::default()).on_device(device.clone());
            assert_eq!(Visibility::of_device(&mapped), ("llvmpipe", Some(way)));
            let lit = format!("{device}{INDIRECT_BY}64 lights");
            assert_eq!(Visibility::of_device(&lit), ("llvmpipe", Some(way)));
        }
        assert_eq!(Visibility::of_device("x; triangles by magic"), ("x", None));
    }
}
