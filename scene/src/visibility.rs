//! How triangles are seen.

use serde::{Deserialize, Serialize};

use crate::Sampling;
use crate::frame::INDIRECT_BY;

/// A way to find which triangle each sub-sample sees. All agree but along edges; which is cheapest depends on device,
/// scene and size, so that it is measured, once, before the first sample of a generation is rendered
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

/// Stands in [`crate::Provenance::device`] between the kind of device and the way in which triangles were seen.
const TRIANGLES_BY: &str = "; triangles by ";

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

    /// As [`crate::Provenance::device`] has it: the kind of device, followed by the way unless that is the rasteriser.
    pub fn on_device(self, kind: &str) -> String {
        match self {
            Self::Raster => kind.to_owned(),
            _ => format!("{kind}{TRIANGLES_BY}{}", self.name()),
        }
    }

    /// The kind of device in a [`crate::Provenance::device`], and the way if it names one that is known.
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
    fn a_device_says_the_way_and_gives_it_back() {
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
