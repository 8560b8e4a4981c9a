//! Indirect light of MegaViews (Kol et al. 2018), section 6: by virtual point lights whose shadow maps are rendered in one
//! traversal, and by small maps of a lit octree.
//!
//! - [`vpl`]: instant radiosity (Keller 1997), with exact maps, imperfect ones, and those of an octree;
//! - [`point_based`]: small maps around receivers (Christensen 2008).
//!
//! [`add_to`] plugs both into a sampler.

mod layout;
mod passes;
pub mod point_based;
pub mod programs;
pub mod vpl;

use std::any::Any;
use std::sync::Arc;

use argus_sampler::GpuSampler;
use argus_sampler::plug::{IndirectMethod, Methods};
use argus_scene::{Indirect, RenderError};

use self::point_based::{PointBased, PointReport};
use self::vpl::{Radiosity, VplReport};

/// Adds indirect light by virtual point lights and by points to the methods of a sampler.
pub fn add_to(methods: &mut Methods) {
    methods.indirect = Some(Arc::new(|gpu, scene, resident, settings| -> Option<Box<dyn IndirectMethod>> {
        match settings {
            Indirect::Vpl(settings) => {
                Some(Box::new(Radiosity::new(gpu, scene, &resident.instances, settings)))
            }
            Indirect::Points(settings) => Some(Box::new(PointBased::new(gpu, resident, settings))),
            Indirect::Off | Indirect::Paths(_) | Indirect::Cells(_) => None,
        }
    }));
}

/// Report on a sampler's light by VPLs, with the culling since the last call. `None` before it was first needed.
///
/// # Errors
/// The device is lost.
pub fn vpl_report(sampler: &GpuSampler) -> Result<Option<VplReport>, RenderError> {
    method::<Radiosity>(sampler).map_or(Ok(None), |light| light.report(sampler.gpu()))
}

/// Report on a sampler's point-based light. `None` before it was first needed.
pub fn point_report(sampler: &GpuSampler) -> Option<PointReport> {
    method::<PointBased>(sampler)?.report()
}

fn method<M: IndirectMethod>(sampler: &GpuSampler) -> Option<&M> {
    let method: &dyn Any = sampler.indirect_method()?;
    method.downcast_ref()
}
