//! Indirect light of a scene at its levels: by paths between leaf sides, or by light cells that gather it.

mod lit_leaves;
mod preparation;

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use argus_gpu::Gpu;
use argus_scene::{
    CellPages, CellReport, CellSettings, FaceMask, LightLevel, PathSettings, RenderError, Scene, SceneState,
    Stage, SurfaceLight,
};
use glam::{DVec3, Vec3};

#[cfg(test)]
use super::cells::CellInputs;
use super::cells::{Asking, CellLight, CellUse, DeviceLookup, Eye, LightCells, Parts, SampleOf, Trail};
use super::shading_points::ShadingPoints;
use super::tracing::LightTracing;
use crate::light_rays::LightRaysAbout;
use crate::lit_cells::CellOutcome;
use crate::lit_leaves::DeviceLeaves;
use crate::resident::Placement;
use crate::surfaces::Surfaces;
use lit_leaves::LitLeaves;
use preparation::Preparation;

pub use lit_leaves::PathReport;

/// Indirect light of one scene, at its levels.
pub(crate) struct PathLight {
    surfaces: Arc<Surfaces>,
    coarse: LitLeaves,
    full: LitLeaves,
    /// The full level of an earlier pose, which open views show while that of the present one is prepared.
    earlier: Option<LitLeaves>,
    /// Whether the present job shows it.
    lags: bool,
    /// Cells that gather the light of the full level, if views look it up.
    cells: Option<LightCells>,
    /// The level of the present job.
    light: LightLevel,
    /// The level that is being prepared.
    preparation: Option<Preparation>,
    /// A lookup whose outcome is read with the finished image.
    awaited: Mutex<Option<DeviceLookup>>,
    /// Where it is written down what the light of a face is found by.
    trail: Option<Trail>,
}

impl PathLight {
    /// The light of a scene with these instances.
    pub(crate) fn new(
        scene: &Arc<Scene>,
        placements: &[Placement],
        settings: PathSettings,
        cells: Option<CellSettings>,
    ) -> Self {
        let fills = |light| cells.is_some() && light == LightLevel::Full;
        let at = |light| LitLeaves::new(settings.at(light).unwrap_or(settings), fills(light));
        Self {
            surfaces: Arc::new(Surfaces::new(scene, placements)),
            coarse: at(LightLevel::Coarse),
            full: at(LightLevel::Full),
            earlier: None,
            lags: false,
            cells: cells.map(LightCells::new),
            light: LightLevel::default(),
            preparation: None,
            awaited: Mutex::default(),
            trail: None,
        }
    }

    /// Changes the settings. Marks what depends on them as out of date.
    pub(crate) fn set_settings(&mut self, settings: PathSettings) {
        (self.preparation, self.earlier) = (None, None);
        self.forget_cells();
        self.coarse.set_settings(settings.at(LightLevel::Coarse).unwrap_or(settings));
        self.full.set_settings(settings);
    }

    /// Moves instances of a posed scene. Marks all as out of date, but for cells: they compare what they are of with what is lit next.
    pub(crate) fn place(&mut self, scene: &Arc<Scene>, placements: &[Placement]) {
        if let Some(preparation) = &mut self.preparation {
            preparation.outdate();
        }
        Arc::make_mut(&mut self.surfaces).place(scene, placements);
        self.coarse.forget_pose();
        match self.cells.is_some() && self.full.for_cells().is_some() {
            true => self.earlier = Some(self.full.take()),
            false => self.full.forget_pose(),
        }
    }

    /// The report of the present level, once it is lit.
    pub(crate) fn report(&self) -> Option<PathReport> {
        self.present()?.report()
    }

    /// Lights the leaf sides of a level, unless they are up to date for this pose and these lights. Jobs show that level from
    /// now on. With `may_lag` a job shows the full level of an earlier pose, while another thread lights that of the present one.
    /// Returns the cost.
    ///
    /// # Errors
    /// [`RenderError::OutOfMemory`] for too many rays.
    pub(crate) fn ready(
        &mut self,
        tracing: &Arc<LightTracing>,
        light: LightLevel,
        may_lag: bool,
    ) -> Result<Vec<Stage>, RenderError> {
        (self.light, self.lags) = (light, false);
        if light == LightLevel::Full && self.earlier.is_some() {
            if may_lag && !self.prepare(tracing, light)? {
                self.lags = true;
                return Ok(Vec::new());
            }
            self.earlier = None;
        }
        let leaves = match light {
            LightLevel::Direct => return Ok(Vec::new()),
            LightLevel::Coarse => &mut self.coarse,
            LightLevel::Full => &mut self.full,
        };
        leaves.ready(&self.surfaces, tracing)
    }

    /// Prepares a level in another thread, unless it is lit. Returns whether it is.
    ///
    /// # Errors
    /// The error of the preparation.
    pub(crate) fn prepare(
        &mut self,
        tracing: &Arc<LightTracing>,
        light: LightLevel,
    ) -> Result<bool, RenderError> {
        let lighting = &tracing.lighting;
        let Some(leaves) = self.at(light).filter(|leaves| !leaves.is_lit(lighting)) else { return Ok(true) };
        let (settings, fills_cells) = (leaves.settings(), leaves.fills_cells());
        if let Some(outdated) = self.preparation.as_mut().filter(|one| one.is_outdated()) {
            // One thread at a time, however often things move.
            // A lamp that moves changes the lighting, too, so any is later than what is shown.
            let is_full = outdated.level() == LightLevel::Full;
            let Some(prepared) = outdated.prepared() else { return Ok(false) };
            self.preparation = None;
            if is_full && self.earlier.is_some() {
                // Light follows what moves all the time.
                self.earlier = Some(prepared?);
            }
        }
        let Some(preparation) = self.preparation.as_mut().filter(|one| one.is_of(light, lighting)) else {
            let leaves = LitLeaves::new(settings, fills_cells);
            self.preparation = Some(Preparation::begin(leaves, &self.surfaces, tracing, light)?);
            return Ok(false);
        };
        let Some(prepared) = preparation.prepared() else { return Ok(false) };
        self.preparation = None;
        match light {
            LightLevel::Direct => {}
            LightLevel::Coarse => self.coarse = prepared?,
            LightLevel::Full => self.full = prepared?,
        }
        Ok(true)
    }

    /// Indirect irradiance / π at texels about an eye, each by one of `divisor` of its rays; `None` where the present level has
    /// none.
    pub(super) fn irradiance_over_pi(
        &self,
        points: &ShadingPoints,
        about: &LightRaysAbout<'_>,
        eye: DVec3,
        divisor: u32,
    ) -> Option<Vec<Vec3>> {
        self.present()?.irradiance_over_pi(points, about, eye, divisor)
    }

    /// The cells' settings; `None` without cells.
    pub(crate) fn cells(&self) -> Option<CellSettings> {
        self.cells.as_ref().map(LightCells::settings)
    }

    /// What the cells are; `None` without cells.
    pub(crate) fn cell_report(&self) -> Option<CellReport> {
        self.cells.as_ref().map(LightCells::report)
    }

    /// The pages of the cells, for other threads; `None` without cells.
    pub(crate) fn cell_pages(&self) -> Option<Arc<dyn CellPages>> {
        self.cells.as_ref().map(LightCells::pages)
    }

    /// Says what the next job asks of cells.
    pub(crate) fn begin(&self, asked: CellUse) {
        if let Some(cells) = &self.cells {
            cells.begin(asked, self.lags);
        }
    }

    /// What the present job is lit by.
    pub(crate) fn surface_light(&self) -> SurfaceLight {
        self.cells.as_ref().map_or(SurfaceLight::Rays, LightCells::light)
    }

    /// Light of sky and surfaces at texels, from cells; `None` where rays have to find it.
    pub(super) fn look_up(
        &self,
        tracing: &LightTracing,
        points: &ShadingPoints,
        eye: Eye<'_>,
    ) -> Option<Vec<CellLight>> {
        let cells = self.present_cells()?;
        let inputs = &self.present()?.for_cells()?;
        let about = &tracing.rays.about(inputs.leaves.center());
        cells.look_up(Parts { inputs, surfaces: &self.surfaces, about }, points, eye)
    }

    /// Learns the time of texels' light by rays, of which they cast one of `divisor`: views fill cells for no longer.
    pub(super) fn took_rays(&self, points: &ShadingPoints, divisor: u32, took: Duration) {
        if let Some(cells) = self.present_cells() {
            cells.took_rays(points, divisor, took);
        }
    }

    /// Begins a lookup of texels on a device; `None` where rays have to find their light.
    ///
    /// # Errors
    /// [`RenderError::OutOfMemory`] if the cells are larger than the device can bind.
    pub(super) fn begin_on_device(
        &self,
        tracing: &LightTracing,
        eye: Eye<'_>,
        gpu: &Gpu,
        asking: Asking<'_>,
    ) -> Result<Option<DeviceLookup>, RenderError> {
        let Some((inputs, cells)) = &self.full.for_cells().zip(self.present_cells()) else {
            return Ok(None);
        };
        let about = &tracing.rays.about(inputs.leaves.center());
        cells.begin_on_device(Parts { inputs, surfaces: &self.surfaces, about }, eye, gpu, asking)
    }

    /// Whether a lookup on a device will probably find all cells.
    pub(super) fn expects_whole_cells(&self) -> bool {
        self.cells.as_ref().is_some_and(LightCells::are_expected_whole)
    }

    /// Takes over what a device found of cells. Returns whether the tile is lit by them: false if some lack.
    pub(super) fn take(&self, lookup: &DeviceLookup, outcome: &CellOutcome) -> bool {
        self.cells.as_ref().is_some_and(|cells| cells.accept(lookup, outcome))
    }

    /// Fills the cells of corners that a device found lacking, by their numbers. Returns false if the job is lit by rays instead.
    pub(super) fn fill_lacking(
        &self,
        tracing: &LightTracing,
        lookup: &DeviceLookup,
        outcome: &CellOutcome,
        corners: &[u64],
    ) -> bool {
        let Some((inputs, cells)) = &self.full.for_cells().zip(self.cells.as_ref()) else {
            return false;
        };
        let about = &tracing.rays.about(inputs.leaves.center());
        cells.fill_lacking(Parts { inputs, surfaces: &self.surfaces, about }, lookup, outcome, corners)
    }

    /// Keeps a lookup until its outcome is read.
    pub(super) fn await_outcome(&self, lookup: DeviceLookup) {
        *self.awaited.lock().unwrap_or_else(PoisonError::into_inner) = Some(lookup);
    }

    /// Takes over the outcome of the awaited lookup. Returns false if cells lacked, so that the image is to be rendered again.
    pub(crate) fn accept(&self, outcome: &[u8]) -> bool {
        let awaited = self.awaited.lock().unwrap_or_else(PoisonError::into_inner).take();
        awaited.zip(CellOutcome::new(outcome)).is_some_and(|(lookup, outcome)| self.take(&lookup, &outcome))
    }

    /// The lit leaves of the present level on a device; `None` where the level has none.
    ///
    /// # Errors
    /// [`RenderError::OutOfMemory`] if they are larger than the device can bind.
    pub(super) fn leaves_on_device(&self, gpu: &Arc<Gpu>) -> Result<Option<Arc<DeviceLeaves>>, RenderError> {
        self.present().map_or(Ok(None), |leaves| leaves.on_device(gpu))
    }

    /// Rays of a gathering texel at the present level, with one of `divisor` of them.
    pub(super) fn gather_rays(&self, divisor: u32) -> u32 {
        self.present().map_or(0, |leaves| leaves.gather_rays(divisor))
    }

    /// The cells, if the present level looks them up.
    fn present_cells(&self) -> Option<&LightCells> {
        self.cells.as_ref().filter(|_| self.light == LightLevel::Full)
    }

    /// Fills cells that views lacked for about so long, and with `refines` refines others. Returns whether there is more to do.
    pub(crate) fn fill_slice(&self, tracing: &LightTracing, time: Duration, refines: bool) -> bool {
        let Some(inputs) = &self.full.for_cells() else { return false };
        let is_lit = inputs.lighting == tracing.lighting;
        let Some(cells) = self.cells.as_ref().filter(|_| is_lit) else { return false };
        let about = &tracing.rays.about(inputs.leaves.center());
        cells.fill_slice(Parts { inputs, surfaces: &self.surfaces, about }, time, refines)
    }

    /// Writes down from now on what rays about an eye meet and light is read from. Nothing is, where nothing moves and where light is
    /// not from cells.
    pub(crate) fn begin_trail(&mut self, tracing: &LightTracing, eye: DVec3) {
        let begun = self.with_parts(tracing, |cells, parts| {
            cells.trail(parts, (eye - parts.inputs.leaves.center()).as_vec3())
        });
        self.trail = begun.flatten();
    }

    /// The trail that is being written.
    pub(crate) fn trail(&self) -> Option<&Trail> {
        self.trail.as_ref()
    }

    /// Ends the trail.
    pub(crate) fn take_trail(&mut self) -> Option<Trail> {
        self.trail.take()
    }

    /// Goes on with a trail.
    pub(crate) fn resume_trail(&mut self, trail: Option<Trail>) {
        self.trail = trail;
    }

    /// Takes up a face of a sample that was rendered, with its whole trail.
    pub(crate) fn add_face(&self, tracing: &LightTracing, of: SampleOf, face: usize, trail: Trail) {
        if let Some(cells) = self.present_cells() {
            cells.add_face(of, face, trail, tracing.face_lights());
        }
    }

    /// The faces among `asked` of a sample that it has in an earlier state as it would have them if they were rendered now.
    pub(crate) fn unchanged_faces(
        &self,
        tracing: &LightTracing,
        of: SampleOf,
        earlier: SceneState,
        asked: FaceMask,
    ) -> FaceMask {
        let unchanged = self.with_parts(tracing, |cells, parts| {
            cells.unchanged_faces(parts, of, (earlier, asked), tracing.face_lights())
        });
        unchanged.unwrap_or(FaceMask::NONE)
    }

    /// Forgets which faces are as they would be now: they would be rendered otherwise.
    pub(crate) fn forget_faces(&self) {
        if let Some(cells) = &self.cells {
            cells.forget_faces();
        }
    }

    /// Calls with the cells that the present level looks up, and the parts of their scene; `None` if there are none.
    fn with_parts<T>(
        &self,
        tracing: &LightTracing,
        call: impl FnOnce(&LightCells, Parts<'_>) -> T,
    ) -> Option<T> {
        let cells = self.present_cells().filter(|_| !self.lags)?;
        let inputs = &self.full.for_cells()?;
        let about = &tracing.rays.about(inputs.leaves.center());
        Some(call(cells, Parts { inputs, surfaces: &self.surfaces, about }))
    }

    /// The cells, and what they are of.
    #[cfg(test)]
    pub(super) fn for_tests(&self) -> (&LightCells, CellInputs) {
        (self.cells.as_ref().expect("has cells"), self.full.for_cells().expect("is lit"))
    }

    #[cfg(test)]
    pub(super) fn surfaces(&self) -> &Surfaces {
        &self.surfaces
    }

    fn forget_cells(&mut self) {
        if let Some(cells) = &mut self.cells {
            cells.forget();
        }
    }

    /// The leaf sides that the present job shows; `None` for direct light.
    fn present(&self) -> Option<&LitLeaves> {
        if self.lags { self.earlier.as_ref() } else { self.at(self.light) }
    }

    /// The leaf sides of a level; `None` for direct light.
    fn at(&self, light: LightLevel) -> Option<&LitLeaves> {
        match light {
            LightLevel::Direct => None,
            LightLevel::Coarse => Some(&self.coarse),
            LightLevel::Full => Some(&self.full),
        }
    }
}
