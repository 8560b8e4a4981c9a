//! Programs that shade surfaces, and what reflections of a job are taken from.

use argus_gpu::Gpu;
use argus_scene::{ProbeSource, ReflectionProbeSet};

use crate::SamplerSettings;
use crate::passes::{ProbeBindings, ResolveSample, Shade, ShadeSample};
use crate::probe_renderer::ProbeRenderer;
use crate::reflected_light::ReflectedScene;
use crate::resident::{Features, GBufferUse, Resident};
use crate::stages::SurfaceProgram;
use crate::view_reflections::ViewReflections;

/// Programs that shade and resolve surfaces, without and with reflection probes.
pub(super) struct SurfacePrograms {
    shade: Shade,
    shade_sample: ShadeSample,
    resolve: ResolveSample,
    /// Bound where surfaces look up no probes.
    nothing: ProbeBindings,
    /// Reflection probes and their programs, made when a job first asks for reflections.
    pub(super) probes: Option<Box<ProbeRenderer>>,
    /// The programs of direct views that look up no probes, made when such a view first asks for reflections.
    pub(super) of_views: Option<Box<ViewReflections>>,
    /// The scene as reflections are found in it, made when a job first asks for reflections by rays or points.
    pub(super) reflected: Option<ReflectedScene>,
}

/// What reflections of a job are taken from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum ReflectionLookup {
    /// Surfaces reflect only lights and the sky.
    Nothing,
    /// Probes.
    Probes(ReflectionProbeSet),
    /// What the view's own pixels reflect.
    View(ReflectionProbeSet),
}

impl ReflectionLookup {
    /// What samples reflect.
    pub(super) fn probes(set: Option<ReflectionProbeSet>) -> Self {
        set.map_or(Self::Nothing, Self::Probes)
    }

    /// What lists of pixels reflect: what direct views do, if rays find it. Maps of points are of whole views.
    pub(super) fn of_list(set: Option<ReflectionProbeSet>) -> Self {
        match set {
            Some(set) if set.settings.source == ProbeSource::Rays => Self::View(set),
            set => Self::probes(set),
        }
    }

    /// What direct views reflect.
    pub(super) fn of_view(set: Option<ReflectionProbeSet>) -> Self {
        match set {
            Some(set) if !set.settings.source.serves_direct_views() => Self::View(set),
            set => Self::probes(set),
        }
    }
}

impl SurfacePrograms {
    /// Programs without reflection probes.
    pub(super) fn new(gpu: &Gpu, resident: &Resident, settings: &SamplerSettings) -> Self {
        let (features, g_buffer) = (resident.features, GBufferUse::of(settings));
        Self {
            shade: Shade::new(gpu, features, g_buffer, false),
            shade_sample: ShadeSample::new(gpu, features, g_buffer, false, settings.side()),
            resolve: ResolveSample::new(gpu, features.specular, 1, false, settings.effects.any()),
            nothing: ProbeBindings::none(gpu),
            probes: None,
            of_views: None,
            reflected: None,
        }
    }

    /// Whether programs of these settings and features are the same.
    pub(super) fn are_of(settings: [&SamplerSettings; 2], features: [Features; 2]) -> bool {
        let of =
            |settings: &SamplerSettings| (GBufferUse::of(settings), settings.side(), settings.effects.any());
        of(settings[0]) == of(settings[1]) && features[0] == features[1]
    }

    /// Forgets reflections, which show the light of a scene.
    pub(super) fn forget_reflections(&mut self) {
        (self.probes, self.of_views, self.reflected) = (None, None, None);
    }

    /// The programs for a job with those reflections, once they are ready.
    pub(super) fn of(&self, reflections: ReflectionLookup) -> SurfaceProgram<'_> {
        let without = SurfaceProgram {
            shade: &self.shade,
            shade_sample: &self.shade_sample,
            resolve: &self.resolve,
            probe_bindings: &self.nothing,
        };
        match (reflections, self.probes.as_deref(), self.of_views.as_deref()) {
            (ReflectionLookup::Probes(_), Some(probes), _) => match probes.probe_bindings() {
                Some(probe_bindings) => {
                    let ProbeRenderer { shade, shade_sample, resolve, .. } = probes;
                    SurfaceProgram { shade, shade_sample, resolve, probe_bindings }
                }
                None => without,
            },
            (ReflectionLookup::View(_), _, Some(ViewReflections { shade, bindings, .. })) => {
                SurfaceProgram { shade, probe_bindings: bindings, ..without }
            }
            _ => without,
        }
    }
}
