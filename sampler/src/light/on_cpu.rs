//! Stages of light by rays of the CPU: it reads a frame's G-buffer, and what arrives is uploaded.

use std::time::{Duration, Instant};

use argus_gpu::wgpu;
use argus_scene::effects::SHARED_STAGE;
use argus_scene::{RenderError, Stage};
use bytes::Bytes;
use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::cells::{CellLight, Eye};
use super::path_light::PathLight;
use super::shading_points::ShadingPoints;
use super::shadows::VisibilityWords;
use super::sky;
use super::tracing::LightTracing;
use crate::LightSettings;
use crate::frame::{Footprint, Frame};
use crate::light_rays::LightRaysAbout;
use crate::lit_tile::Arriving;
use crate::ray_watch::RayWatch;
use crate::resident::upload;
use crate::timing;

/// What the CPU finds light by.
pub(super) struct RaysOnCpu<'a> {
    pub(super) tracing: &'a LightTracing,
    pub(super) paths: Option<&'a PathLight>,
    /// Texels of an image cast one of so many of their rays.
    pub(super) ray_divisor: u32,
    /// Whether surfaces are glossy, which ask for the lights that they see.
    pub(super) is_glossy: bool,
}

/// The light of a frame that the CPU finds, stage by stage.
pub(crate) struct OnCpu<'a> {
    tracing: &'a LightTracing,
    about: LightRaysAbout<'a>,
    eye: DVec3,
    points: ShadingPoints,
    settings: LightSettings,
    ray_divisor: u32,
    paths: Option<&'a PathLight>,
    uses_cells: bool,
    /// Whether these are points that a view's reflections show, or that maps show.
    reflected: bool,
    /// Angle of a pixel, radians.
    pixel: f32,
    /// Light of the sky and of other surfaces from cells. Then no rays are cast to either.
    cells: Option<Vec<CellLight>>,
    /// Irradiance / π of lights.
    lights: Option<Vec<Vec3>>,
    /// Which lights are seen: only gloss asks.
    words: Option<VisibilityWords>,
    /// The share of the sky that is seen.
    sky: Option<Vec<Vec3>>,
    /// Time of rays to the sky.
    sky_took: Duration,
    /// Irradiance / π of emitters, and of other surfaces.
    emitted: Option<Vec<Vec3>>,
    indirect: Option<Vec<Vec3>>,
    begin: Instant,
    traced: Vec<Stage>,
}

impl<'a> OnCpu<'a> {
    /// Finds where rays start, by the G-buffer that was read back: surfaces and materials.
    pub(super) fn new(by: RaysOnCpu<'a>, frame: &Frame<'_>, g_buffer: &[Bytes; 2]) -> Self {
        let begin = Instant::now();
        let RaysOnCpu { tracing, paths, ray_divisor, is_glossy } = by;
        let (tile_of, eye) = (&frame.context.tile, frame.context.eye.position);
        let watch = paths.and_then(PathLight::trail).map(|trail| trail as &dyn RayWatch);
        let about = tracing.rays.about(eye).watched(watch);
        let [surfaces, materials] = g_buffer;
        let mut points =
            ShadingPoints::new(surfaces, materials, tile_of.sub_samples(), frame.neighbours(), &about);
        points.stand_for(&frame.footprint);
        Self {
            words: is_glossy.then(|| VisibilityWords::new(&tracing.lighting, points.all.len())),
            tracing,
            about,
            eye,
            points,
            settings: tracing.settings.divided(ray_divisor),
            ray_divisor,
            paths,
            uses_cells: frame.uses_cells(),
            reflected: frame.footprint != Footprint::Pixels,
            pixel: tile_of.pixel_angle(),
            cells: None,
            lights: None,
            sky: None,
            sky_took: Duration::ZERO,
            emitted: None,
            indirect: None,
            begin,
            traced: Vec::new(),
        }
    }

    /// Looks up the light of the sky and of other surfaces in light cells.
    pub(crate) fn look_up_cells(&mut self) {
        let Some(paths) = self.paths.filter(|_| self.uses_cells) else { return };
        let begin = Instant::now();
        if self.tracing.may_use_cells() {
            let (about, pixel, reflected) = (&self.about, self.pixel, self.reflected);
            let eye = Eye { position: self.eye, about, pixel, reflected, trail: paths.trail() };
            self.cells = paths.look_up(self.tracing, &self.points, eye);
        }
        if paths.cells().is_some() {
            timing::add_since(&mut self.traced, "look up light cells", begin);
        }
    }

    /// Traces rays to lights.
    pub(crate) fn trace_lights(&mut self) {
        let Self { tracing, points, about, eye, traced, words, .. } = self;
        let add = |index: usize, lit: &[Vec3], shares: &[f32]| {
            if let Some(words) = words {
                words.add(index, lit, shares);
            }
        };
        self.lights = Some(tracing.of_lights(points, about, *eye, traced, add));
    }

    /// Traces rays to the sky.
    pub(crate) fn trace_sky(&mut self) {
        let (tracing, begin) = (self.tracing, Instant::now());
        if self.cells.is_none() && tracing.effects.sky_visibility && !tracing.sky.is_black() {
            let seen = sky::seen_share(&tracing.lighting.sky, &self.points, &self.about, self.settings);
            self.sky = Some(seen);
            self.sky_took = begin.elapsed();
            timing::add_since(&mut self.traced, "trace sky", begin);
        }
    }

    /// Traces rays to emitting triangles.
    pub(crate) fn trace_emitters(&mut self) {
        let begin = Instant::now();
        let emitters = &self.tracing.emitters;
        self.emitted = emitters.irradiance_over_pi(&self.points, &self.about, self.eye, self.settings);
        if self.emitted.is_some() {
            timing::add_since(&mut self.traced, "trace emitters", begin);
        }
    }

    /// Gathers the light of other surfaces by rays, unless it was looked up in cells.
    pub(crate) fn gather_paths(&mut self) {
        let Some(paths) = self.paths.filter(|_| self.cells.is_none()) else { return };
        let begin = Instant::now();
        self.indirect = paths.irradiance_over_pi(&self.points, &self.about, self.eye, self.ray_divisor);
        if self.indirect.is_some() {
            timing::add_since(&mut self.traced, "gather paths", begin);
        }
        if !self.reflected && (self.sky.is_some() || self.indirect.is_some()) {
            paths.took_rays(&self.points, self.ray_divisor, self.sky_took + begin.elapsed());
        }
    }

    /// Uploads the sum of all, [`Arriving`] of each texel. Adds a stage for each effect that cast rays, and one for what no effect alone accounts for.
    ///
    /// # Errors
    /// [`RenderError::OutOfMemory`] if the device cannot bind it.
    pub(crate) fn upload(self, frame: &mut Frame<'_>) -> Result<wgpu::Buffer, RenderError> {
        let sums: Vec<Arriving> =
            (0..self.points.all.len()).into_par_iter().map(|index| self.sum(index)).collect();
        timing::add_with_rest(frame.stages, SHARED_STAGE, self.begin, self.traced);
        upload(frame.context.gpu, "arriving light", &sums, wgpu::BufferUsages::STORAGE)
    }

    /// The light that arrives at a texel; where surfaces are glossy, also which lights it sees.
    fn sum(&self, index: usize) -> Arriving {
        let point = &self.points.all[index];
        let of = |light: &Option<Vec<Vec3>>| light.as_ref().map_or(Vec3::ZERO, |light| light[index]);
        let gathered = of(&self.indirect);
        if !point.exists {
            return [gathered.x, gathered.y, gathered.z, 0.0];
        }
        let cell = self.cells.as_ref().map(|cells| cells[index]);
        let seen = match (cell, &self.sky) {
            (Some(cell), _) => cell.sky,
            (None, Some(sky)) => sky[index],
            (None, None) => Vec3::ONE,
        };
        // Without rays to the sky, the sky is what shading says: see `shading::sky_ambient`.
        let open = match cell.is_some() || self.sky.is_some() {
            true => self.tracing.sky.irradiance_over_pi(point.normal),
            false => argus_scene::shading::sky_ambient(&self.tracing.lighting.sky, point.normal),
        };
        let indirect = cell.map_or(Vec3::ZERO, |cell| cell.indirect);
        let sum = of(&self.lights) + open * seen + of(&self.emitted) + indirect + gathered;
        let word = self.words.as_ref().map_or(u32::MAX, |words| words.word(index, seen.element_sum() / 3.0));
        [sum.x, sum.y, sum.z, f32::from_bits(word)]
    }
}
