//! Program: `shaders/compositor/bounds.wgsl`. Finds the nearest and the farthest surface of each tile of samples
//! that are taken in.

use std::sync::Arc;

use argus_gpu::{ComputePipeline, Gpu, wgpu};
use argus_scene::camera::Face;
use argus_scene::{PlaneKind, RenderError};
use argus_shaders::layout::compositor::TileBounds;

use crate::cull::{FaceTiles, tile_side};
use crate::pool::Pool;

/// The pass, run once a sample.
#[derive(Debug)]
pub(crate) struct BoundsPass {
    pipeline: ComputePipeline,
}

impl BoundsPass {
    pub(crate) fn new(gpu: &Gpu) -> Self {
        Self { pipeline: gpu.compute_pipeline(&argus_shaders::compositor::BOUNDS, "bound_tile") }
    }

    /// The tiles of every face of every sample, given as its pool, layer and faces.
    pub(crate) fn run(
        &self,
        gpu: &Arc<Gpu>,
        samples: &[(&Pool, u32, Vec<Face>)],
    ) -> Result<Vec<Vec<FaceTiles>>, RenderError> {
        let tiles_of = |face: &Face| face.size.map(|side| side.div_ceil(tile_side(face)));
        let count: u32 = samples
            .iter()
            .flat_map(|(_, _, faces)| faces)
            .map(|face| tiles_of(face).iter().product::<u32>())
            .sum();
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC;
        let tiles = gpu.buffer("tile bounds", u64::from(count) * 8, usage);
        let mut commands = gpu.commands("hold samples");
        let mut first_tile = 0;
        for (pool, layer, faces) in samples {
            for face in faces {
                let [tile_columns, tile_rows] = tiles_of(face);
                let immediates = TileBounds {
                    face_offset: face.offset,
                    face_size: face.size,
                    layer: *layer,
                    first_tile,
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
                first_tile += tile_columns * tile_rows;
            }
        }
        let ticket = commands.read_buffer(&tiles, 0..u64::from(count) * 8);
        let bytes = commands.submit().wait()?.take(ticket);
        let mut values = bytes.chunks_exact(8).map(|pair| {
            let float = |i: usize| f32::from_le_bytes([pair[i], pair[i + 1], pair[i + 2], pair[i + 3]]);
            [float(0), float(4)]
        });
        let collect = |face: &Face| {
            let [columns, rows] = tiles_of(face);
            let inverse_range = values.by_ref().take((columns * rows) as usize).collect();
            FaceTiles { columns, rows, inverse_range }
        };
        let mut collect = collect;
        Ok(samples.iter().map(|(_, _, faces)| faces.iter().map(&mut collect).collect()).collect())
    }
}
