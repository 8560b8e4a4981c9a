//! The light of a sampler's scene: made ready for a job, prepared beside other work, changed, and reported.

use std::time::Instant;

use argus_scene::{
    Cancel, Frame, Indirect, InvalidField, LightEffects, LightLevel, Lighting, RenderError, SampleSetInfo,
    SceneState, Stage, ViewJob,
};

use super::gpu_sampler::GpuSampler;
use crate::indirect::{IndirectLight, IndirectMethod, LightInputs};
use crate::light::{DirectLight, LightConditions, PathLight, PathReport};
use crate::resident::GBufferUse;
use crate::{LightSettings, SamplerSettings, timing};

impl GpuSampler {
    /// Prepares direct light by rays and indirect light, as far as the settings ask for them. With `may_lag`, surfaces may be lit by
    /// others as these were in an earlier pose. Returns the cost.
    pub(super) fn light(
        &mut self,
        lighting: &Lighting,
        light: LightLevel,
        time_secs: f64,
        may_lag: bool,
    ) -> Result<Vec<Stage>, RenderError> {
        let (gpu, scene, resident) = (&self.gpu, &self.scene, &self.resident);
        let effects = self.settings.effects;
        let mut stages = Vec::new();
        match &mut self.lights.direct {
            Some(direct) => direct.relight(lighting),
            None if effects.any() => {
                let begin = Instant::now();
                let tracer = self.visibility.prepare_packets(resident);
                let conditions =
                    LightConditions { effects, settings: self.settings.light, lighting, time_secs };
                let direct = DirectLight::new(gpu, scene, resident.features, tracer, conditions)?;
                self.lights.direct = Some(direct);
                timing::add_since(&mut stages, "build trees for light", begin);
            }
            None => {}
        }
        if self.lights.indirect.is_none() {
            let new = self.methods.indirect.as_ref();
            self.lights.indirect = IndirectLight::new(gpu, scene, resident, self.settings.indirect, new);
        }
        let Some(indirect) = &mut self.lights.indirect else { return Ok(stages) };
        let tracer = self.visibility.prepare_packets(resident);
        let direct = self.lights.direct.as_ref();
        let inputs = LightInputs {
            gpu,
            scene,
            resident,
            tracer,
            direct,
            lighting,
            light,
            may_lag: may_lag && !self.animated,
            time_secs,
        };
        timing::add(&mut stages, indirect.ready(&inputs, &mut self.scratch)?);
        Ok(stages)
    }

    /// Has texels of images cast one of so many of their rays of light, until another job says otherwise.
    pub(super) fn divide_rays(&mut self, divisor: u32) {
        if let Some(direct) = &mut self.lights.direct {
            direct.divide_rays(divisor);
        }
    }

    pub(super) fn path_light(&self) -> Option<&PathLight> {
        self.lights.indirect.as_ref().and_then(IndirectLight::paths)
    }

    /// The method that finds indirect light, if it is plugged in. `None` before it was first needed.
    pub fn indirect_method(&self) -> Option<&dyn IndirectMethod> {
        self.lights.indirect.as_ref().and_then(IndirectLight::method)
    }

    /// Report on indirect light by paths. `None` before it was first needed.
    pub fn paths(&self) -> Option<PathReport> {
        self.lights.indirect.as_ref().and_then(IndirectLight::paths).and_then(PathLight::report)
    }

    /// Changes the settings of indirect light.
    ///
    /// # Errors
    /// A setting is out of range, the sampler was made without indirect light, or it was made without direct light by rays,
    /// which paths need.
    pub fn set_indirect(&mut self, settings: Indirect) -> Result<(), RenderError> {
        let settings = SamplerSettings { indirect: settings, ..self.settings };
        settings.validate()?;
        self.methods.check_indirect(settings.indirect)?;
        if [self.settings.indirect, settings.indirect].contains(&Indirect::Off) {
            return Err(
                InvalidField::new("indirect", "a sampler is made with indirect light or without").into()
            );
        }
        if GBufferUse::of(&self.settings) != GBufferUse::of(&settings) {
            let reason = "a sampler is made with direct light by rays, which paths need, or without";
            return Err(InvalidField::new("indirect", reason).into());
        }
        self.settings = settings;
        if !self.lights.indirect.as_mut().is_some_and(|light| light.set_settings(settings.indirect)) {
            self.lights.indirect = None;
        }
        if let Some(samples) = &mut self.samples {
            samples.forget_light();
        }
        if let Some(probes) = &mut self.surface_programs.probes {
            probes.forget_light();
        }
        Ok(())
    }

    /// Changes the rays of direct light.
    ///
    /// # Errors
    /// A setting is out of range.
    pub fn set_light(&mut self, light: LightSettings) -> Result<(), RenderError> {
        let settings = SamplerSettings { light, ..self.settings };
        settings.validate()?;
        let tracer = self.settings.light.tracer;
        self.settings = settings;
        self.path_light().inspect(|paths| paths.forget_faces());
        // Another tracer's trees are built for the next job.
        self.lights.direct.take_if(|_| light.tracer != tracer);
        if let Some(direct) = &mut self.lights.direct {
            direct.set_settings(light);
        }
        Ok(())
    }

    /// Renders a view of the present pose with other effects of direct light: no light that is kept is made with them. `None` if the sampler was made without any, since programs that read
    /// surfaces back were not made, or while other light is being prepared.
    pub(super) fn render_with_effects(
        &mut self,
        effects: LightEffects,
        view: &ViewJob,
    ) -> Option<Result<Frame, RenderError>> {
        if !effects.any()
            || !self.lights.direct.as_mut()?.set_effects(&self.scene, effects, self.posed.time_secs)
        {
            return None;
        }
        let state = SceneState { revision: self.posed.revision, ..view.state };
        let view = ViewJob { time_secs: self.posed.time_secs, state, ..view.clone() };
        let frame = self.render_view(&view, &Cancel::default());
        let (scene, own, time_secs) = (&self.scene, self.settings.effects, self.posed.time_secs);
        // Light that cannot be restored is made anew for the next job.
        self.lights.direct.take_if(|direct| !direct.set_effects(scene, own, time_secs));
        Some(frame)
    }

    /// Prepares a level of light beside other work. Returns whether it is ready.
    ///
    /// # Errors
    /// Those of preparing it.
    pub(super) fn prepare_level(
        &mut self,
        info: &SampleSetInfo,
        light: LightLevel,
    ) -> Result<bool, RenderError> {
        // Light of a pose is useless at the next one.
        if self.animated {
            return Ok(true);
        }
        if self.lights.indirect.is_none() {
            self.light(&info.lighting, LightLevel::Direct, info.time_secs(), false)?;
        }
        match (&mut self.lights.indirect, &self.lights.direct) {
            (Some(IndirectLight::Paths(paths)), Some(direct)) => paths.prepare(direct.tracing(), light),
            _ => Ok(true),
        }
    }
}
