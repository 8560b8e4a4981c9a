//! A scene on a device, at a pose, with what renders it.

use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::Instant;

use argus_gpu::{Gpu, GpuError, wgpu};
use argus_scene::{InvalidField, Lighting, RenderError, Scene, SceneState, Stage, Visibility};
use glam::DVec3;
use tracing::warn;

use super::surface_programs::SurfacePrograms;
use crate::SamplerSettings;
use crate::eye::Eye;
use crate::indirect::Lights;
use crate::pass_plan::{PassPlan, pass_plan};
use crate::passes::{Blend, ResolveView};
use crate::plug::{Methods, SampleMethod};
use crate::resident::Resident;
use crate::scratch::Scratch;
use crate::visibility::VisibilityBackends;

/// When a scene is shown: its time, and the transforms that clients set.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Moment {
    pub(super) time_secs: f64,
    /// See [`SceneState::revision`].
    pub(super) revision: u64,
}

impl Moment {
    /// The moment of a state at a scene time.
    pub(super) fn of(state: SceneState, time_secs: f64) -> Self {
        Self { time_secs, revision: state.revision }
    }
}

/// Renders a scene from its triangles, on one device.
///
/// The scene is uploaded once. A job uploads only what depends on its camera, and the transforms of instances and the
/// vertices of meshes that deform if its epoch differs from the last job's. After a loss of the device every job fails with [`RenderError::DeviceLost`]; make
/// another sampler on another [`Gpu`].
pub struct GpuSampler {
    pub(super) gpu: Arc<Gpu>,
    /// With the transforms and the shapes of `posed`.
    pub(super) scene: Arc<Scene>,
    pub(super) settings: SamplerSettings,
    pub(super) glossy: bool,
    pub(super) animated: bool,
    /// Lighting at `posed`.
    pub(super) lighting: Lighting,
    pub(super) posed: Moment,
    /// Nodes that clients moved since the sampler was made. What hangs from them has trees of its own.
    pub(super) movers: BTreeSet<u32>,
    pub(super) resident: Resident,
    pub(super) visibility: VisibilityBackends,
    pub(super) surface_programs: SurfacePrograms,
    pub(super) resolve_view: ResolveView,
    /// Programs that blend transparent surfaces; `None` for a scene without them.
    pub(super) blend: Option<Blend>,
    pub(super) scratch: Scratch,
    pub(super) layer_scratch: Scratch,
    /// One a list of pixels that is rendered beside others.
    pub(super) list_scratch: Vec<Scratch>,
    /// Where points of reflections are shaded.
    pub(super) point_scratch: Scratch,
    pub(super) lights: Lights,
    pub(super) methods: Methods,
    /// Renders samples otherwise than from triangles; made when a set first asks for it.
    pub(super) samples: Option<Box<dyn SampleMethod>>,
}

impl GpuSampler {
    /// Uploads a scene and makes the pipelines that it needs.
    ///
    /// # Errors
    /// [`RenderError::OutOfMemory`] if a part of the scene is larger than the device can bind,
    /// [`RenderError::Internal`] if fragment programs of the device cannot read the primitive index.
    pub fn new(gpu: Arc<Gpu>, scene: Arc<Scene>) -> Result<Self, RenderError> {
        Self::with_settings(gpu, scene, SamplerSettings::default())
    }

    /// Makes a sampler with these settings.
    ///
    /// # Errors
    /// The errors of [`Self::with_methods`].
    pub fn with_settings(
        gpu: Arc<Gpu>,
        scene: Arc<Scene>,
        settings: SamplerSettings,
    ) -> Result<Self, RenderError> {
        Self::with_methods(gpu, scene, settings, Methods::default())
    }

    /// Makes a sampler with these settings that has these methods beside its own.
    ///
    /// # Errors
    /// The errors of [`Self::new`], and [`RenderError::Invalid`] for a setting out of range, or that asks for another method.
    pub fn with_methods(
        gpu: Arc<Gpu>,
        scene: Arc<Scene>,
        settings: SamplerSettings,
        methods: Methods,
    ) -> Result<Self, RenderError> {
        settings.validate()?;
        methods.check_indirect(settings.indirect)?;
        if !gpu.device.features().contains(wgpu::Features::PRIMITIVE_INDEX) {
            let message = format!("{} does not number triangles in fragments", gpu.kind());
            return Err(RenderError::Internal(message));
        }
        let resident = Resident::new(&gpu, &scene)?;
        let glossy = resident.features.specular;
        let visibility = VisibilityBackends::new(&gpu, &scene, &resident);
        Ok(Self {
            blend: visibility.has_layers().then(|| Blend::new(&gpu, glossy && settings.effects.any())),
            visibility,
            surface_programs: SurfacePrograms::new(&gpu, &resident, &settings),
            lights: Lights::default(),
            methods,
            samples: None,
            resolve_view: ResolveView::new(&gpu),
            scratch: Scratch::default(),
            layer_scratch: Scratch::default(),
            list_scratch: Vec::new(),
            point_scratch: Scratch::default(),
            animated: scene.is_animated(),
            lighting: exposed(scene.at(0.0).lighting, &settings),
            posed: Moment::default(),
            movers: BTreeSet::new(),
            gpu,
            scene,
            settings,
            glossy,
            resident,
        })
    }

    /// The settings that the sampler was made with.
    pub fn settings(&self) -> &SamplerSettings {
        &self.settings
    }

    /// The device that it renders on.
    pub fn gpu(&self) -> &Arc<Gpu> {
        &self.gpu
    }

    /// The passes of this scene, and why each is on or off.
    pub fn plan(&self) -> Vec<PassPlan> {
        pass_plan(&self.scene, &self.resident, &self.settings, self.visibility.has_layers())
    }

    /// Poses the scene at a moment. Returns the cost, if it was posed at another one. What stands still is never posed again.
    ///
    /// # Errors
    /// [`RenderError::Internal`] if light cannot be traced in the scene, [`RenderError::Invalid`] for transforms that are not known.
    pub(super) fn pose(&mut self, moment: Moment) -> Result<Vec<Stage>, RenderError> {
        let is_moved = moment.revision != self.posed.revision;
        if !is_moved && (!self.animated || moment.time_secs == self.posed.time_secs) {
            return Ok(Vec::new());
        }
        let begin = Instant::now();
        let time_secs = moment.time_secs;
        let moved = match is_moved {
            true => self.moved_to(moment.revision)?,
            false => Arc::clone(&self.scene),
        };
        let scene = moved.posed(time_secs);
        let reshaped = !Arc::ptr_eq(&scene, &moved);
        self.scene = scene;
        if reshaped {
            self.resident.reshape(&self.gpu, &self.scene);
            // Its trees are those of the shapes before.
            self.surface_programs.reflected = None;
        }
        let pose = self.scene.at(time_secs);
        self.resident.place(&self.scene, &pose.instances);
        if self.has_new_movers() {
            self.visibility.forget_trees(&self.scene, &self.resident);
            self.lights.direct = None;
            // What was merged with others is rounded otherwise from now on.
            self.path_light().inspect(|paths| paths.forget_faces());
            // Paths and cells are given the new trees, and keep what they show until light of this pose is there.
            self.lights.indirect.take_if(|indirect| indirect.paths().is_none());
            self.surface_programs.reflected = None;
        }
        self.visibility.pose(&self.gpu, &self.scene, &self.resident);
        if let Some(indirect) = &mut self.lights.indirect {
            indirect.place(&self.scene, &self.resident.instances);
        }
        if let Some(direct) = &mut self.lights.direct {
            direct.pose(
                &self.gpu,
                &self.scene,
                self.visibility.prepare_packets(&self.resident),
                time_secs,
            )?;
        }
        if let Some(samples) = &mut self.samples {
            samples.forget_pose();
        }
        if let Some(probes) = &mut self.surface_programs.probes {
            probes.forget_pose();
        }
        if let Some(reflected) = &mut self.surface_programs.reflected {
            reflected.forget_pose();
        }
        self.lighting = exposed(pose.lighting, &self.settings);
        self.posed = moment;
        Ok(vec![Stage::new("pose", begin.elapsed().as_secs_f64() * 1e3)])
    }

    /// The scene with the transforms of a revision.
    fn moved_to(&self, revision: u64) -> Result<Arc<Scene>, RenderError> {
        self.scene.with_transforms(revision, &self.movers).ok_or_else(|| {
            let reason =
                format!("transforms of revision {revision} are not kept any more; ask for the present ones");
            InvalidField::new("state.revision", reason).into()
        })
    }

    /// Takes up the movers of the scene. Returns whether there are new ones, for which trees must be built anew.
    fn has_new_movers(&mut self) -> bool {
        let Some(moved) = &self.scene.by_request else { return false };
        let before = self.movers.len();
        self.movers.extend(&moved.movers);
        self.movers.len() > before
    }

    /// Prepares a visibility backend. Returns the rasteriser if the device does not support it.
    pub(super) fn available_backend(&mut self, backend: Visibility) -> Visibility {
        match self.visibility.prepare(&self.gpu, &self.resident, backend) {
            Ok(()) => backend,
            Err(reason) => {
                warn!(reason, "this device cannot see triangles by {}, they are rasterised", backend.name());
                Visibility::Raster
            }
        }
    }

    pub(super) fn eye(&self, position: DVec3, lighting: &Lighting) -> Result<Eye, RenderError> {
        Eye::new(&self.gpu, &self.resident, position, lighting)
    }

    pub(super) fn check_alive(&self) -> Result<(), RenderError> {
        self.gpu.lost().map_or(Ok(()), |reason| Err(GpuError::Lost(reason).into()))
    }
}

/// Lights and sky with the exposure that the sampler was made with.
pub(super) fn exposed(lighting: Lighting, settings: &SamplerSettings) -> Lighting {
    Lighting { exposure: settings.exposure.unwrap_or(lighting.exposure), ..lighting }
}
