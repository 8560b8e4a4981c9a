//! Maps of many views without a hierarchy: every triangle is rasterised for every view. Program:
//! `shaders/raster_views.wgsl`.

use std::sync::Arc;
use std::time::Instant;

use crate::layout::RasterStep;
use crate::programs::RASTER_VIEWS;
use argus_gpu::wgpu::{Buffer, BufferUsages};

use super::traverse::with_maps;
use super::{FrameStats, MapSet, Settings, TexelCode, ViewList};
use crate::hierarchy::{HierarchyError, RootCube, Triangle, fits};
use argus_gpu::{ComputePipeline, Gpu};

/// Brute-force maps, the baseline for time and accuracy. A texel's range is that of its own ray.
#[derive(Debug)]
pub struct RasterViews {
    gpu: Arc<Gpu>,
    settings: Settings,
    root: RootCube,
    triangles: Buffer,
    count: u32,
    maps: MapSet,
    raster: Option<(usize, ComputePipeline)>,
}

/// Most views of a dispatch.
const MOST_AT_ONCE: u32 = 1024;

/// Most pairs of triangle and view in a dispatch: a fraction of a second on most devices.
const PAIRS_AT_ONCE: u32 = 1 << 29;

/// Number of views of a dispatch, at least one.
fn views_at_once(triangles: u32) -> u32 {
    (PAIRS_AT_ONCE / triangles.max(1)).clamp(1, MOST_AT_ONCE)
}

impl RasterViews {
    /// Uploads the triangles with an area. Of the settings, only resolution and texel format matter.
    ///
    /// # Errors
    /// A setting out of range, no triangle, or too many triangles for one array.
    pub fn new(
        gpu: &Arc<Gpu>,
        root: RootCube,
        triangles: impl IntoIterator<Item = Triangle>,
        settings: Settings,
    ) -> Result<Self, HierarchyError> {
        settings.validate()?;
        let unit = |t: Triangle| t.corners.map(|corner| root.unit_from_world(corner).as_vec3().to_array());
        let corners: Vec<[[f32; 3]; 3]> =
            triangles.into_iter().filter(Triangle::is_surface).map(unit).collect();
        if corners.is_empty() {
            return Err(HierarchyError::Empty);
        }
        fits(gpu, "corners of triangles", corners.len() as u64 * 36)?;
        let code = TexelCode::new(settings.texel, corners.len() as u32, root.edge)?;
        Ok(Self {
            triangles: gpu.upload("corners of triangles", &corners, BufferUsages::STORAGE),
            count: corners.len() as u32,
            maps: MapSet::new(gpu, settings.side, code, 1)?,
            raster: None,
            gpu: Arc::clone(gpu),
            settings,
            root,
        })
    }

    /// Renders a map for each view. Map and view have the same index.
    ///
    /// # Errors
    /// Maps exceed the device's memory, or the device failed.
    pub fn render(&mut self, views: &ViewList) -> Result<FrameStats, HierarchyError> {
        let begin = Instant::now();
        if self.maps.capacity != views.count {
            self.maps = MapSet::new(&self.gpu, self.settings.side, self.maps.code, views.count)?;
        }
        let arrays = self.maps.arrays.len();
        let pipeline = match self.raster.take() {
            Some((made_for, pipeline)) if made_for == arrays => pipeline,
            _ => self.gpu.compute_pipeline_with(&RASTER_VIEWS, "raster", &self.maps.constants()),
        };
        let mut commands = self.gpu.commands("raster views");
        self.maps.arrays.iter().for_each(|array| {
            commands.clear(array);
        });
        let at_once = views_at_once(self.count);
        for first_view in (0..views.count).step_by(at_once as usize) {
            let step = RasterStep {
                triangles: self.count,
                first_view,
                side: self.settings.side,
                edge: self.root.edge as f32,
                map_shift: self.maps.shift,
            };
            let call = commands.compute("raster", &pipeline).read("triangles", &self.triangles);
            let call = call.read("views", &views.buffer);
            with_maps(call, &self.maps).immediates(bytemuck::bytes_of(&step)).dispatch([
                self.count.div_ceil(64),
                at_once.min(views.count - first_view),
                1,
            ]);
        }
        let finished = commands.submit().wait()?;
        self.raster = Some((arrays, pipeline));
        Ok(FrameStats {
            maps: views.count,
            view_nodes: views.count,
            view_leaves: views.count,
            frame_ms: begin.elapsed().as_secs_f64() * 1e3,
            stages: finished.stages,
            map_bytes: self.maps.bytes(),
            ..FrameStats::default()
        })
    }

    /// The maps of the latest frame.
    pub fn maps(&self) -> &MapSet {
        &self.maps
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_dispatch_has_fewer_views_the_more_triangles_there_are_and_always_one() {
        assert_eq!([1, 500_000, 5_000_000, u32::MAX].map(views_at_once), [1024, 1024, 107, 1]);
    }
}
