//! The trees of cuts. Program: `shaders/cut_tree.wgsl`.

use std::sync::Arc;

use crate::layout::CellStep;
use crate::programs::CUT_TREE;
use argus_gpu::wgpu::{Buffer, BufferUsages};

use crate::SphereHierarchy;
use argus_gpu::Gpu;
use argus_megaviews::hierarchy::{HierarchyError, Octree, RootCube, fits};

/// A bounding-sphere tree over a scene, from an octree or a sphere hierarchy. It shares their arrays, so updates of a
/// sphere hierarchy apply to it.
#[derive(Debug, Clone)]
pub struct CutTree {
    pub(crate) root: RootCube,
    /// Index of the root.
    pub(crate) root_node: u32,
    /// Levels below the root.
    pub(crate) depth: u32,
    /// Mean position and links to children.
    pub(crate) nodes: Buffer,
    /// Spheres: centre and radius.
    pub(crate) spheres: Buffer,
    pub(crate) cones: Buffer,
    pub(crate) parents: Buffer,
    /// Accumulated motion of the spheres.
    pub(crate) moved: Buffer,
    /// Whether leaves are surface points; otherwise cells.
    pub(crate) surfels: bool,
}

impl CutTree {
    /// The spheres around an octree's cells.
    ///
    /// # Errors
    /// An array too large for the device, or the device itself.
    pub fn of_octree(gpu: &Arc<Gpu>, octree: &Octree) -> Result<Self, HierarchyError> {
        let nodes = u64::from(octree.node_count());
        fits(gpu, "spheres of the octree", nodes * 16)?;
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_SRC;
        let tree = Self {
            root: octree.root,
            root_node: octree.root_node(),
            depth: octree.depth,
            nodes: octree.nodes.clone(),
            spheres: gpu.buffer("spheres of the octree", nodes * 16, usage),
            cones: octree.cones.clone(),
            parents: gpu.buffer("parents of the octree", nodes * 4, usage),
            moved: gpu.upload("motion of spheres", &[0u32; 4], usage),
            surfels: false,
        };
        let pipeline = gpu.compute_pipeline(&CUT_TREE, "cells");
        let mut commands = gpu.commands("spheres of the octree");
        for (level, [first, count]) in (0u32..).zip(&octree.levels) {
            let step = CellStep {
                count: *count,
                first: *first,
                cells: (1u32 << level) as f32,
                pad: 2e-6 * (1 + octree.depth - level) as f32,
            };
            commands
                .compute("spheres of the octree", &pipeline)
                .read("nodes", &tree.nodes)
                .write("spheres", &tree.spheres)
                .write("parents", &tree.parents)
                .immediates(bytemuck::bytes_of(&step))
                .dispatch_linear(u64::from(*count));
        }
        commands.submit().wait()?;
        Ok(tree)
    }

    /// A sphere hierarchy.
    pub fn of_spheres(tree: &SphereHierarchy) -> Self {
        Self {
            root: tree.root,
            root_node: 0,
            depth: tree.depth,
            nodes: tree.nodes.clone(),
            spheres: tree.spheres.clone(),
            cones: tree.cones.clone(),
            parents: tree.parents.clone(),
            moved: tree.moved.clone(),
            surfels: true,
        }
    }

    /// Number of nodes of all levels.
    pub(crate) fn node_count(&self) -> u32 {
        (self.nodes.size() / 16) as u32
    }

    /// The root cube that coordinates are relative to.
    pub fn root(&self) -> &RootCube {
        &self.root
    }

    /// Centre and radius of each node's sphere, edges of the root: four f32.
    pub fn spheres(&self) -> &Buffer {
        &self.spheres
    }

    /// Mean position (three f32, edges of the root) and links (256 × first child + a bit a child) of each node.
    pub fn nodes(&self) -> &Buffer {
        &self.nodes
    }

    /// Index of the root.
    pub fn root_node(&self) -> u32 {
        self.root_node
    }
}
