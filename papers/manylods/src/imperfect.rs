//! Maps of many views from random points, with the same number of points for each view. Program:
//! `shaders/imperfect_views.wgsl`.

use std::sync::Arc;
use std::time::Instant;

use crate::layout::ImperfectStep;
use crate::programs::IMPERFECT_VIEWS;
use argus_gpu::wgpu::{Buffer, BufferUsages};

use crate::SphereHierarchy;
use argus_gpu::{ComputePipeline, Gpu};
use argus_megaviews::hierarchy::{HierarchyError, fits};
use argus_megaviews::many_views::{FrameStats, MapSet, Settings, TexelCode, ViewList, with_maps};

/// Imperfect shadow maps (Ritschel et al. 2008), for comparison. Their cost does not depend on the scene.
#[derive(Debug)]
pub struct ImperfectViews {
    gpu: Arc<Gpu>,
    settings: Settings,
    edge: f32,
    nodes: Buffer,
    /// First point among the nodes, and number of points.
    first: u32,
    pool: u32,
    maps: MapSet,
    pyramid: Buffer,
    made_for: usize,
    passes: Option<[ComputePipeline; 3]>,
}

impl ImperfectViews {
    /// Uses the leaves of a sphere hierarchy as points. Of the settings, only resolution and texel format matter.
    ///
    /// # Errors
    /// A setting out of range, or a resolution that is no power of two.
    pub fn new(gpu: &Arc<Gpu>, points: &SphereHierarchy, settings: Settings) -> Result<Self, HierarchyError> {
        settings.validate()?;
        if !settings.side.is_power_of_two() {
            let (range, value) = ("a power of two".to_owned(), settings.side.to_string());
            return Err(HierarchyError::OutOfRange { field: "resolution", range, value });
        }
        let code = TexelCode::new(settings.texel, (2 << points.depth) - 1, points.root.edge)?;
        Ok(Self {
            edge: points.root.edge as f32,
            nodes: points.nodes.clone(),
            first: (1 << points.depth) - 1,
            pool: 1 << points.depth,
            maps: MapSet::new(gpu, settings.side, code, 1)?,
            pyramid: gpu.buffer("pyramids", 4, BufferUsages::STORAGE),
            made_for: 0,
            passes: None,
            gpu: Arc::clone(gpu),
            settings,
        })
    }

    /// Splats `points` points into each view's map and fills gaps. Map and view have the same index.
    ///
    /// # Errors
    /// Maps exceed the device's memory, or the device failed.
    pub fn render(&mut self, views: &ViewList, points: u32) -> Result<FrameStats, HierarchyError> {
        let begin = Instant::now();
        let side = self.settings.side;
        if self.maps.capacity != views.count() {
            self.maps = MapSet::new(&self.gpu, side, self.maps.code, views.count())?;
            // A third of level 0.
            let bytes = u64::from(views.count()) * 2 * u64::from(side * side).div_ceil(3) * 4;
            fits(&self.gpu, "pyramids of all views", bytes)?;
            self.pyramid = self.gpu.buffer("pyramids", bytes, BufferUsages::STORAGE);
        }
        let arrays = self.maps.arrays.len();
        let constants = self.maps.constants();
        let make = |entry| self.gpu.compute_pipeline_with(&IMPERFECT_VIEWS, entry, &constants);
        let passes = match self.passes.take() {
            Some(passes) if self.made_for == arrays => passes,
            _ => ["splat_points", "pull_up", "push_down"].map(make),
        };
        let [splat, pull, push] = &passes;
        let step = ImperfectStep {
            count: views.count(),
            points,
            pool: self.pool,
            first: self.first,
            side,
            edge: self.edge,
            map_shift: self.maps.shift,
            to_side: side,
            from_side: side,
            to_begin: 0,
            from_begin: 0,
        };
        let mut commands = self.gpu.commands("imperfect views");
        self.maps.arrays.iter().for_each(|array| {
            commands.clear(array);
        });
        let call = commands.compute("splat", splat).read("nodes", &self.nodes).read("views", views.buffer());
        with_maps(call, &self.maps)
            .immediates(bytemuck::bytes_of(&step))
            .dispatch_linear(u64::from(views.count()) * u64::from(points));
        // Offset of each level in the pyramid.
        let mut begins = vec![0];
        for level in 1..=side.ilog2() {
            let own = if level == 1 { 0 } else { 2 * views.count() * (side >> (level - 1)).pow(2) };
            begins.push(begins[level as usize - 1] + own);
        }
        let between = |to: u32, from: u32| ImperfectStep {
            to_side: side >> to,
            from_side: side >> from,
            to_begin: begins[to as usize],
            from_begin: begins[from as usize],
            ..step
        };
        let levels = side.ilog2();
        let steps = (1..=levels).map(|level| (pull, between(level, level - 1)));
        let back = (0..levels).rev().map(|level| (push, between(level, level + 1)));
        for (pipeline, step) in steps.chain(back) {
            let call = commands.compute("pull and push", pipeline).write("pyramid", &self.pyramid);
            with_maps(call, &self.maps)
                .immediates(bytemuck::bytes_of(&step))
                .dispatch_linear(2 * u64::from(views.count()) * u64::from(step.to_side).pow(2));
        }
        let finished = commands.submit().wait()?;
        (self.made_for, self.passes) = (arrays, Some(passes));
        Ok(FrameStats {
            maps: views.count(),
            view_nodes: views.count(),
            view_leaves: views.count(),
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
