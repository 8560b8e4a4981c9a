//! Program: `shaders/compositor/bounds.wgsl`. Computes the least and greatest inverse range of each tile of a sample.

use argus_gpu::{Commands, ComputePipeline, Gpu, PendingReadback, wgpu};
use argus_scene::camera::Face;
use argus_scene::{PlaneKind, RenderError};
use argus_shaders::layout::compositor::TileBounds;

use crate::cull::{FaceTiles, tile_side};
use crate::pool::Pool;

/// One dispatch a face of a sample, when the sample is uploaded.
#[derive(Debug)]
pub(crate) struct BoundsPass {
    pipeline: ComputePipeline,
}

impl BoundsPass {
    pub(crate) fn new(gpu: &Gpu) -> Self {
        Self { pipeline: gpu.compute_pipeline(&argus_shaders::compositor::BOUNDS, "bound_tile") }
    }

    /// Bounds the tiles of a face of the sample in a layer. [`Self::tiles`] decodes the bytes that are read back.
    pub(crate) fn record(
        &self,
        gpu: &Gpu,
        commands: &mut Commands,
        pool: &Pool,
        layer: u32,
        face: &Face,
    ) -> Result<PendingReadback, RenderError> {
        let [tile_columns, tile_rows] = tiles_of(face);
        let bytes = u64::from(tile_columns * tile_rows) * 8;
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC;
        let tiles = gpu.buffer("tile bounds", bytes, usage);
        let immediates = TileBounds {
            face_offset: face.offset,
            face_size: face.size,
            layer,
            first_tile: 0,
            tile_columns,
            tile_rows,
            tile_side: tile_side(face),
            _pad: 0,
        };
        commands
            .compute("bound tiles", &self.pipeline)
            .read("inverse_range", pool.view(PlaneKind::InverseRange)?)
            .write("tiles", &tiles)
            .immediates(bytemuck::bytes_of(&immediates))
            .dispatch_threads([tile_columns, tile_rows, 1]);
        Ok(commands.read_buffer(&tiles, 0..bytes))
    }

    /// Decodes the tiles of a face from the bytes that were read back.
    pub(crate) fn tiles(face: &Face, bytes: &[u8]) -> FaceTiles {
        let [columns, rows] = tiles_of(face);
        let float = |four: &[u8]| f32::from_le_bytes([four[0], four[1], four[2], four[3]]);
        let pair = |eight: &[u8]| [float(&eight[..4]), float(&eight[4..])];
        let inverse_range = bytes.chunks_exact(8).take((columns * rows) as usize).map(pair).collect();
        FaceTiles { columns, rows, inverse_range }
    }
}

/// Number of a face's tiles: columns, rows.
fn tiles_of(face: &Face) -> [u32; 2] {
    face.size.map(|side| side.div_ceil(tile_side(face)))
}
