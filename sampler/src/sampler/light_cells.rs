//! Light cells of a sampler's scene: what jobs ask of them, how frames say so, and their filling beside views.

use std::time::Duration;

use argus_scene::{CellReport, CellSettings, Indirect, InvalidField, LightLevel, SurfaceLight, ViewJob};

use super::gpu_sampler::GpuSampler;
use crate::light::{CellUse, PathLight};

impl GpuSampler {
    /// Says what the next job asks of light cells.
    pub(super) fn begin_cells(&self, asked: CellUse) {
        if let Some(paths) = self.path_light() {
            paths.begin(asked);
        }
    }

    /// What the present job's light of sky and surfaces is from.
    pub(super) fn surface_light(&self) -> SurfaceLight {
        self.path_light().map_or(SurfaceLight::Rays, PathLight::surface_light)
    }

    /// What samples, maps and lists of pixels ask of light cells: the same tier everywhere, so that their bytes do not depend on what is
    /// filled.
    pub(super) fn cells_of_samples(&self) -> CellUse {
        CellUse::Whole { rays: CellSettings::FIRST_RAYS, reflected: true }
    }

    /// What a view asks of light cells.
    ///
    /// # Errors
    /// `plan.light`: its level or set has no light cells, or it asks for cells of an earlier pose.
    pub(super) fn cells_of_view(&self, view: &ViewJob) -> Result<CellUse, InvalidField> {
        let light = view.plan.light();
        if let Some(light @ SurfaceLight::OlderCells { .. }) = light {
            let reason = format!("light from {light} cannot be had again, since a scene moved");
            return Err(InvalidField::new("plan.light", reason));
        }
        if let (Some(light @ SurfaceLight::Cells { .. }), false) = (light, self.has_cells(view)) {
            let reason = format!("there is no light from {light} in a set with {}", self.settings.indirect);
            return Err(InvalidField::new("plan.light", reason));
        }
        Ok(light.into())
    }

    /// What a view in slices asks of light cells.
    ///
    /// # Errors
    /// Those of [`Self::cells_of_view`].
    pub(super) fn cells_of_slices(&self, view: &ViewJob) -> Result<CellUse, InvalidField> {
        match self.cells_of_view(view)? {
            CellUse::Open => Ok(CellUse::Held { rays: u32::MAX, reflected: true }),
            asked => Ok(asked),
        }
    }

    /// Whether bands of a view have to agree on their light of sky and surfaces, since its plan does not name it.
    pub(super) fn must_agree(&self, view: &ViewJob) -> bool {
        self.has_cells(view) && view.plan.light().is_none()
    }

    /// A view whose plan says where its light of sky and surfaces was from.
    pub(super) fn says_light(&self, view: &ViewJob) -> ViewJob {
        let light = self.has_cells(view).then(|| self.surface_light()).or(view.plan.light());
        ViewJob { plan: view.plan.clone().with_light(light), ..view.clone() }
    }

    fn has_cells(&self, view: &ViewJob) -> bool {
        matches!(self.settings.indirect, Indirect::Cells(_)) && view.state.light == LightLevel::Full
    }

    /// Fills light cells that views lacked for about so long, and with `refines` refines others. Returns whether there is more to
    /// do.
    pub(super) fn fill_cells(&self, time: Duration, refines: bool) -> bool {
        match (self.path_light(), &self.lights.direct) {
            (Some(paths), Some(direct)) => paths.fill_slice(direct.tracing(), time, refines),
            _ => false,
        }
    }

    /// Takes over what a finished part found of light cells. Returns false if some lacked, so that it is to be rendered again.
    pub(super) fn accept_cells(&self, outcome: &[u8]) -> bool {
        self.path_light().is_some_and(|paths| paths.accept(outcome))
    }

    /// Report on light cells. `None` without them, and before indirect light was first needed.
    pub(super) fn cell_report(&self) -> Option<CellReport> {
        self.path_light()?.cell_report()
    }
}
