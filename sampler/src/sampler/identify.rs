//! What a view sees, for comparisons of backends.

use std::time::{Duration, Instant};

use argus_scene::{Camera, InvalidField, RenderError, SampleCamera, Visibility};

use super::gpu_sampler::GpuSampler;
use crate::passes::TileContext;
use crate::scratch::Extras;
use crate::tile::tiles;

impl GpuSampler {
    /// The visibility buffer of a view, row by row: instance + 1 and triangle of its mesh for each sub-sample, 0 for the
    /// sky. Also the time it took, without building hierarchies and compiling.
    ///
    /// # Errors
    /// [`RenderError::Invalid`] for a view larger than a tile, or a backend that this device does not support; or the
    /// device is lost.
    pub fn identify(
        &mut self,
        camera: &Camera,
        size: [u32; 2],
        side: u32,
        visibility: Visibility,
    ) -> Result<(Vec<[u32; 2]>, Duration), RenderError> {
        self.check_alive()?;
        let [width, height] = size;
        let faces = SampleCamera::Perspective { camera: *camera, width, height }.faces();
        let [tile] = tiles(&faces, side)[..] else {
            return Err(InvalidField::new("width", "the view must fit a tile").into());
        };
        self.visibility
            .prepare(&self.gpu, &self.resident, visibility)
            .map_err(|reason| InvalidField::new("visibility", reason))?;
        let eye = self.eye(camera.eye, &self.lighting)?;
        let (gpu, resident) = (&self.gpu, &self.resident);
        let context = TileContext::new(gpu, resident, &eye, &tile, &mut self.scratch, Extras::default());
        let begin = Instant::now();
        self.visibility.fill(&context, visibility)?;
        let mut took = begin.elapsed();
        let mut commands = self.gpu.commands("read ids");
        let pending = commands.read_texture(context.targets.visibility.texture());
        let bytes = commands.submit().wait()?.take(pending);
        let mut ids: Vec<[u32; 2]> =
            bytes.as_chunks::<8>().0.iter().map(|b| bytemuck::pod_read_unaligned(b)).collect();
        if self.visibility.has_layers() {
            let begin = Instant::now();
            for ray in self.visibility.layers_of_tile(&self.resident, camera.eye, &tile.rays()) {
                if let (Some(id), Some((shown, _))) = (ids.get_mut(ray.at as usize), ray.shown()) {
                    *id = shown;
                }
            }
            took += begin.elapsed();
        }
        Ok((ids, took))
    }
}
