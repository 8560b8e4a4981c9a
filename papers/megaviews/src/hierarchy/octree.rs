//! Builds a sparse voxel octree of the scene's surfaces. Program: `shaders/octree.wgsl`.

use std::sync::Arc;
use std::time::Instant;

use crate::layout::Average;
use crate::programs::OCTREE;
use argus_gpu::wgpu::{Buffer, BufferUsages};

use super::voxelize::{Voxelize, expected_cells};
use super::{HierarchyError, LevelBuffers, LevelBuilder, MAX_DEPTH, RootCube, Triangle, fits, numbered};
use argus_gpu::{ComputePipeline, Gpu, ListScan, Lists, Scan, ScanSums, Sort, SortScratch};

/// Builds octrees. Holds the pipelines.
#[derive(Debug)]
pub struct OctreeBuilder {
    gpu: Arc<Gpu>,
    scan: Scan,
    lists: ListScan,
    sort: Sort,
    levels: LevelBuilder,
    voxelize: Voxelize,
    average_leaves: ComputePipeline,
    average_nodes: ComputePipeline,
    face_leaves: ComputePipeline,
}

/// A sparse voxel octree on the GPU.
///
/// Nodes of all levels are in one array: leaves first, in Morton order, and the root last. Children of a node are
/// consecutive, in the order of their octants. Every leaf is `depth` levels below the root. A node's bounding sphere is
/// that of its cell, which follows from its level and mean position.
#[derive(Debug)]
pub struct Octree {
    /// The root cube.
    pub root: RootCube,
    /// Levels below the root.
    pub depth: u32,
    /// First node and number of nodes of each level, starting with the root.
    pub levels: Vec<[u32; 2]>,
    /// Four words a node: the mean position of its surfaces (f32, in edges of the root), never on the cell's border; and
    /// 256 × first child + a bit for each octant with a child.
    pub nodes: Buffer,
    /// Four f32 a node: the axis of the cone of its normals, and the cosine of the cone's half angle.
    pub cones: Buffer,
    /// A word a node: mean linear reflectance, eight bits a channel, red lowest.
    pub colors: Buffer,
    /// An f32 a node: area of its surfaces, in squared edges of the root.
    pub weights: Buffer,
    /// A word a node: the Morton code of its cell.
    pub codes: Buffer,
    /// Two words a leaf, made by [`OctreeBuilder::build_faced`]: the triangle that it shows from the front, and the one
    /// that it shows from the back. Indices count triangles with an area.
    pub facing: Option<Buffer>,
    /// Times of the build steps.
    pub times: OctreeTimes,
}

/// Times of the build steps of an octree, milliseconds of wall time.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct OctreeTimes {
    /// Upload of the triangles.
    pub upload_ms: f64,
    /// Finding the overlapped cells.
    pub voxelise_ms: f64,
    /// Sorting the cells.
    pub sort_ms: f64,
    /// Making and averaging nodes.
    pub nodes_ms: f64,
    /// Total.
    pub total_ms: f64,
}

impl OctreeBuilder {
    /// Makes the pipelines.
    pub fn new(gpu: &Arc<Gpu>) -> Self {
        Self {
            scan: Scan::new(gpu),
            lists: ListScan::new(gpu),
            sort: Sort::new(gpu),
            levels: LevelBuilder::new(gpu),
            voxelize: Voxelize::new(gpu),
            average_leaves: gpu.compute_pipeline(&OCTREE, "average_leaves"),
            average_nodes: gpu.compute_pipeline(&OCTREE, "average_nodes"),
            face_leaves: gpu.compute_pipeline(&OCTREE, "face_leaves"),
            gpu: Arc::clone(gpu),
        }
    }

    /// Builds the octree of the triangles with an area, `depth` levels deep (1 to [`MAX_DEPTH`]). They must lie in
    /// `root`.
    ///
    /// # Errors
    /// No triangle has an area, a depth out of range, an array too large for the device, or the device itself.
    pub fn build(
        &self,
        root: RootCube,
        depth: u32,
        triangles: impl IntoIterator<Item = Triangle>,
    ) -> Result<Octree, HierarchyError> {
        self.build_with(root, depth, triangles, false)
    }

    /// Builds the octree with the triangles that each leaf shows to either side ([`Octree::facing`]).
    ///
    /// # Errors
    /// The errors of [`Self::build`].
    pub fn build_faced(
        &self,
        root: RootCube,
        depth: u32,
        triangles: impl IntoIterator<Item = Triangle>,
    ) -> Result<Octree, HierarchyError> {
        self.build_with(root, depth, triangles, true)
    }

    fn build_with(
        &self,
        root: RootCube,
        depth: u32,
        triangles: impl IntoIterator<Item = Triangle>,
        faced: bool,
    ) -> Result<Octree, HierarchyError> {
        if !(1..=MAX_DEPTH).contains(&depth) {
            let range = format!("1 to {MAX_DEPTH}");
            return Err(HierarchyError::OutOfRange { field: "levels", range, value: depth.to_string() });
        }
        let (gpu, begin) = (&self.gpu, Instant::now());
        let ms = |since: Instant| since.elapsed().as_secs_f64() * 1e3;
        let (mut corners, mut colors) = (Vec::<[[f32; 3]; 3]>::new(), Vec::<u32>::new());
        for triangle in triangles.into_iter().filter(Triangle::is_surface) {
            corners.push(triangle.corners.map(|corner| root.unit_from_world(corner).as_vec3().to_array()));
            let byte = |channel: f32| (channel.clamp(0.0, 1.0) * 255.0).round() as u32;
            colors.push(byte(triangle.color.x) | byte(triangle.color.y) << 8 | byte(triangle.color.z) << 16);
        }
        if corners.is_empty() {
            return Err(HierarchyError::Empty);
        }
        fits(gpu, "corners of triangles", corners.len() as u64 * 36)?;
        let count = corners.len() as u32;
        let triangles = gpu.upload("corners of triangles", &corners, BufferUsages::STORAGE);
        let triangle_colors = gpu.upload("colours of triangles", &colors, BufferUsages::STORAGE);
        let upload_ms = ms(begin);

        let began = Instant::now();
        let cells = f64::from(1u32 << depth);
        let expected = corners.iter().map(|corners| expected_cells(corners, cells)).sum();
        let pieces = self.voxelize.run(gpu, &self.lists, &triangles, [count, depth], expected)?;
        let voxelise_ms = ms(began);

        let began = Instant::now();
        let scratch = SortScratch::new(gpu, u64::from(pieces.count));
        let heads = gpu.buffer("heads", u64::from(pieces.count) * 4, BufferUsages::STORAGE);
        let sums = ScanSums::new(gpu, u64::from(pieces.count));
        let mut commands = gpu.commands("sort cells");
        let bits = 32..32 + 3 * depth;
        let sorted = self.sort.run(&mut commands, &self.scan, &pieces.buffer, pieces.count, bits, &scratch);
        self.levels.number_leaves(&mut commands, &self.scan, sorted, pieces.count, &heads, &sums);
        // There are no more leaves than pieces.
        let found = LevelBuffers::new(gpu, u64::from(pieces.count), u64::from(pieces.count));
        self.levels.find_leaves(&mut commands, sorted, pieces.count, depth, &heads, &sums, &found);
        let ranges = commands.read_buffer(&found.levels, 0..u64::from(depth + 1) * 8);
        let ranges = commands.submit().wait()?.take(ranges);
        let levels: Vec<[u32; 2]> = bytemuck::pod_collect_to_vec(&ranges[..8 * (depth as usize + 1)]);
        let leaves = levels[depth as usize][1];
        let sort_ms = ms(began);

        let began = Instant::now();
        let nodes: u64 = levels.iter().map(|level| u64::from(level[1])).sum();
        numbered(nodes)?;
        fits(gpu, "nodes of the octree", nodes * 16)?;
        let made = LevelBuffers::new(gpu, 0, nodes);
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_SRC;
        let octree = Octree {
            root,
            depth,
            levels,
            nodes: gpu.buffer("nodes of the octree", nodes * 16, usage),
            cones: gpu.buffer("normals of the octree", nodes * 16, usage),
            colors: gpu.buffer("colours of the octree", nodes * 4, usage),
            weights: gpu.buffer("weights of the octree", nodes * 4, BufferUsages::STORAGE),
            codes: made.codes.clone(),
            facing: faced
                .then(|| gpu.buffer("faces of leaves", u64::from(leaves) * 8, BufferUsages::STORAGE)),
            times: OctreeTimes::default(),
        };
        let mut commands = gpu.commands("make nodes");
        commands.encoder().copy_buffer_to_buffer(&found.codes, 0, &made.codes, 0, u64::from(leaves) * 4);
        commands.encoder().copy_buffer_to_buffer(&found.levels, 0, &made.levels, 0, found.levels.size());
        let step = |level: u32| Average {
            count: octree.levels[level as usize][1],
            level,
            cells: (1u32 << level) as f32,
        };
        commands
            .compute("average", &self.average_leaves)
            .read("triangles", &triangles)
            .read("triangle_colors", &triangle_colors)
            .read("sorted", sorted)
            .read("starts", &found.starts)
            .read("levels", &made.levels)
            .read("codes", &made.codes)
            .write("nodes", &octree.nodes)
            .write("cones", &octree.cones)
            .write("colors", &octree.colors)
            .write("weights", &octree.weights)
            .immediates(bytemuck::bytes_of(&step(depth)))
            .dispatch_linear(u64::from(leaves));
        if let Some(facing) = &octree.facing {
            commands
                .compute("face leaves", &self.face_leaves)
                .read("triangles", &triangles)
                .read("sorted", sorted)
                .read("starts", &found.starts)
                .read("levels", &made.levels)
                .read("codes", &made.codes)
                .write("facing", facing)
                .immediates(bytemuck::bytes_of(&step(depth)))
                .dispatch_linear(u64::from(leaves));
        }
        let lists = (&self.lists, &Lists::new(gpu, depth + 1, pieces.count));
        for level in (0..depth).rev() {
            self.levels.advance(&mut commands, lists, level + 1, &made);
            self.levels.make_level(&mut commands, lists, level, &heads, &made);
            commands
                .compute("average", &self.average_nodes)
                .read("levels", &made.levels)
                .read("codes", &made.codes)
                .read("first_children", &made.first_children)
                .write("nodes", &octree.nodes)
                .write("cones", &octree.cones)
                .write("colors", &octree.colors)
                .write("weights", &octree.weights)
                .immediates(bytemuck::bytes_of(&step(level)))
                .dispatch_linear(u64::from(octree.levels[level as usize][1]));
        }
        commands.submit().wait()?;
        let times = OctreeTimes { upload_ms, voxelise_ms, sort_ms, nodes_ms: ms(began), total_ms: ms(begin) };
        Ok(Octree { times, ..octree })
    }
}

impl Octree {
    /// Number of nodes of all levels.
    pub fn node_count(&self) -> u32 {
        self.levels.iter().map(|level| level[1]).sum()
    }

    /// Number of leaves.
    pub fn leaf_count(&self) -> u32 {
        self.levels.last().map_or(0, |level| level[1])
    }

    /// Index of the first leaf, and number of leaves.
    pub fn leaves(&self) -> [u32; 2] {
        self.levels.last().copied().unwrap_or_default()
    }

    /// Index of the root.
    pub fn root_node(&self) -> u32 {
        self.node_count() - 1
    }

    /// Bytes on the device.
    pub fn bytes(&self) -> u64 {
        let always = [&self.nodes, &self.cones, &self.colors, &self.weights, &self.codes];
        always.into_iter().chain(&self.facing).map(Buffer::size).sum()
    }
}
