//! Program: `shaders/own_nodes.wgsl`. Finds octree nodes that belong to one reflector alone, which are culled
//! from its probe.

use crate::hierarchy::Octree;
use crate::layout::OwnLevel;
use crate::programs::OWN_NODES;
use argus_gpu::{Commands, ComputePipeline, Gpu, wgpu};

/// One dispatch a level, once a pose.
pub(crate) struct OwnNodes {
    leaves: ComputePipeline,
    nodes: ComputePipeline,
}

/// Leaves, triangles and the probes of instances.
pub(crate) struct NodeSurfaces<'a> {
    pub(crate) octree: &'a Octree,
    /// For each leaf the triangles that it shows to either side.
    pub(crate) facing: &'a wgpu::Buffer,
    /// For each triangle its instance and its index in the mesh.
    pub(crate) triangle_ids: &'a wgpu::Buffer,
    /// For each instance 1 + the index of its probe; 0 for none.
    pub(crate) probe_of_instance: &'a wgpu::Buffer,
}

impl OwnNodes {
    pub(crate) fn new(gpu: &Gpu) -> Self {
        let pipeline = |entry| gpu.compute_pipeline(&OWN_NODES, entry);
        Self { leaves: pipeline("own_leaves"), nodes: pipeline("own_nodes") }
    }

    /// Returns a word a node: 1 + the index of the reflector that everything in the node belongs to, or 0.
    pub(crate) fn record(&self, gpu: &Gpu, commands: &mut Commands, of: &NodeSurfaces<'_>) -> wgpu::Buffer {
        let NodeSurfaces { octree, facing, triangle_ids, probe_of_instance } = *of;
        let owners =
            gpu.buffer("owners of nodes", u64::from(octree.node_count()) * 4, wgpu::BufferUsages::STORAGE);
        for (up, &[first, count]) in octree.levels.iter().rev().enumerate() {
            let level = OwnLevel { first, count };
            let call = match up {
                0 => commands
                    .compute("own leaves", &self.leaves)
                    .read("facing", facing)
                    .read("triangle_ids", triangle_ids)
                    .read("probe_of_instance", probe_of_instance),
                _ => commands.compute("own nodes", &self.nodes).read("nodes", &octree.nodes),
            };
            call.write("owners", &owners)
                .immediates(bytemuck::bytes_of(&level))
                .dispatch_linear(u64::from(count));
        }
        owners
    }
}
