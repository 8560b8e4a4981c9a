//! The draw calls of a tile: culled by frustum, sorted by pipeline.

use std::ops::Range;

use argus_scene::Bounds;
use argus_shaders::layout::sampler::Draw;
use glam::{DVec3, DVec4};

use crate::resident::{Chunk, DrawClass, MeshRun, Placement, Resident};
use crate::tile::{Frustum, Tile};

/// Distance of the near plane: as a share of the scene's diagonal, and at most in metres. Depth is near / distance in
/// f32, whose steps are relative, so a close near plane costs no precision.
const NEAR: (f64, f64) = (1.0 / 65536.0, 1e-3);

/// Distance of the near plane, metres. All visibility backends use it.
pub(crate) fn near(bounds: &Bounds) -> f32 {
    (bounds.size().length() * NEAR.0).clamp(f64::from(f32::MIN_POSITIVE), NEAR.1) as f32
}

/// One draw call.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Call {
    pub(crate) class: DrawClass,
    /// Range of the index buffer.
    pub(crate) indices: Range<u32>,
    pub(crate) base_vertex: i32,
    /// Range of [`DrawList::draws`], as instance indices.
    pub(crate) draws: Range<u32>,
}

/// The draw calls of a tile.
#[derive(Debug, Default)]
pub(crate) struct DrawList {
    pub(crate) draws: Vec<Draw>,
    /// Sorted by class.
    pub(crate) calls: Vec<Call>,
}

impl DrawList {
    /// The instances that `tile` may show from `eye`.
    pub(crate) fn new(resident: &Resident, eye: DVec3, tile: &Tile) -> Self {
        let clip_from_eye = tile.clip_from_eye();
        let near = near(&resident.bounds);
        let mut list = Self::default();
        for placement in &resident.instances {
            let from_eye = placement.origin - eye;
            let clip_from_mesh = clip_from_eye
                .map(|row| (placement.world_from_mesh.transpose() * row).extend(row.dot(from_eye)));
            let run = &resident.runs[placement.mesh as usize];
            let frustum = Frustum::new(clip_from_mesh);
            if !frustum.may_show(run.whole.middle, run.whole.half) {
                continue;
            }
            let placed = InstanceTransform { placement, run, clip_from_mesh, near };
            if let [_] = run.chunks[..] {
                list.push(&placed, run.whole.first_triangle..run.whole.triangles);
                continue;
            }
            for triangles in visible_runs(&run.chunks, &frustum) {
                list.push(&placed, triangles);
            }
        }
        list
    }

    fn push(&mut self, placed: &InstanceTransform<'_>, triangles: Range<u32>) {
        let [x, y, w] = placed.clip_from_mesh.map(|row| row.as_vec4().to_array());
        self.draws.push(Draw {
            clip_from_mesh_x: x,
            clip_from_mesh_y: y,
            clip_from_mesh_w: w,
            near: placed.near,
            instance: placed.placement.instance,
            first_triangle: triangles.start,
            _pad: 0,
        });
        let end = self.draws.len() as u32;
        let first = placed.run.first_index;
        let indices = first + 3 * triangles.start..first + 3 * triangles.end;
        let (class, base_vertex) = (placed.placement.class, placed.run.first_vertex as i32);
        // Consecutive instances of one mesh share a call.
        match self.calls.last_mut() {
            Some(call) if call.class == class && call.indices == indices => call.draws.end = end,
            _ => self.calls.push(Call { class, indices, base_vertex, draws: end - 1..end }),
        }
    }
}

/// An instance relative to a tile.
struct InstanceTransform<'a> {
    placement: &'a Placement,
    run: &'a MeshRun,
    clip_from_mesh: [DVec4; 3],
    near: f32,
}

/// Ranges of triangles whose chunks may be seen; adjacent ranges are joined.
fn visible_runs(chunks: &[Chunk], frustum: &Frustum) -> Vec<Range<u32>> {
    let mut runs: Vec<Range<u32>> = Vec::new();
    for chunk in chunks.iter().filter(|chunk| frustum.may_show(chunk.middle, chunk.half)) {
        let (begin, end) = (chunk.first_triangle, chunk.first_triangle + chunk.triangles);
        match runs.last_mut() {
            Some(run) if run.end == begin => run.end = end,
            _ => runs.push(begin..end),
        }
    }
    runs
}
