//! Program: `shaders/sampler/trace.wgsl`. Fills the visibility buffer by tracing packets of rays.

use std::sync::OnceLock;

use argus_gpu::{Commands, ComputePipeline, Gpu, wgpu};
use argus_scene::RenderError;
use argus_shaders::layout::sampler::PlacedTree;
use argus_shaders::sampler::TRACE;
use glam::DVec3;

use super::TileContext;
use super::trace_cutouts::{TraceCutouts, TracedTrees};
use crate::bvh::{Hierarchy, PlacedObject};
use crate::resident::upload;
use crate::wide::Wide;

/// Texels in a row of the program's textures.
const ROW: u32 = 1 << 13;
/// Most levels of a tree; the size of the program's stacks.
const MOST_LEVELS: u32 = 24;
/// Lanes of a packet: one for each child of a node.
const LANES: u32 = 8;

/// Traces packets of rays, one a subgroup.
pub(crate) struct Trace {
    wide: Wide,
    children: wgpu::TextureView,
    triangles: wgpu::TextureView,
    /// Distance of the near plane, in units of the rays' directions.
    near: f32,
    /// Set by packets that ended early.
    unfinished: wgpu::Buffer,
    /// By the base-2 logarithm of a lane's rows.
    opaque: [OnceLock<ComputePipeline>; 4],
    cutouts: Option<TraceCutouts>,
}

impl Trace {
    /// Uploads a hierarchy. `near` is the distance of the near plane, metres.
    ///
    /// # Errors
    /// Why this device cannot trace it.
    pub(crate) fn new(gpu: &Gpu, hierarchy: &Hierarchy, near: f32) -> Result<Self, String> {
        let lanes = gpu.device.adapter_info().subgroup_min_size;
        if !gpu.device.features().contains(wgpu::Features::SUBGROUP) || lanes < LANES {
            return Err("its subgroups have fewer than 8 lanes".to_owned());
        }
        let mut wide = Wide::new(hierarchy).ok_or("the scene has more triangles than references count")?;
        let (_, top_levels) = wide.top(hierarchy, DVec3::ZERO);
        let levels = wide.levels.max(top_levels);
        if levels > MOST_LEVELS {
            return Err(format!("the scene's hierarchy has {levels} levels"));
        }
        let children = texels(gpu, "children of a tree's nodes", bytemuck::cast_slice(&wide.children))?;
        let triangles = texels(gpu, "triangles of trees", bytemuck::cast_slice(&wide.triangles))?;
        (wide.children, wide.triangles) = (Vec::new(), Vec::new());
        let has_cutouts = wide.roots.iter().any(|root| root.kinds & 2 != 0);
        Ok(Self {
            wide,
            children,
            triangles,
            unfinished: gpu.buffer(
                "unfinished packets",
                4,
                wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC | wgpu::BufferUsages::COPY_DST,
            ),
            near,
            opaque: Default::default(),
            cutouts: has_cutouts.then(TraceCutouts::default),
        })
    }

    /// Uploads another hierarchy of the same scene, and keeps the pipelines.
    ///
    /// # Errors
    /// Why this device cannot trace it.
    pub(crate) fn renewed(self, gpu: &Gpu, hierarchy: &Hierarchy) -> Result<Self, String> {
        let new = Self::new(gpu, hierarchy, self.near)?;
        // The pipelines of opaque triangles are compiled for whether there are cut-outs.
        match new.cutouts.is_some() == self.cutouts.is_some() {
            true => Ok(Self { opaque: self.opaque, cutouts: self.cutouts, ..new }),
            false => Ok(new),
        }
    }

    /// Fills the visibility buffer. Sky is 0.
    ///
    /// # Errors
    /// [`RenderError::OutOfMemory`] if there are more placed objects than the device can bind.
    pub(crate) fn record(
        &self,
        commands: &mut Commands,
        context: &TileContext<'_>,
        hierarchy: &Hierarchy,
    ) -> Result<(), RenderError> {
        let TileContext { gpu, eye, targets, tile, rays, .. } = context;
        let (top, _) = self.wide.top(hierarchy, eye.position);
        let placed: Vec<PlacedTree> = hierarchy.placed.iter().map(|p| self.about(p, eye.position)).collect();
        let storage = wgpu::BufferUsages::STORAGE;
        let (top, placed) =
            (upload(gpu, "top tree", &top, storage)?, upload(gpu, "placed trees", &placed, storage)?);
        let [width, height] = tile.sub_samples();
        commands.clear(&self.unfinished);
        let log = rows_log(hierarchy, [width, height]);
        let pipeline = self.opaque[log as usize].get_or_init(|| {
            let constants = [
                ("rows", f64::from(1 << log)),
                ("nearest_inverse", self.nearest_inverse()),
                ("has_cutouts", f64::from(u8::from(self.cutouts.is_some()))),
            ];
            gpu.compute_pipeline_with(&TRACE, "trace_opaque", &constants)
        });
        commands
            .compute("trace", pipeline)
            .read("rays", rays)
            .read("children", &self.children)
            .read("triangles", &self.triangles)
            .read("top", &top)
            .read("placed", &placed)
            .write("visibility", &targets.visibility)
            .write("inverse_distances", &targets.shaded)
            .write("unfinished", &self.unfinished)
            .dispatch([width.div_ceil(8), height.div_ceil(8 << log), 1]);
        if let Some(cutouts) = &self.cutouts {
            let Self { children, triangles, unfinished, .. } = self;
            let nearest_inverse = self.nearest_inverse();
            let (top, placed) = (&top, &placed);
            let trees = TracedTrees { children, triangles, top, placed, unfinished, nearest_inverse };
            cutouts.record(commands, context, &trees);
        }
        Ok(())
    }

    /// Four bytes that say whether any packet ended early. Decode them with [`Self::is_whole`].
    pub(crate) fn unfinished(&self) -> &wgpu::Buffer {
        &self.unfinished
    }

    /// Whether no packet ended early, by the bytes of [`Self::unfinished`].
    pub(crate) fn is_whole(unfinished: &[u8]) -> bool {
        unfinished.iter().all(|&byte| byte == 0)
    }

    /// Inverse distance of the near plane, in units of the rays' directions.
    fn nearest_inverse(&self) -> f64 {
        1.0 / f64::from(self.near)
    }

    fn about(&self, placed: &PlacedObject, eye: DVec3) -> PlacedTree {
        let m = placed.object_from_world;
        let eye_in_tree = m * (eye - placed.origin);
        let row = |i: usize| {
            let row = m.row(i);
            [row.x as f32, row.y as f32, row.z as f32, eye_in_tree[i] as f32]
        };
        PlacedTree {
            tree_from_eye_x: row(0),
            tree_from_eye_y: row(1),
            tree_from_eye_z: row(2),
            root: self.wide.roots[placed.object as usize].reference,
            instance: placed.instance,
            _pad: [0; 2],
        }
    }
}

/// Triangles a packet of one row, if they were spread evenly.
fn triangles_a_row(hierarchy: &Hierarchy, [width, height]: [u32; 2]) -> u64 {
    let placed = |p: &PlacedObject| u64::from(hierarchy.objects[p.object as usize].triangles);
    let triangles: u64 = hierarchy.placed.iter().map(placed).sum();
    triangles * u64::from(LANES) / (u64::from(width) * u64::from(height)).max(1)
}

/// Base-2 logarithm of a lane's rows: fewer rows for more triangles a sub-sample.
fn rows_log(hierarchy: &Hierarchy, size: [u32; 2]) -> u32 {
    match triangles_a_row(hierarchy, size) {
        0..16 => 3,
        16..64 => 2,
        64..256 => 1,
        _ => 0,
    }
}

/// A texture with texels of 16 bytes.
fn texels(gpu: &Gpu, label: &str, bytes: &[u8]) -> Result<wgpu::TextureView, String> {
    let row_bytes = ROW as usize * 16;
    let height = bytes.len().div_ceil(row_bytes).max(1);
    let most = gpu.device.limits().max_texture_dimension_2d;
    if ROW > most || height > most as usize {
        return Err(format!("{label} take {height} rows of a texture, and this device has {most}"));
    }
    let usage = wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST;
    let texture = gpu.texture_2d(label, [ROW, height as u32], wgpu::TextureFormat::Rgba32Uint, usage);
    let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: None, rows_per_image: None };
    for (row, bytes) in bytes.chunks(row_bytes).enumerate() {
        let origin = wgpu::Origin3d { x: 0, y: row as u32, z: 0 };
        let to = wgpu::TexelCopyTextureInfo { origin, ..texture.as_image_copy() };
        let size = wgpu::Extent3d { width: (bytes.len() / 16) as u32, height: 1, depth_or_array_layers: 1 };
        gpu.queue.write_texture(to, bytes, layout, size);
    }
    Ok(texture.create_view(&wgpu::TextureViewDescriptor::default()))
}
