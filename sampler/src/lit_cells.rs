//! Light cells on a device about an eye, as passes of light read them: `shaders/shared/light_cells.wgsl`.

use argus_gpu::{ComputeCall, Gpu, wgpu};
use argus_shaders::layout::surface_light::{CellEye, CellQuery};

/// Corners that lack and are noted at most.
pub(crate) const MOST_LACKING: u32 = 1 << 16;
/// Words of an outcome before those of pages.
pub(crate) const OUTCOME_WORDS: usize = 6;

/// The pages that a device holds.
#[derive(Clone)]
pub(crate) struct CellBuffers {
    /// Pages by their number, with open addressing.
    pub(crate) table: wgpu::Buffer,
    /// Blocks of the pages.
    pub(crate) data: wgpu::Buffer,
    /// Number of pages.
    pub(crate) pages: usize,
}

/// Light cells about an eye, and what lookups find of them.
pub(crate) struct CellsAbout {
    buffers: CellBuffers,
    query: wgpu::Buffer,
    eyes: wgpu::Buffer,
    across: wgpu::Buffer,
    /// What was found of the cells: [`CellOutcome`].
    pub(crate) outcome: wgpu::Buffer,
    /// Numbers of the corners that lack, two words each.
    pub(crate) lacking: wgpu::Buffer,
}

/// What a device found of the cells of a tile.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct CellOutcome {
    /// How many of three tiers one of the cells lacks; all if some lacked only at the lookup.
    pub(crate) lacks: u32,
    /// Number of corners that lack what was needed, some of them counted several times.
    pub(crate) lacking: u32,
    /// Texels without a surface, and those that no cells describe.
    pub(crate) nothing: u32,
    pub(crate) alone: u32,
    /// Whether each page is used.
    pub(crate) used: Vec<bool>,
}

impl CellOutcome {
    /// Reads an outcome; `None` if bytes lack.
    pub(crate) fn new(bytes: &[u8]) -> Option<Self> {
        let words: Vec<u32> = bytes.as_chunks::<4>().0.iter().map(|word| u32::from_le_bytes(*word)).collect();
        let (&[lacks, lacking, nothing, alone, finer, late], used) =
            words.split_first_chunk::<OUTCOME_WORDS>()?;
        let lacks = if late == 0 { lacks.max(finer) } else { u32::MAX };
        Some(Self { lacks, lacking, nothing, alone, used: used.iter().map(|word| *word != 0).collect() })
    }
}

impl CellsAbout {
    /// `eyes`: the eye in the cells of each level. `across`: mean sides of the areas that texels stand for, metres; none for what pixels
    /// show. `lacking`: room for [`MOST_LACKING`] corners.
    pub(crate) fn new(
        gpu: &Gpu,
        buffers: CellBuffers,
        asked: CellQuery,
        eyes: &[CellEye],
        across: &[f32],
        lacking: wgpu::Buffer,
    ) -> Self {
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC | wgpu::BufferUsages::COPY_DST;
        let words = (OUTCOME_WORDS + buffers.pages) as u64;
        Self {
            query: gpu.upload("lookup of cells", &[asked], wgpu::BufferUsages::UNIFORM),
            eyes: gpu.upload("the eye in cells", eyes, wgpu::BufferUsages::STORAGE),
            across: gpu.upload("areas of texels", across, wgpu::BufferUsages::STORAGE),
            outcome: gpu.buffer("outcome of a lookup", words * 4, usage),
            buffers,
            lacking,
        }
    }

    /// Binds what a program reads to look cells up.
    pub(crate) fn bind<'b>(&'b self, call: ComputeCall<'b>) -> ComputeCall<'b> {
        call.read("cell_query", &self.query)
            .read("cell_eyes", &self.eyes)
            .read("cell_across", &self.across)
            .read("page_table", &self.buffers.table)
            .read("cell_data", &self.buffers.data)
    }
}
