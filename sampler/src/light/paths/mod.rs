//! Indirect light by paths between *leaf sides*: the surfaces in a cell of a grid over the scene, as seen from one side.
//!
//! A ray of a leaf side is traced once a pose, and kept as a *link* to the leaf side that it hits. Bounces of light are
//! sums over links, so that new lights and further bounces trace no such ray. Visible surfaces then gather once more, by
//! rays of their own: as final gathering from a photon map does (Jensen, "Global Illumination using Photon Maps", 1996).
//!
//! # Steps
//!
//! 1. [`leaves`], once a pose: the triangles are clipped to cells and divided into leaf sides.
//! 2. [`links`], once a pose: each leaf side casts its rays.
//! 3. Once a lighting: direct light at the points where these rays start, as texels have it; then the bounces, and a mean
//!    over alike neighbours.
//! 4. [`gather`], once a tile: a quarter of the texels cast rays, and surfaces share what they found.
//!
//! A ray that gathers adds what the leaf side at its hit reflects. It adds neither emission nor sky, which are direct light
//! ([`argus_scene::Indirect::effects_with`]); what leaf sides reflect includes both.
//!
//! # What leaks
//!
//! The two faces of a wall are different leaf sides, however thin it is. But a leaf side is lit evenly: where a wall stands
//! on a floor, the floor in the cells under it mixes the light of both rooms, and the mean over neighbours takes it a cell
//! further. Two faces that look the same way in one cell, as shelves above one another, are one leaf side.

mod cells;
mod gather;
mod leaves;
mod links;
mod polygon;

use std::sync::Arc;
use std::time::Instant;

use argus_scene::{Bounds, Lighting, PathKnobs, RenderError, Scene, Stage};
use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::DirectLight;
use super::texels::{Effort, Texel, Texels};
use crate::light_rays::LightRaysAbout;
use crate::radiosity::surfaces::Surfaces;
use crate::resident::Placement;
use crate::timing;
use leaves::Leaves;
use links::Links;

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

/// The light of leaf sides of one scene.
pub(crate) struct PathLight {
    knobs: PathKnobs,
    surfaces: Surfaces,
    posed: Option<Posed>,
    lit: Option<Lit>,
    report: PathReport,
}

/// What depends on the pose.
struct Posed {
    leaves: Leaves,
    links: Links,
}

/// What depends on lights, too.
struct Lit {
    lighting: Lighting,
    /// Radiance that each leaf side reflects.
    radiance: Vec<Vec3>,
}

impl PathLight {
    /// The light of a scene with these instances.
    pub(crate) fn new(scene: &Arc<Scene>, placements: &[Placement], knobs: PathKnobs) -> Self {
        let surfaces = Surfaces::new(scene, placements);
        Self { knobs, surfaces, posed: None, lit: None, report: PathReport::default() }
    }

    /// Changes the knobs. Marks what depends on them as out of date.
    pub(crate) fn set_knobs(&mut self, knobs: PathKnobs) {
        if (knobs.level, knobs.rays) != (self.knobs.level, self.knobs.rays) {
            self.posed = None;
        }
        if self.posed.is_none() || knobs.bounces != self.knobs.bounces {
            self.lit = None;
        }
        self.knobs = knobs;
    }

    /// Moves instances. Marks all as out of date.
    pub(crate) fn place(&mut self, placements: &[Placement]) {
        self.surfaces.place(placements);
        self.posed = None;
        self.lit = None;
    }

    /// The report, once the scene is lit.
    pub(crate) fn report(&self) -> Option<PathReport> {
        self.lit.as_ref().map(|_| self.report.clone())
    }

    /// Lights the leaf sides, unless they are up to date for this pose and these lights. Returns the cost.
    ///
    /// # Errors
    /// [`RenderError::OutOfMemory`] for too many rays.
    pub(crate) fn ready(
        &mut self,
        direct: &DirectLight,
        lighting: &Lighting,
    ) -> Result<Vec<Stage>, RenderError> {
        let mut stages = Vec::new();
        let rays = self.knobs.rays as usize;
        if self.posed.is_none() {
            self.lit = None;
            let begin = Instant::now();
            let leaves = Leaves::new(&self.surfaces, self.knobs.level, rays);
            let count = leaves.sides.len() as u64 * u64::from(self.knobs.rays);
            if count > MOST_RAYS {
                let message =
                    format!("leaf sides cast {count} rays, at most {MOST_RAYS}: a lower level has fewer");
                return Err(RenderError::OutOfMemory(message));
            }
            self.report.sides = leaves.sides.len();
            self.report.build_ms = stage(&mut stages, "light leaves: build", begin);
            let begin = Instant::now();
            let about = direct.rays.about(leaves.center());
            let links = Links::trace(&leaves, &self.surfaces, &about, rays);
            self.report.links_ms = stage(&mut stages, "light leaves: links", begin);
            self.posed = Some(Posed { leaves, links });
        }
        let is_now = self.lit.as_ref().is_some_and(|lit| lit.lighting == *lighting);
        if let (Some(posed), false) = (&self.posed, is_now) {
            let begin = Instant::now();
            let about = direct.rays.about(posed.leaves.center());
            let arriving = posed.direct_by_pi(&self.surfaces, direct, &about, rays);
            self.report.direct_ms = stage(&mut stages, "light leaves: direct", begin);
            let begin = Instant::now();
            let all = posed.links.bounce(&posed.leaves, &arriving, self.knobs.bounces - 1);
            let radiance = posed.leaves.reflected(&posed.leaves.smoothed(&all));
            self.report.gather_ms = stage(&mut stages, "light leaves: gather", begin);
            self.lit = Some(Lit { lighting: lighting.clone(), radiance });
        }
        Ok(stages)
    }

    /// Indirect irradiance / π at texels about an eye; `None` before the leaf sides are lit.
    pub(super) fn by_pi(&self, texels: &Texels, about: &LightRaysAbout<'_>, eye: DVec3) -> Option<Vec<Vec3>> {
        let (Posed { leaves, .. }, Lit { radiance, .. }) = (self.posed.as_ref()?, self.lit.as_ref()?);
        let from_eye = (eye - leaves.center()).as_vec3();
        let gatherer = gather::Gatherer { leaves, radiance, about, from_eye };
        Some(gatherer.by_pi(texels, self.knobs.gather as usize))
    }
}

impl Posed {
    /// Direct irradiance / π of each leaf side: that of the points where its rays start, and the sky that its rays reach.
    fn direct_by_pi(
        &self,
        surfaces: &Surfaces,
        direct: &DirectLight,
        about: &LightRaysAbout<'_>,
        rays: usize,
    ) -> Vec<Vec3> {
        let center = self.leaves.center();
        let mut found = Vec::with_capacity(self.leaves.sides.len());
        for first in (0..self.leaves.sides.len()).step_by(BATCH) {
            let batch = first..(first + BATCH).min(self.leaves.sides.len());
            let points = batch.start * rays..batch.end * rays;
            let all: Vec<Texel> =
                points.into_par_iter().map(|point| self.leaves.texel(surfaces, about, point)).collect();
            let mut bounds = Bounds::EMPTY;
            all.iter()
                .filter(|texel| texel.exists)
                .for_each(|texel| bounds.extend(texel.position.as_dvec3()));
            let texels =
                Texels { size: [rays, batch.len()], first: None, effort: Effort::Shared, all, bounds };
            let by_pi = direct.lights_by_pi(&texels, about, center);
            let side = |at: usize| {
                let side = batch.start + at;
                let lights: Vec3 = by_pi[at * rays..(at + 1) * rays].iter().sum();
                let texels = &texels.all[at * rays..(at + 1) * rays];
                (lights + self.links.sky(side, texels, &direct.lighting.sky)) / rays as f32
            };
            found.extend((0..batch.len()).into_par_iter().map(side).collect::<Vec<Vec3>>());
        }
        found
    }
}

impl DirectLight {
    /// Irradiance / π of lights and emitters at texels without neighbours.
    fn lights_by_pi(&self, texels: &Texels, about: &LightRaysAbout<'_>, eye: DVec3) -> Vec<Vec3> {
        let mut by_pi = self.of_lights(texels, about, eye, &mut Vec::new(), |_, _, _| {});
        if let Some(emitted) = self.emitters.irradiance_by_pi(texels, about, eye, self.knobs) {
            by_pi.par_iter_mut().zip(&emitted).for_each(|(sum, emitted)| *sum += *emitted);
        }
        by_pi
    }
}

/// Adds the time since `begin` to a table, and returns it in milliseconds.
fn stage(stages: &mut Vec<Stage>, name: &str, begin: Instant) -> f64 {
    let ms = begin.elapsed().as_secs_f64() * 1e3;
    timing::add(stages, vec![Stage::new(name, ms)]);
    ms
}
