//! A sampler that is made before the light of its scene is known.
//!
//! Which light a scene is shown in is metered, and which effects that calls for is decided then. Triangles, textures,
//! hierarchies and most programs do not depend on it, and take most of the time of making a sampler. So a process that knows
//! which scene it will probably render makes them meanwhile.

use std::sync::Arc;

use argus_gpu::Gpu;
use argus_scene::{
    Cancel, LightEffects, LightLevel, Outputs, Plan, RenderError, Sampler as _, Scene, SceneHash, SceneState,
    ViewJob,
};

use super::gpu_sampler::{GpuSampler, exposed};
use super::surface_programs::SurfacePrograms;
use crate::SamplerSettings;
use crate::light::LightConditions;
use crate::passes::Blend;
use crate::plug::Methods;

/// Size of the view that compiles programs, pixels.
const COMPILED_BY: [u32; 2] = [64, 48];

/// A sampler that still lacks the light of its scene.
pub struct PreparedSampler {
    /// Hash of the scene as it was opened.
    opened: SceneHash,
    /// Holds no scene, so that who opened it may change its light without a copy.
    sampler: GpuSampler,
}

impl PreparedSampler {
    /// Uploads a scene as it was opened, builds its hierarchies, and compiles the programs that its views will probably need:
    /// those of a set with effects of light, in the usual settings. The sampler has these methods beside its own.
    ///
    /// # Errors
    /// The errors of making a sampler and of rendering a view.
    pub fn new(gpu: Arc<Gpu>, scene: &Arc<Scene>, methods: Methods) -> Result<Self, RenderError> {
        let settings = SamplerSettings { effects: LightEffects::ALL, ..SamplerSettings::default() };
        let mut sampler = GpuSampler::with_methods(gpu, scene.clone(), settings, methods)?;
        let [width, height] = COMPILED_BY;
        let view = ViewJob {
            band_rows: 0,
            camera: scene.default_camera(),
            width,
            height,
            outputs: Outputs::COLOR,
            plan: Plan::direct(1),
            state: SceneState { light: LightLevel::Direct, ..SceneState::default() },
            time_secs: 0.0,
            visibility: sampler.usual_visibility(),
            reflections: None,
            history: None,
            rays: None,
        };
        for frame in sampler.render_views(&[view], &Cancel::default()) {
            frame?;
        }
        sampler.scene = Arc::default();
        sampler.visibility.set_scene(&sampler.scene);
        if let Some(direct) = &mut sampler.lights.direct {
            direct.share_textures(sampler.visibility.prepare_packets(&sampler.resident));
        }
        Ok(Self { opened: scene.hash, sampler })
    }

    /// Whether a scene is the one that was prepared, in any light, and a device still the same.
    pub fn is_of(&self, gpu: &Arc<Gpu>, scene: &Scene) -> bool {
        Arc::ptr_eq(gpu, &self.sampler.gpu) && self.opened.choice_of(scene.hash).is_some()
    }

    /// The sampler of the prepared scene in a light. It renders the same bytes as one that is made with these settings at once.
    ///
    /// # Errors
    /// The errors of [`GpuSampler::with_methods`].
    pub fn in_light(self, scene: Arc<Scene>, settings: SamplerSettings) -> Result<GpuSampler, RenderError> {
        settings.validate()?;
        self.sampler.methods.check_indirect(settings.indirect)?;
        let mut sampler = self.sampler;
        let before = (sampler.settings, sampler.resident.features);
        sampler.resident.relight(&sampler.gpu, &scene)?;
        sampler.visibility.set_scene(&scene);
        let features = sampler.resident.features;
        sampler.glossy = features.specular;
        if SurfacePrograms::are_of([&before.0, &settings], [before.1, features]) {
            sampler.surface_programs.forget_reflections();
        } else {
            sampler.surface_programs = SurfacePrograms::new(&sampler.gpu, &sampler.resident, &settings);
            let defers = sampler.glossy && settings.effects.any();
            sampler.blend = sampler.visibility.has_layers().then(|| Blend::new(&sampler.gpu, defers));
        }
        sampler.lighting = exposed(scene.at(0.0).lighting, &settings);
        let direct = sampler.lights.direct.take().filter(|_| settings.effects.any());
        sampler.lights.direct = direct.map(|direct| {
            let tracer = sampler.visibility.prepare_packets(&sampler.resident);
            let SamplerSettings { effects, light, .. } = settings;
            let lighting = &sampler.lighting;
            let conditions = LightConditions { effects, settings: light, lighting, time_secs: 0.0 };
            direct.of_scene(&sampler.gpu, &scene, features, tracer, conditions)
        });
        sampler.lights.indirect = None;
        sampler.samples = None;
        (sampler.settings, sampler.scene) = (settings, scene);
        Ok(sampler)
    }
}
