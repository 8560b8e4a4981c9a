//! Program: `shaders/sampler/look_up_cells.wgsl`. Light of the sky and of other surfaces from light cells.

use argus_gpu::{Commands, ComputePipeline, Gpu};
use argus_shaders::sampler::LOOK_UP_CELLS;

use crate::lit_cells::CellsAbout;
use crate::lit_tile::LitTexels;

/// Row of the timing table.
const CELLS: &str = "look up light cells";

/// A program for each step.
pub(crate) struct LookUpCells {
    survey: ComputePipeline,
    survey_finer: ComputePipeline,
    look_up: ComputePipeline,
}

impl LookUpCells {
    /// `has_across`: whether texels stand for other areas than what pixels show.
    pub(crate) fn new(gpu: &Gpu, has_across: bool) -> Self {
        let constants = [("has_across", f64::from(u8::from(has_across)))];
        let pipeline = |entry| gpu.compute_pipeline_with(&LOOK_UP_CELLS, entry, &constants);
        Self {
            survey: pipeline("survey"),
            survey_finer: pipeline("survey_finer"),
            look_up: pipeline("look_up"),
        }
    }

    /// Finds which tier all cells of a tile have, which cells lack, and which pages are used.
    pub(crate) fn survey(&self, commands: &mut Commands, texels: &LitTexels, cells: &CellsAbout) {
        commands.clear(&cells.outcome);
        for pipeline in [&self.survey, &self.survey_finer] {
            cells
                .bind(texels.bind(commands.compute(CELLS, pipeline)))
                .write("cell_outcome", &cells.outcome)
                .write("lacking", &cells.lacking)
                .dispatch_linear(u64::from(texels.count));
        }
    }

    /// Looks all texels up, in the tier that [`Self::survey`] found. Those that no cells describe are left as members of the first
    /// image.
    pub(crate) fn look_up(&self, commands: &mut Commands, texels: &LitTexels, cells: &CellsAbout) {
        let found = texels.found();
        cells
            .bind(texels.bind(commands.compute(CELLS, &self.look_up)))
            .write("cell_outcome", &cells.outcome)
            .write("sky_share", &found.sky_share)
            .write("indirect", &found.indirect)
            .write("members", &found.members[0])
            .dispatch_linear(u64::from(texels.count));
    }
}
