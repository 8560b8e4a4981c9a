//! Reflections of direct views, deferred to what the view's own pixels see: no reflection probe is rendered for them.
//!
//! Shading leaves the surface of each reflective sub-sample and the number of its reflector. This stage finds what the
//! sub-samples reflect, shades that, and adds it. There are two ways ([`argus_scene::ProbeSource`]):
//!
//! - Rays: each reflected ray is traced. The definition is the reference's (`scene/src/reference/reflection.rs`).
//! - Points (Gavane and Watson, "Eye-Based Point Rendering for Dynamic Multiview Effects", 2022, section 4.1): the view
//!   fills indexed maps around the reflectors that it sees, looks them up, and shades each point that a lookup met once.
//!
//! # Steps of a view
//!
//! 1. With points: the method that is plugged in finds the reflectors in the view and fills their maps, once.
//! 2. For each tile, [`lobes`]: the rays of what the tile's sub-samples reflect. Sharp reflections have rays of their own.
//!    Blurred ones have a ray a pixel, and neighbours share them.
//! 3. [`crate::stages`]: what rays meet is shaded, without what depends on the viewer (`passes/shade_points.rs`), and rays that meet
//!    reflectors go on.
//! 4. `passes/add_reflections.rs` adds it, weighted by the surfaces' lobes.

mod lobes;
mod taps;

use argus_gpu::{Gpu, wgpu};
use argus_scene::{ProbeSource, ReflectionProbeSet, RenderError, Scene, ViewJob};

use crate::SamplerSettings;
use crate::passes::{AddReflections, ProbeBindings, Shade, ShadePoints};
use crate::reflected_light::{ReflectedScene, ReflectionSource, Reflectors, ViewMaps};
use crate::resident::{GBufferUse, Resident, upload};

pub(crate) use lobes::Lobes;
pub use taps::taps;

/// The programs that find reflections of direct views, for one scene on one device.
pub(crate) struct ViewReflections {
    pub(crate) set: ReflectionProbeSet,
    pub(crate) reflectors: Reflectors,
    /// Shades without reflections, and notes which reflector a sub-sample shows.
    pub(crate) shade: Shade,
    /// No probes, and the number of each instance's reflector.
    pub(crate) bindings: ProbeBindings,
    pub(crate) points: ShadePoints,
    pub(crate) add: AddReflections,
}

impl ViewReflections {
    /// The programs of a scene.
    ///
    /// # Errors
    /// [`RenderError::OutOfMemory`] if the device cannot bind a word for each instance.
    pub(crate) fn new(
        gpu: &Gpu,
        scene: &Scene,
        resident: &Resident,
        settings: &SamplerSettings,
        set: ReflectionProbeSet,
    ) -> Result<Self, RenderError> {
        let reflectors = Reflectors::new(scene, set.settings.most);
        let numbers = upload(gpu, "numbers of reflectors", &reflectors.numbers, wgpu::BufferUsages::STORAGE)?;
        let g_buffer = GBufferUse::of(settings).at_least_kept();
        Ok(Self {
            set,
            reflectors,
            shade: Shade::deferring(gpu, resident.features, g_buffer),
            bindings: ProbeBindings { probe_of_instance: numbers, ..ProbeBindings::none(gpu) },
            points: ShadePoints::new(gpu, resident.features, g_buffer),
            add: AddReflections::new(gpu),
        })
    }

    /// The maps of the reflectors that a view sees; `None` if reflections are traced. `ids` finds the view's visibility.
    pub(crate) fn see(
        &self,
        reflected: &ReflectedScene,
        scene: &Scene,
        view: &ViewJob,
        time_secs: f64,
        ids: impl FnOnce() -> Vec<[u32; 2]>,
    ) -> Option<Box<dyn ViewMaps>> {
        let (ProbeSource::Points { budget }, ReflectionSource::Points(points)) =
            (self.set.settings.source, &reflected.found_by)
        else {
            return None;
        };
        let instances = &self.reflectors.instances;
        Some(points.clone().maps_of_view(scene, instances, &ids(), view, time_secs, budget))
    }
}
