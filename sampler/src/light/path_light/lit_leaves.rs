//! The leaf sides of one level, and the light on them.

use std::time::Instant;

use argus_scene::{Bounds, Lighting, PathSettings, RenderError, Stage};
use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::super::cells::BoxTree;
use super::super::paths::{Gatherer, Leaves, Links};
use super::super::shading_points::{Effort, ShadingPoint, ShadingPoints};
use super::super::tracing::LightTracing;
use crate::light_rays::LightRaysAbout;
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
    leaves: Leaves,
    links: Links,
    /// Finds the triangles of light cells, if they are filled from here.
    tree: Option<BoxTree>,
}

/// What depends on lights, too.
struct Lit {
    lighting: Lighting,
    /// Radiance that each leaf side reflects.
    radiance: Vec<Vec3>,
}

impl LitLeaves {
    /// Leaf sides that are not built yet.
    pub(super) fn new(settings: PathSettings, fills_cells: bool) -> Self {
        Self { settings, fills_cells, posed: None, lit: None, report: PathReport::default() }
    }

    /// Changes the settings. Marks what depends on them as out of date.
    pub(super) fn set_settings(&mut self, settings: PathSettings) {
        if (settings.level, settings.rays) != (self.settings.level, self.settings.rays) {
            self.posed = None;
        }
        if self.posed.is_none() || settings.bounces != self.settings.bounces {
            self.lit = None;
        }
        self.settings = settings;
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
            let tree = self.fills_cells.then(|| BoxTree::new(leaves.triangles()));
            self.report.build_ms = stage(&mut stages, "light leaves: build", begin);
            let begin = Instant::now();
            let about = tracing.rays.about(leaves.center());
            let links = Links::trace(&leaves, surfaces, &about, rays);
            self.report.links_ms = stage(&mut stages, "light leaves: links", begin);
            self.posed = Some(Posed { leaves, links, tree });
        }
        if let (Some(posed), false) = (&self.posed, self.is_lit(&tracing.lighting)) {
            let begin = Instant::now();
            let about = tracing.rays.about(posed.leaves.center());
            let arriving = posed.direct_by_pi(surfaces, tracing, &about, rays);
            self.report.direct_ms = stage(&mut stages, "light leaves: direct", begin);
            let begin = Instant::now();
            let all = posed.links.bounce(&posed.leaves, &arriving, self.settings.bounces - 1);
            let radiance = posed.leaves.reflected(&posed.leaves.smoothed(&all));
            self.report.gather_ms = stage(&mut stages, "light leaves: gather", begin);
            self.lit = Some(Lit { lighting: tracing.lighting.clone(), radiance });
        }
        Ok(stages)
    }

    /// What light cells are filled from, once it is lit for them: leaf sides, triangles by place, and what leaf sides reflect.
    pub(super) fn for_cells(&self) -> Option<(&Leaves, &BoxTree, &Lighting, &[Vec3])> {
        let (Posed { leaves, tree, .. }, Lit { lighting, radiance }) =
            (self.posed.as_ref()?, self.lit.as_ref()?);
        Some((leaves, tree.as_ref()?, lighting, radiance))
    }

    /// Whether light cells are filled from them.
    pub(super) fn fills_cells(&self) -> bool {
        self.fills_cells
    }

    /// Indirect irradiance / π at texels about an eye, each by one of `divisor` of its rays; `None` before the leaf sides are
    /// lit.
    pub(super) fn irradiance_over_pi(
        &self,
        texels: &ShadingPoints,
        about: &LightRaysAbout<'_>,
        eye: DVec3,
        divisor: u32,
    ) -> Option<Vec<Vec3>> {
        let (Posed { leaves, .. }, Lit { radiance, .. }) = (self.posed.as_ref()?, self.lit.as_ref()?);
        let from_eye = (eye - leaves.center()).as_vec3();
        let gatherer = Gatherer { leaves, radiance, about, from_eye };
        Some(gatherer.irradiance_over_pi(texels, self.settings.gather.div_ceil(divisor.max(1)) as usize))
    }
}

impl Posed {
    /// Direct irradiance / π of each leaf side: that of the points where its rays start, and the sky that its rays reach.
    fn direct_by_pi(
        &self,
        surfaces: &Surfaces,
        tracing: &LightTracing,
        about: &LightRaysAbout<'_>,
        rays: usize,
    ) -> Vec<Vec3> {
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
            let texels =
                ShadingPoints { size: [rays, batch.len()], first: None, effort: Effort::Shared, all, bounds };
            let irradiance_over_pi = tracing.lights_by_pi(&texels, about, center);
            let side = |at: usize| {
                let side = batch.start + at;
                let lights: Vec3 = irradiance_over_pi[at * rays..(at + 1) * rays].iter().sum();
                let texels = &texels.all[at * rays..(at + 1) * rays];
                (lights + self.links.sky(side, texels, &tracing.lighting.sky)) / rays as f32
            };
            found.extend((0..batch.len()).into_par_iter().map(side).collect::<Vec<Vec3>>());
        }
        found
    }
}

impl LightTracing {
    /// Irradiance / π of lights and emitters at texels without neighbours.
    fn lights_by_pi(&self, texels: &ShadingPoints, about: &LightRaysAbout<'_>, eye: DVec3) -> Vec<Vec3> {
        let mut irradiance_over_pi = self.of_lights(texels, about, eye, &mut Vec::new(), |_, _, _| {});
        if let Some(emitted) = self.emitters.irradiance_over_pi(texels, about, eye, self.settings) {
            irradiance_over_pi.par_iter_mut().zip(&emitted).for_each(|(sum, emitted)| *sum += *emitted);
        }
        irradiance_over_pi
    }
}

/// Adds the time since `begin` to a table, and returns it in milliseconds.
fn stage(stages: &mut Vec<Stage>, name: &str, begin: Instant) -> f64 {
    let ms = begin.elapsed().as_secs_f64() * 1e3;
    timing::add(stages, vec![Stage::new(name, ms)]);
    ms
}
