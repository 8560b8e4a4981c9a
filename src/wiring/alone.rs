//! Renders views in this process, without a service: from triangles, as a worker of a service would.

use std::sync::Arc;
use std::time::Instant;

use anyhow::Context as _;
use argus_cluster::coordinator::{Config, Prepared, prepare};
use argus_cluster::{RoleFactory as _, SceneSource as _};
use argus_scene::{
    Cancel, Frame, LightLevel, Limits, Plan, Sampler, Scene, SceneState, Stage, SurfaceLight, View, ViewJob,
    derived,
};

use super::{Device, OpenScene};
use crate::settings::Settings;

/// A scene and a sampler of it.
pub struct Alone {
    scene: Arc<Scene>,
    /// The light and why it was chosen.
    pub light: String,
    prepared: Prepared,
    limits: Limits,
    sampler: Box<dyn Sampler>,
    /// Milliseconds of each part of the start.
    pub start: Vec<Stage>,
}

impl Alone {
    /// The configuration of a service that is given no setting.
    pub fn usual_config() -> Config {
        let settings = Settings::default();
        settings.coordinator.config(&settings.limits)
    }

    /// Opens a scene, and prepares it as a service of this configuration does.
    ///
    /// # Errors
    /// A scene that cannot be opened, a configuration that does not go with it, or a machine that cannot render.
    pub fn open(spec: &str, config: &Config) -> anyhow::Result<Self> {
        let mut start = Vec::new();
        let mut began = Instant::now();
        let mut lap = |name: &str| {
            start.push(Stage::new(name, began.elapsed().as_secs_f64() * 1e3));
            began = Instant::now();
        };
        let device = Device::new(0);
        // The device is opened while the scene is read.
        let source = std::thread::scope(|scope| {
            scope.spawn(|| device.open());
            OpenScene::open(spec, config.light, config.effects.metering(config.indirect))
        })?;
        source.report();
        lap("open scene");
        let prepared = prepare(config, &source)?;
        lap("prepare light");
        let scene = source.scene().clone();
        let sampler = device.sampler(scene.clone(), &prepared.set)?;
        lap("make sampler");
        let light = source.light().to_owned();
        Ok(Self { scene, light, prepared, limits: config.core.limits, sampler, start })
    }

    /// The scene.
    pub fn scene(&self) -> &Arc<Scene> {
        &self.scene
    }

    /// The sample set, whose light and exposure views have.
    pub fn prepared(&self) -> &Prepared {
        &self.prepared
    }

    /// The light of views of a service once all of it is ready.
    pub fn full_light(&self) -> LightLevel {
        self.prepared.set.last_light()
    }

    /// Renders a view in that light, of the epoch nearest to a scene time in seconds. Of the plan, its supersampling
    /// and its detail matter.
    ///
    /// # Errors
    /// An invalid view, a time in a scene where nothing moves, or the error of rendering.
    pub fn render(&mut self, view: &View, light: LightLevel, time_secs: f64) -> anyhow::Result<Frame> {
        view.validate(&self.limits)?;
        let set = &self.prepared.set;
        let epoch = epoch_of(time_secs, set.epoch_secs)?;
        let side = view.plan.supersampling.unwrap_or(1);
        let job = ViewJob {
            camera: view.camera,
            width: view.width,
            height: view.height,
            outputs: derived::rendered(view.outputs),
            plan: Plan::Direct {
                samples_per_pixel: side * side,
                detail: view.plan.detail.unwrap_or_default(),
                // One view gains nothing by cells, and which of them a process fills in time differs from run to run.
                light: Some(SurfaceLight::Rays),
            },
            state: SceneState { epoch, light, revision: 0 },
            time_secs: epoch as f64 * set.epoch_secs,
            visibility: self.sampler.usual_visibility(),
            reflections: set.reflections,
            band_rows: 0,
            history: None,
            rays: view.rays.clone(),
        };
        let frames = self.sampler.render_views(std::slice::from_ref(&job), &Cancel::new());
        let mut frame = frames.into_iter().next().context("the sampler rendered no view")??;
        let camera = (&view.camera, view.rays.as_ref());
        derived::complete(&mut frame, view.outputs, camera, view.flow_to.as_ref());
        frame.images.keep_only(view.outputs);
        Ok(frame)
    }
}

/// The epoch that is nearest to a scene time.
///
/// # Errors
/// A time other than 0 in a scene where nothing moves.
pub(crate) fn epoch_of(time_secs: f64, epoch_secs: f64) -> anyhow::Result<u64> {
    anyhow::ensure!(
        epoch_secs > 0.0 || time_secs == 0.0,
        "nothing moves in this scene, so its only time is 0"
    );
    Ok(if epoch_secs > 0.0 { (time_secs / epoch_secs).round() as u64 } else { 0 })
}
