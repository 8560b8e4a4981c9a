//! The leaf sides of one level, and the light on them.

use std::sync::{Arc, OnceLock};
use std::time::Instant;

use argus_gpu::Gpu;
use argus_scene::{Bounds, Lighting, PathSettings, RenderError, Stage};
use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::super::cells::{BoxTree, CellInputs};
use super::super::paths::{Gatherer, Leaves, Links, Side};
use super::super::pose::Pose;
use super::super::shading_points::{Effort, ShadingPoint, ShadingPoints};
use super::super::tracing::LightTracing;
use crate::light_rays::LightRaysAbout;
use crate::lit_leaves::DeviceLeaves;
use crate::surfaces::Surfaces;
use crate::timing;

/// Leaf sides whose direct light is traced together.
const BATCH: usize = 1 << 14;
/// Most rays of all leaf sides: 1 GiB of links.
const MOST_RAYS: u64 = 1 << 28;

/// Report on a scene's light by paths.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PathReport {
    /// Number of leaf sides.
    pub sides: usize,
    /// Milliseconds of building them. Rebuilt only if the scene moves.
    pub build_ms: f64,
    /// Milliseconds of tracing their links. Traced again only if the scene moves.
    pub links_ms: f64,
    /// Milliseconds of their direct light.
    pub direct_ms: f64,
    /// Milliseconds of the bounces.
    pub gather_ms: f64,
}

/// The light of leaf sides of one level. Surfaces and what traces light are handed in, since another thread may light them.
pub(super) struct LitLeaves {
    settings: PathSettings,
    /// Whether light cells are filled from them.
    fills_cells: bool,
    posed: Option<Posed>,
    lit: Option<Lit>,
    report: PathReport,
}

/// What depends on the pose.
struct Posed {
    leaves: Arc<Leaves>,
    /// `None` if surfaces light nothing.
    links: Option<Links>,
    /// Finds the triangles of light cells, if they are filled from here.
    tree: Option<Arc<BoxTree>>,
    /// Where instances are, if light cells are filled from here and things move.
    pose: Option<Arc<Pose>>,
}

/// What depends on lights, too.
struct Lit {
    lighting: Lighting,
    /// Radiance that each leaf side reflects; empty if surfaces light nothing.
    radiance: Arc<[Vec3]>,
    /// The leaves on a device, once it gathers from them.
    on_device: OnceLock<Arc<DeviceLeaves>>,
}

impl LitLeaves {
    /// Leaf sides that are not built yet.
    pub(super) fn new(settings: PathSettings, fills_cells: bool) -> Self {
        Self { settings, fills_cells, posed: None, lit: None, report: PathReport::default() }
    }

    /// Changes the settings. Marks what depends on them as out of date.
    pub(super) fn set_settings(&mut self, settings: PathSettings) {
        let of_links = |settings: PathSettings| (settings.level, settings.rays, settings.bounces == 0);
        if of_links(settings) != of_links(self.settings) {
            self.posed = None;
        }
        if self.posed.is_none() || settings.bounces != self.settings.bounces {
            self.lit = None;
        }
        self.settings = settings;
    }

    /// Takes out what is lit, as if it was never built.
    pub(super) fn take(&mut self) -> Self {
        let unlit = Self::new(self.settings, self.fills_cells);
        std::mem::replace(self, unlit)
    }

    /// Forgets leaf sides and links: instances moved.
    pub(super) fn forget_pose(&mut self) {
        (self.posed, self.lit) = (None, None);
    }

    /// The settings.
    pub(super) fn settings(&self) -> PathSettings {
        self.settings
    }

    /// The report, once they are lit.
    pub(super) fn report(&self) -> Option<PathReport> {
        self.lit.as_ref().map(|_| self.report.clone())
    }

    /// Whether they are lit by these lights.
    pub(super) fn is_lit(&self, lighting: &Lighting) -> bool {
        self.lit.as_ref().is_some_and(|lit| lit.lighting == *lighting)
    }

    /// Lights the leaf sides, unless they are up to date for these lights. Returns the cost.
    ///
    /// # Errors
    /// [`RenderError::OutOfMemory`] for too many rays.
    pub(super) fn ready(
        &mut self,
        surfaces: &Surfaces,
        tracing: &LightTracing,
    ) -> Result<Vec<Stage>, RenderError> {
        let mut stages = Vec::new();
        if self.settings.bounces == 0 && !self.fills_cells {
            // Nobody asks for them.
            self.lit = Some(Lit::by(&tracing.lighting, Vec::new()));
            return Ok(stages);
        }
        let rays = self.settings.rays as usize;
        if self.posed.is_none() {
            self.lit = None;
            let begin = Instant::now();
            let leaves = Leaves::new(surfaces, self.settings.level, rays);
            let count = leaves.sides.len() as u64 * u64::from(self.settings.rays);
            if count > MOST_RAYS {
                let message =
                    format!("leaf sides cast {count} rays, at most {MOST_RAYS}: a lower level has fewer");
                return Err(RenderError::OutOfMemory(message));
            }
            self.report.sides = leaves.sides.len();
            let tree =
                self.fills_cells.then(|| Arc::new(BoxTree::new(leaves.triangles(), &leaves.lattice())));
            let moves = self.fills_cells && surfaces.scene().may_move();
            let pose = moves.then(|| Arc::new(Pose::new(surfaces, &leaves)));
            self.report.build_ms = stage(&mut stages, "light leaves: build", begin);
            let begin = Instant::now();
            let about = tracing.rays.about(leaves.center());
            let links = (self.settings.bounces > 0).then(|| Links::trace(&leaves, surfaces, &about, rays));
            self.report.links_ms = stage(&mut stages, "light leaves: links", begin);
            self.posed = Some(Posed { leaves: Arc::new(leaves), links, tree, pose });
        }
        if let (Some(posed), false) = (&self.posed, self.is_lit(&tracing.lighting)) {
            let begin = Instant::now();
            let mut radiance = Vec::new();
            if let Some(links) = &posed.links {
                let about = tracing.rays.about(posed.leaves.center());
                let arriving = posed.direct_by_pi(surfaces, tracing, links, &about);
                self.report.direct_ms = stage(&mut stages, "light leaves: direct", begin);
                let begin = Instant::now();
                let all = links.bounce(&posed.leaves, &arriving, self.settings.bounces - 1);
                radiance = posed.leaves.reflected(&posed.leaves.smoothed(&all));
                self.report.gather_ms = stage(&mut stages, "light leaves: gather", begin);
            }
            self.lit = Some(Lit::by(&tracing.lighting, radiance));
        }
        Ok(stages)
    }

    /// What light cells are filled from, once it is lit for them.
    pub(super) fn for_cells(&self) -> Option<CellInputs> {
        let (Posed { leaves, tree, pose, .. }, Lit { lighting, radiance, .. }) =
            (self.posed.as_ref()?, self.lit.as_ref()?);
        Some(CellInputs {
            leaves: leaves.clone(),
            tree: tree.clone()?,
            pose: pose.clone(),
            lighting: lighting.clone(),
            radiance: radiance.clone(),
        })
    }

    /// The leaves on a device; `None` before they are lit.
    ///
    /// # Errors
    /// [`RenderError::OutOfMemory`] if they are larger than the device can bind.
    pub(super) fn on_device(&self, gpu: &Arc<Gpu>) -> Result<Option<Arc<DeviceLeaves>>, RenderError> {
        let (Some(Posed { leaves, .. }), Some(lit)) = (&self.posed, &self.lit) else { return Ok(None) };
        if let Some(held) = lit.on_device.get() {
            return Ok(Some(Arc::clone(held)));
        }
        let made = Arc::new(DeviceLeaves::new(gpu, &leaves.packed(&lit.radiance))?);
        Ok(Some(Arc::clone(lit.on_device.get_or_init(|| made))))
    }

    /// Rays of a gathering texel, with one of `divisor` of them.
    pub(super) fn gather_rays(&self, divisor: u32) -> u32 {
        if self.settings.bounces == 0 { 0 } else { self.settings.gather.div_ceil(divisor.max(1)) }
    }

    /// Whether light cells are filled from them.
    pub(super) fn fills_cells(&self) -> bool {
        self.fills_cells
    }

    /// Indirect irradiance / π at texels about an eye, each by one of `divisor` of its rays; `None` before the leaf sides are
    /// lit, or if they light nothing.
    pub(super) fn irradiance_over_pi(
        &self,
        texels: &ShadingPoints,
        about: &LightRaysAbout<'_>,
        eye: DVec3,
        divisor: u32,
    ) -> Option<Vec<Vec3>> {
        let (Posed { leaves, links, .. }, Lit { radiance, .. }) = (self.posed.as_ref()?, self.lit.as_ref()?);
        links.as_ref()?;
        let from_eye = (eye - leaves.center()).as_vec3();
        let gatherer = Gatherer { leaves, radiance, about, from_eye };
        Some(gatherer.irradiance_over_pi(texels, self.gather_rays(divisor) as usize))
    }
}

impl Lit {
    fn by(lighting: &Lighting, radiance: Vec<Vec3>) -> Self {
        Self { lighting: lighting.clone(), radiance: radiance.into(), on_device: OnceLock::new() }
    }
}

impl Posed {
    /// Direct irradiance / π of each leaf side: that of the points where its rays start, and the sky that its rays reach.
    fn direct_by_pi(
        &self,
        surfaces: &Surfaces,
        tracing: &LightTracing,
        links: &Links,
        about: &LightRaysAbout<'_>,
    ) -> Vec<Vec3> {
        let rays = links.rays();
        let center = self.leaves.center();
        let mut found = Vec::with_capacity(self.leaves.sides.len());
        for first in (0..self.leaves.sides.len()).step_by(BATCH) {
            let batch = first..(first + BATCH).min(self.leaves.sides.len());
            let points = batch.start * rays..batch.end * rays;
            let all: Vec<ShadingPoint> =
                points.into_par_iter().map(|point| self.leaves.texel(surfaces, about, point)).collect();
            let mut bounds = Bounds::EMPTY;
            all.iter()
                .filter(|texel| texel.exists)
                .for_each(|texel| bounds.extend(texel.position.as_dvec3()));
            let texels = ShadingPoints {
                size: [rays, batch.len()],
                first: None,
                effort: Effort::Shared,
                numbers: self.leaves.sides[batch.clone()].iter().map(Side::number).collect(),
                all,
                bounds,
            };
            let lights = tracing.lights_by_pi(&texels, about, center, self.leaves.width());
            let side = |at: usize| {
                let side = batch.start + at;
                let texels = &texels.all[at * rays..(at + 1) * rays];
                lights[at] + links.sky(&self.leaves, side, texels, &tracing.lighting.sky) / rays as f32
            };
            found.extend((0..batch.len()).into_par_iter().map(side).collect::<Vec<Vec3>>());
        }
        found
    }
}

impl LightTracing {
    /// Irradiance / π of lights and emitters at leaf sides `width` metres wide: means over the points of each.
    fn lights_by_pi(
        &self,
        points: &ShadingPoints,
        about: &LightRaysAbout<'_>,
        eye: DVec3,
        width: f32,
    ) -> Vec<Vec3> {
        let [per_side, _] = points.size;
        let mean = |values: &[Vec3]| values.iter().sum::<Vec3>() / per_side as f32;
        let all = self.of_lights(points, about, eye, &mut Vec::new(), |_, _, _| {});
        let mut sides: Vec<Vec3> = all.par_chunks(per_side.max(1)).map(mean).collect();
        // What an emitter covers from less than a side's width is not seen from elsewhere, but as a part of the side's mean it would
        // shine past the emitter. What lies beside it counts: a lamp close to a ceiling has a bright rim there.
        if let Some(emitted) = self.emitters.at_points(points, about, eye, self.settings, width) {
            let mean_of_seen = |values: &[Option<Vec3>]| {
                let seen = values.iter().flatten();
                seen.clone().sum::<Vec3>() / seen.count().max(1) as f32
            };
            let emitted = emitted.par_chunks(per_side.max(1)).map(mean_of_seen);
            sides.par_iter_mut().zip(emitted).for_each(|(sum, emitted)| *sum += emitted);
        }
        sides
    }
}

/// Adds the time since `begin` to a table, and returns it in milliseconds.
fn stage(stages: &mut Vec<Stage>, name: &str, begin: Instant) -> f64 {
    let ms = begin.elapsed().as_secs_f64() * 1e3;
    timing::add(stages, vec![Stage::new(name, ms)]);
    ms
}
