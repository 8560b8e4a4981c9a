//! A perfect binary tree of bounding spheres over surface points. Program: `shaders/spheres.wgsl`.

use std::sync::Arc;
use std::time::Instant;

use crate::layout::SphereStep;
use crate::programs::SPHERES;
use argus_gpu::wgpu::{Buffer, BufferUsages};

use crate::surface_samples::{SurfaceSample, surface_samples};
use argus_gpu::{Commands, ComputePipeline, Gpu, Scan, Sort, SortScratch};
use argus_megaviews::hierarchy::{HierarchyError, RootCube, Triangle, fits};

/// Most levels below the root: node indices have 24 bits.
pub const MAX_SPHERE_DEPTH: u32 = 22;

/// Builds sphere trees and refits them to moving triangles. Holds the pipelines.
#[derive(Debug)]
pub struct SphereBuilder {
    gpu: Arc<Gpu>,
    scan: Scan,
    sort: Sort,
    sample_keys: ComputePipeline,
    order_samples: ComputePipeline,
    fit_leaves: ComputePipeline,
    fit_nodes: ComputePipeline,
    sum_moves: ComputePipeline,
}

/// The perfect binary bounding-sphere hierarchy of ManyLoDs (Holländer et al. 2011, section 4).
///
/// Its 2^depth leaves are points of triangles in barycentric coordinates, in the order of a Hilbert curve at the time of
/// the build. Nodes are in heap order: the root is node 0, the children of node n are 2n + 1 and 2n + 2. A node's sphere
/// and cone contain those of its children, with slack for f32 rounding.
#[derive(Debug)]
pub struct SphereHierarchy {
    /// The root cube that coordinates are relative to.
    pub root: RootCube,
    /// Levels below the root.
    pub depth: u32,
    /// Four words a node: the mean position of its leaves (f32, edges of the root); and 256 times its first child plus
    /// 3, or 0 for a leaf.
    pub nodes: Buffer,
    /// Four f32 a node: centre and radius of its sphere, edges of the root.
    pub spheres: Buffer,
    /// Four f32 a node: the axis of the cone of its normals, and the cosine of the cone's half angle.
    pub cones: Buffer,
    /// A word a node: its parent; the root's is itself.
    pub parents: Buffer,
    /// Two monotonic words: the sums over all updates of the largest motion and of the largest change of radius of any
    /// sphere, in 2^-22 edges of the root, rounded up. Two more words are scratch.
    pub moved: Buffer,
    /// Times of the latest build, rebuild or update.
    pub times: SphereTimes,
    samples: Buffer,
    ordered: Buffer,
    corners: Buffer,
    triangles: u32,
}

/// Times of a build or refit, milliseconds of wall time.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SphereTimes {
    /// Choosing points; 0 unless the tree was built.
    pub sample_ms: f64,
    /// Upload of the triangles.
    pub upload_ms: f64,
    /// Sorting the points; 0 in an update.
    pub sort_ms: f64,
    /// Fitting spheres and cones.
    pub fit_ms: f64,
    /// Total.
    pub total_ms: f64,
}

impl SphereBuilder {
    /// Makes the pipelines.
    pub fn new(gpu: &Arc<Gpu>) -> Self {
        let pipeline = |entry| gpu.compute_pipeline(&SPHERES, entry);
        Self {
            scan: Scan::new(gpu),
            sort: Sort::new(gpu),
            sample_keys: pipeline("sample_keys"),
            order_samples: pipeline("order_samples"),
            fit_leaves: pipeline("fit_leaves"),
            fit_nodes: pipeline("fit_nodes"),
            sum_moves: pipeline("sum_moves"),
            gpu: Arc::clone(gpu),
        }
    }

    /// Builds a tree `depth` levels deep (1 to [`MAX_SPHERE_DEPTH`]), with a point a leaf.
    ///
    /// # Errors
    /// No triangle has an area, a depth out of range, an array too large for the device, or the device itself.
    pub fn build(
        &self,
        root: RootCube,
        depth: u32,
        triangles: &[Triangle],
    ) -> Result<SphereHierarchy, HierarchyError> {
        if !(1..=MAX_SPHERE_DEPTH).contains(&depth) {
            let range = format!("1 to {MAX_SPHERE_DEPTH}");
            let value = depth.to_string();
            return Err(HierarchyError::OutOfRange { field: "levels of balls", range, value });
        }
        let (gpu, begin) = (&self.gpu, Instant::now());
        let nodes = (2u64 << depth) - 1;
        fits(gpu, "nodes of the tree of balls", nodes * 16)?;
        fits(gpu, "corners of triangles", triangles.len() as u64 * 36)?;
        let samples = surface_samples(triangles, 1 << depth);
        if samples.is_empty() {
            return Err(HierarchyError::Empty);
        }
        let sample_ms = ms(begin);
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_SRC | BufferUsages::COPY_DST;
        let mut tree = SphereHierarchy {
            root,
            depth,
            nodes: gpu.buffer("nodes of balls", nodes * 16, usage),
            spheres: gpu.buffer("balls", nodes * 16, usage),
            cones: gpu.buffer("normals of balls", nodes * 16, usage),
            parents: gpu.buffer("parents of balls", nodes * 4, usage),
            moved: gpu.buffer("motion of balls", 16, usage),
            times: SphereTimes::default(),
            samples: gpu.upload("points of surfaces", &samples, BufferUsages::STORAGE),
            ordered: gpu.buffer(
                "points in order",
                (samples.len() * size_of::<SurfaceSample>()) as u64,
                usage,
            ),
            corners: gpu.buffer("corners of triangles", (triangles.len() as u64 * 36).max(36), usage),
            triangles: triangles.len() as u32,
        };
        self.rebuild(&mut tree, triangles)?;
        tree.times.sample_ms = sample_ms;
        tree.times.total_ms = ms(begin);
        Ok(tree)
    }

    /// Refits the spheres, bottom-up, to the moved triangles. Points keep their place on the triangles, and the tree its
    /// topology.
    ///
    /// # Errors
    /// The number of triangles differs from the build's, or the device failed.
    pub fn update(&self, tree: &mut SphereHierarchy, triangles: &[Triangle]) -> Result<(), HierarchyError> {
        let begin = Instant::now();
        self.set_corners(tree, triangles)?;
        let upload_ms = ms(begin);
        let began = Instant::now();
        let mut commands = self.gpu.commands("fit balls");
        self.fit(&mut commands, tree);
        commands.submit().wait()?;
        tree.times =
            SphereTimes { upload_ms, fit_ms: ms(began), total_ms: ms(begin), ..SphereTimes::default() };
        Ok(())
    }

    /// Sorts the points again and refits, which makes tighter spheres after large motion.
    ///
    /// # Errors
    /// The errors of [`Self::update`].
    pub fn rebuild(&self, tree: &mut SphereHierarchy, triangles: &[Triangle]) -> Result<(), HierarchyError> {
        let (gpu, begin) = (&self.gpu, Instant::now());
        self.set_corners(tree, triangles)?;
        let upload_ms = ms(begin);

        let began = Instant::now();
        let count = 1u32 << tree.depth;
        let scratch = SortScratch::new(gpu, u64::from(count));
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_SRC;
        let keys = gpu.buffer("cells of points", u64::from(count) * 8, usage);
        let step = SphereStep { count, first: 0 };
        let mut commands = gpu.commands("order points");
        commands
            .compute("order points", &self.sample_keys)
            .read("triangles", &tree.corners)
            .read("samples", &tree.samples)
            .write("keys", &keys)
            .immediates(bytemuck::bytes_of(&step))
            .dispatch_linear(u64::from(count));
        let sorted = self.sort.run(&mut commands, &self.scan, &keys, count, 32..62, &scratch);
        commands
            .compute("order points", &self.order_samples)
            .read("samples", &tree.samples)
            .read("sorted", sorted)
            .write("ordered", &tree.ordered)
            .immediates(bytemuck::bytes_of(&step))
            .dispatch_linear(u64::from(count));
        commands.submit().wait()?;
        let sort_ms = ms(began);

        let began = Instant::now();
        let mut commands = gpu.commands("fit balls");
        self.fit(&mut commands, tree);
        commands.submit().wait()?;
        let fit_ms = ms(began);
        tree.times = SphereTimes { sample_ms: 0.0, upload_ms, sort_ms, fit_ms, total_ms: ms(begin) };
        Ok(())
    }

    /// Fits from the leaves up, then accumulates the motion.
    fn fit(&self, commands: &mut Commands, tree: &SphereHierarchy) {
        for level in (0..=tree.depth).rev() {
            let step = SphereStep { count: 1 << level, first: (1 << level) - 1 };
            let leaves = level == tree.depth;
            let pipeline = if leaves { &self.fit_leaves } else { &self.fit_nodes };
            let mut call = commands.compute("fit balls", pipeline);
            if leaves {
                call = call.read("triangles", &tree.corners).read("samples", &tree.ordered);
            }
            call.write("nodes", &tree.nodes)
                .write("spheres", &tree.spheres)
                .write("cones", &tree.cones)
                .write("parents", &tree.parents)
                .write("moved", &tree.moved)
                .immediates(bytemuck::bytes_of(&step))
                .dispatch_linear(1 << level);
        }
        commands.compute("fit balls", &self.sum_moves).write("moved", &tree.moved).dispatch([1, 1, 1]);
    }

    fn set_corners(&self, tree: &SphereHierarchy, triangles: &[Triangle]) -> Result<(), HierarchyError> {
        if triangles.len() as u32 != tree.triangles {
            return Err(HierarchyError::OutOfRange {
                field: "triangles",
                range: format!("the {} that the tree was made of", tree.triangles),
                value: triangles.len().to_string(),
            });
        }
        // Corners that are not finite are moved to the centre, so that no NaN arises.
        let unit = |corner| {
            let unit = tree.root.unit_from_world(corner).as_vec3();
            if unit.is_finite() { unit.to_array() } else { [0.5; 3] }
        };
        let corners: Vec<[[f32; 3]; 3]> = triangles.iter().map(|t| t.corners.map(unit)).collect();
        self.gpu.queue.write_buffer(&tree.corners, 0, bytemuck::cast_slice(&corners));
        Ok(())
    }
}

impl SphereHierarchy {
    /// Number of nodes of all levels.
    pub fn node_count(&self) -> u32 {
        (2 << self.depth) - 1
    }

    /// Bytes on the device.
    pub fn bytes(&self) -> u64 {
        [&self.nodes, &self.spheres, &self.cones, &self.parents, &self.ordered]
            .into_iter()
            .map(Buffer::size)
            .sum()
    }
}

fn ms(since: Instant) -> f64 {
    since.elapsed().as_secs_f64() * 1e3
}
