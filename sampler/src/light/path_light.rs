//! Indirect light of a scene at its levels: by paths between leaf sides, or by light cells that gather it.

mod lit_leaves;
mod preparation;

use std::sync::Arc;
use std::time::Duration;

use argus_scene::{
    CellPages, CellReport, CellSettings, LightLevel, PathSettings, RenderError, Scene, Stage, SurfaceLight,
};
use glam::{DVec3, Vec3};

use super::cells::{CellLight, CellUse, Eye, LightCells, Parts};
use super::shading_points::ShadingPoints;
use super::tracing::LightTracing;
use crate::light_rays::LightRaysAbout;
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
    /// Cells that gather the light of the full level, if views look it up.
    cells: Option<LightCells>,
    /// The level of the present job.
    light: LightLevel,
    /// The level that is being prepared.
    preparation: Option<Preparation>,
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
            cells: cells.map(LightCells::new),
            light: LightLevel::default(),
            preparation: None,
        }
    }

    /// Changes the settings. Marks what depends on them as out of date.
    pub(crate) fn set_settings(&mut self, settings: PathSettings) {
        self.preparation = None;
        self.forget_cells();
        self.coarse.set_settings(settings.at(LightLevel::Coarse).unwrap_or(settings));
        self.full.set_settings(settings);
    }

    /// Moves instances of a posed scene. Marks all as out of date.
    pub(crate) fn place(&mut self, scene: &Arc<Scene>, placements: &[Placement]) {
        self.preparation = None;
        self.forget_cells();
        Arc::make_mut(&mut self.surfaces).place(scene, placements);
        self.coarse.forget_pose();
        self.full.forget_pose();
    }

    /// The report of the present level, once it is lit.
    pub(crate) fn report(&self) -> Option<PathReport> {
        self.at(self.light)?.report()
    }

    /// Lights the leaf sides of a level, unless they are up to date for this pose and these lights. Jobs show that level from
    /// now on. Returns the cost.
    ///
    /// # Errors
    /// [`RenderError::OutOfMemory`] for too many rays.
    pub(crate) fn ready(
        &mut self,
        tracing: &LightTracing,
        light: LightLevel,
    ) -> Result<Vec<Stage>, RenderError> {
        self.light = light;
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
        self.at(self.light)?.irradiance_over_pi(points, about, eye, divisor)
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
            cells.begin(asked);
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
        let cells = self.cells.as_ref().filter(|_| self.light == LightLevel::Full)?;
        let (leaves, tree, lighting, radiance) = self.full.for_cells()?;
        let about = &tracing.rays.about(leaves.center());
        let surfaces = &self.surfaces;
        cells.look_up(Parts { leaves, tree, surfaces, about, lighting, radiance }, points, eye)
    }

    /// Fills cells that views lacked for about so long, and with `refines` refines others. Returns whether there is more to do.
    pub(crate) fn fill_slice(&self, tracing: &LightTracing, time: Duration, refines: bool) -> bool {
        let Some((leaves, tree, lighting, radiance)) = self.full.for_cells() else { return false };
        let Some(cells) = self.cells.as_ref().filter(|_| *lighting == tracing.lighting) else { return false };
        let about = &tracing.rays.about(leaves.center());
        let surfaces = &self.surfaces;
        cells.fill_slice(Parts { leaves, tree, surfaces, about, lighting, radiance }, time, refines)
    }

    fn forget_cells(&mut self) {
        if let Some(cells) = &mut self.cells {
            cells.forget();
        }
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
