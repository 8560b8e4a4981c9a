//! Visibility by packets of rays on the CPU.
//!
//! [`PacketTracer`] computes the visibility buffer: instance + 1 and primitive of each sub-sample. It needs no GPU. Rows
//! of packets run on rayon's threads. The traversal is compiled twice, with and without AVX2; both give the same bits.

pub(crate) mod cutouts;
pub(crate) mod lanes;
mod lengths;
mod packet;
mod single;

use std::ops::Range;
use std::sync::Arc;
use std::time::Instant;

use argus_scene::Scene;
use argus_shaders::layout::sampler::Rays;
use glam::{DMat3, DVec3, Vec3};
use rayon::prelude::*;
use tracing::info;

use crate::bvh::{Hierarchy, Node, OF_OBJECT, Triangle};
use crate::ray_watch::RayWatch;
use crate::resident::Placement;
use cutouts::Cutouts;
use lanes::{LANES, Lanes, Plain};
pub(crate) use lengths::Ray;
use packet::{Directions, Entry, Leaves, Nearest, Packet};
pub use single::Hit;

/// Rays of a vector: columns, rows.
const VECTOR: [usize; 2] = [4, 2];
/// Vectors of a packet of neighbouring rays of an image: columns, rows.
const PACKET: [usize; 2] = [2, 4];
/// Vectors of a packet.
const VECTORS: usize = PACKET[0] * PACKET[1];
/// Vectors of a packet of scattered rays, which share less.
const SCATTERED: usize = 2;

/// The rays of a tile, all from one eye.
#[derive(Clone, Copy)]
enum Cast<'a> {
    /// Of a pinhole image.
    Image(&'a Rays),
    /// With these directions, row by row, in rows of so many; zero for no ray.
    Listed(&'a [[f32; 4]], usize),
}

/// Traces a scene.
pub struct PacketTracer {
    hierarchy: Hierarchy,
    cutouts: Arc<Cutouts>,
    /// Distance of the near plane along the view's axis, metres, as in the rasteriser.
    near: f32,
}

/// The scene relative to an eye.
struct About<'a> {
    tracer: &'a PacketTracer,
    top: Vec<Node>,
    objects: Vec<ObjectAbout>,
    /// Is told of the rays of images.
    watch: Option<&'a dyn RayWatch>,
}

/// A placed object relative to an eye.
struct ObjectAbout {
    root: u32,
    /// Instance of all its triangles, or [`OF_OBJECT`].
    instance: u32,
    /// Rows of the transform of directions; `None` for the identity.
    object_from_world: Option<[[f32; 3]; 3]>,
    eye: [f32; 3],
}

impl PacketTracer {
    /// Builds the hierarchy of a scene with these instances. `near` is the distance of the near plane, metres.
    pub fn new(scene: &Arc<Scene>, placements: &[Placement], near: f32) -> Self {
        let begin = Instant::now();
        let hierarchy = Hierarchy::new(scene, placements);
        let (triangles, objects) = (hierarchy.triangles.len(), hierarchy.placed.len());
        info!(ms = begin.elapsed().as_secs_f64() * 1e3, triangles, objects, "hierarchy built");
        Self { hierarchy, cutouts: Arc::new(Cutouts::new(scene)), near }
    }

    /// Builds a hierarchy as [`Self::new`] does. Its packets also meet surfaces that hide a part of what is behind them.
    pub(crate) fn meeting_any(scene: &Arc<Scene>, placements: &[Placement], near: f32) -> Self {
        let mut cutouts = Cutouts::new(scene);
        cutouts.least = f32::MIN_POSITIVE;
        Self { cutouts: Arc::new(cutouts), ..Self::new(scene, placements, near) }
    }

    /// The hierarchy.
    pub(crate) fn hierarchy(&self) -> &Hierarchy {
        &self.hierarchy
    }

    /// Textures and coordinates for alpha tests.
    pub(crate) fn cutouts(&self) -> &Arc<Cutouts> {
        &self.cutouts
    }

    /// Reads alpha and transmission from another scene, whose triangles are the same.
    pub(crate) fn set_scene(&mut self, scene: &Arc<Scene>) {
        let mut cutouts = Cutouts::new(scene);
        cutouts.least = self.cutouts.least;
        self.cutouts = Arc::new(cutouts);
    }

    /// Moves instances.
    pub(crate) fn pose(&mut self, scene: &Scene, placements: &[Placement]) {
        self.hierarchy.pose(scene, placements);
    }

    /// Ids of every sub-sample of a tile from `eye`, row by row.
    pub(crate) fn trace(&self, eye: DVec3, rays: &Rays) -> Vec<[u32; 2]> {
        self.trace_watched(eye, rays, None)
    }

    /// Ids as of [`Self::trace`]. `watch` is told of the rays.
    pub(crate) fn trace_watched(
        &self,
        eye: DVec3,
        rays: &Rays,
        watch: Option<&dyn RayWatch>,
    ) -> Vec<[u32; 2]> {
        let size = [rays.width, rays.height].map(|side| side as usize);
        self.trace_cast(eye, Cast::Image(rays), size, watch)
    }

    /// Ids of what rays from `eye` meet whose directions are listed row by row, in rows of `width`. A direction of zero meets
    /// nothing.
    pub(crate) fn trace_listed(&self, eye: DVec3, directions: &[[f32; 4]], width: u32) -> Vec<[u32; 2]> {
        let width = width.max(1) as usize;
        self.trace_cast(eye, Cast::Listed(directions, width), [width, directions.len() / width], None)
    }

    fn trace_cast(
        &self,
        eye: DVec3,
        cast: Cast<'_>,
        [width, height]: [usize; 2],
        watch: Option<&dyn RayWatch>,
    ) -> Vec<[u32; 2]> {
        let about = About { watch, ..About::new(self, eye) };
        let mut ids = vec![[0; 2]; width * height];
        let rows = VECTOR[1] * PACKET[1];
        ids.par_chunks_mut((width * rows).max(1)).enumerate().for_each_init(
            Vec::new,
            |stack, (strip, out)| {
                about.strip(cast, width, strip * rows, out, stack);
            },
        );
        ids
    }

    /// Ids of some sub-samples (column, row) of a tile from `eye`, in order. Neighbours in the list should be neighbours
    /// in the image.
    pub(crate) fn trace_some(&self, eye: DVec3, rays: &Rays, places: &[[u32; 2]]) -> Vec<[u32; 2]> {
        let about = About::new(self, eye);
        let mut ids = vec![[0; 2]; places.len()];
        let share = 64 * LANES * SCATTERED;
        ids.par_chunks_mut(share)
            .zip(places.par_chunks(share))
            .for_each_init(Vec::new, |stack, (out, places)| about.scattered(rays, places, out, stack));
        ids
    }
}

impl<'a> About<'a> {
    fn new(tracer: &'a PacketTracer, eye: DVec3) -> Self {
        let hierarchy = &tracer.hierarchy;
        let objects = hierarchy.placed.iter().map(|placed| {
            let m = placed.object_from_world;
            ObjectAbout {
                root: hierarchy.objects[placed.object as usize].root,
                instance: placed.instance,
                object_from_world: (m != DMat3::IDENTITY)
                    .then(|| [0, 1, 2].map(|row| m.row(row).as_vec3().to_array())),
                eye: (m * (eye - placed.origin)).as_vec3().to_array(),
            }
        });
        Self { tracer, top: hierarchy.top_about(eye), objects: objects.collect(), watch: None }
    }

    /// Traces rows of sub-samples from `first_row` on.
    fn strip(
        &self,
        cast: Cast<'_>,
        width: usize,
        first_row: usize,
        out: &mut [[u32; 2]],
        stack: &mut Vec<u32>,
    ) {
        #[cfg(target_arch = "x86_64")]
        {
            use lanes::avx2::Avx2;

            #[target_feature(enable = "avx2")]
            fn with_avx2(
                about: &About<'_>,
                cast: Cast<'_>,
                width: usize,
                first_row: usize,
                out: &mut [[u32; 2]],
                stack: &mut Vec<u32>,
            ) {
                about.strip_by::<Avx2>(cast, width, first_row, out, stack);
            }
            if is_x86_feature_detected!("avx2") {
                // SAFETY: the processor has what the function is compiled for.
                return unsafe { with_avx2(self, cast, width, first_row, out, stack) };
            }
        }
        self.strip_by::<Plain>(cast, width, first_row, out, stack);
    }

    #[inline(always)]
    fn strip_by<L: Lanes>(
        &self,
        cast: Cast<'_>,
        width: usize,
        first_row: usize,
        out: &mut [[u32; 2]],
        stack: &mut Vec<u32>,
    ) {
        let rows = out.len() / width;
        // Rays beyond the image repeat its last rays.
        let column_of = |base: usize, v: usize, i: usize| base + v % PACKET[0] * VECTOR[0] + i % VECTOR[0];
        let row_of = |v: usize, i: usize| v / PACKET[0] * VECTOR[1] + i / VECTOR[0];
        for base in (0..width).step_by(VECTOR[0] * PACKET[0]) {
            let mut packet = [[L::splat(0.0); 3]; VECTORS];
            for (v, packet) in packet.iter_mut().enumerate() {
                let place =
                    |i: usize| [column_of(base, v, i).min(width - 1), first_row + row_of(v, i).min(rows - 1)];
                *packet = match cast {
                    Cast::Image(rays) => {
                        let places: [[usize; 2]; LANES] = std::array::from_fn(place);
                        let [column, row] = [0, 1].map(|axis| places.map(|place| place[axis] as f32));
                        directions(rays, L::from_array(column), L::from_array(row))
                    }
                    Cast::Listed(directions, width) => {
                        let listed: [[f32; 4]; LANES] = std::array::from_fn(|i| {
                            let [column, row] = place(i);
                            directions[row * width + column]
                        });
                        [0, 1, 2].map(|axis| L::from_array(listed.map(|direction| direction[axis])))
                    }
                };
            }
            let mut nearest = Nearest::none();
            self.packet(&packet, &mut nearest, stack);
            for (v, directions) in packet.iter().enumerate() {
                for i in 0..LANES {
                    let (column, row) = (column_of(base, v, i), row_of(v, i));
                    if column < width && row < rows {
                        out[row * width + column] = nearest.ids[v][i];
                    }
                }
                if let Some(watch) = self.watch {
                    let [x, y, z] = directions.map(|along| along.to_array());
                    let length = nearest.t[v].to_array();
                    (0..LANES).for_each(|i| watch.cast(Vec3::ZERO, Vec3::new(x[i], y[i], z[i]), length[i]));
                }
            }
        }
    }

    /// Traces a list of sub-samples.
    fn scattered(&self, rays: &Rays, places: &[[u32; 2]], out: &mut [[u32; 2]], stack: &mut Vec<u32>) {
        #[cfg(target_arch = "x86_64")]
        {
            use lanes::avx2::Avx2;

            #[target_feature(enable = "avx2")]
            fn with_avx2(
                about: &About<'_>,
                rays: &Rays,
                places: &[[u32; 2]],
                out: &mut [[u32; 2]],
                stack: &mut Vec<u32>,
            ) {
                about.scattered_by::<Avx2>(rays, places, out, stack);
            }
            if is_x86_feature_detected!("avx2") {
                // SAFETY: the processor has what the function is compiled for.
                return unsafe { with_avx2(self, rays, places, out, stack) };
            }
        }
        self.scattered_by::<Plain>(rays, places, out, stack);
    }

    #[inline(always)]
    fn scattered_by<L: Lanes>(
        &self,
        rays: &Rays,
        places: &[[u32; 2]],
        out: &mut [[u32; 2]],
        stack: &mut Vec<u32>,
    ) {
        let share = LANES * SCATTERED;
        for (places, out) in places.chunks(share).zip(out.chunks_mut(share)) {
            let last = places.len() - 1;
            let mut packet = [[L::splat(0.0); 3]; SCATTERED];
            for (v, packet) in packet.iter_mut().enumerate() {
                let (mut column, mut row) = ([0.0; LANES], [0.0; LANES]);
                for i in 0..LANES {
                    let place = places[(v * LANES + i).min(last)];
                    (column[i], row[i]) = (place[0] as f32, place[1] as f32);
                }
                *packet = directions(rays, L::from_array(column), L::from_array(row));
            }
            let mut nearest = Nearest::none();
            self.packet(&packet, &mut nearest, stack);
            for (at, out) in out.iter_mut().enumerate() {
                *out = nearest.ids[at / LANES][at % LANES];
            }
        }
    }

    /// Traces a packet through the top tree and the objects that it hits.
    #[inline(always)]
    fn packet<L: Lanes, const V: usize>(
        &self,
        directions: &[Directions<L>; V],
        nearest: &mut Nearest<L, V>,
        stack: &mut Vec<u32>,
    ) {
        let near = self.tracer.near;
        if let [object] = &self.objects[..] {
            return self.object(object, directions, nearest, stack);
        }
        if self.objects.is_empty() {
            return;
        }
        let packet = Packet::new([0.0; 3], directions);
        // Each object is traversed with its own stack when the top tree reaches it.
        let mut objects = Objects { about: self, directions, stack: Vec::new() };
        packet.walk(&self.top, 0, near, nearest, stack, &mut objects);
    }

    #[inline(always)]
    fn object<L: Lanes, const V: usize>(
        &self,
        object: &ObjectAbout,
        directions: &[Directions<L>; V],
        nearest: &mut Nearest<L, V>,
        stack: &mut Vec<u32>,
    ) {
        let PacketTracer { hierarchy, cutouts, near } = self.tracer;
        let mut turned = *directions;
        if let Some(rows) = &object.object_from_world {
            for (v, turned) in turned.iter_mut().enumerate() {
                for (axis, row) in rows.iter().enumerate() {
                    let [x, y, z] = directions[v];
                    turned[axis] = x * L::splat(row[0]) + y * L::splat(row[1]) + z * L::splat(row[2]);
                }
            }
        }
        let packet = Packet::new(object.eye, &turned);
        let mut triangles =
            Triangles { triangles: &hierarchy.triangles, instance: object.instance, near: *near, cutouts };
        packet.walk(&hierarchy.nodes, object.root, *near, nearest, stack, &mut triangles);
    }
}

/// Leaves of the top tree.
struct Objects<'a, L, const V: usize> {
    about: &'a About<'a>,
    directions: &'a [Directions<L>; V],
    stack: Vec<u32>,
}

impl<L: Lanes, const V: usize> Leaves<L, V> for Objects<'_, L, V> {
    #[inline(always)]
    fn visit(&mut self, _: &Packet<L, V>, items: Range<usize>, _: &Entry<L, V>, nearest: &mut Nearest<L, V>) {
        for object in &self.about.objects[items] {
            self.about.object(object, self.directions, nearest, &mut self.stack);
        }
    }
}

/// Leaves of an object's tree.
struct Triangles<'a> {
    triangles: &'a [Triangle],
    instance: u32,
    near: f32,
    cutouts: &'a Cutouts,
}

impl<L: Lanes, const V: usize> Leaves<L, V> for Triangles<'_> {
    #[inline(always)]
    fn visit(
        &mut self,
        packet: &Packet<L, V>,
        items: Range<usize>,
        entry: &Entry<L, V>,
        nearest: &mut Nearest<L, V>,
    ) {
        for triangle in &self.triangles[items] {
            let instance = if triangle.instance == OF_OBJECT { self.instance } else { triangle.instance };
            let ids = [instance + 1, triangle.primitive];
            packet.meet(triangle, ids, self.near, entry, nearest, self.cutouts);
        }
    }
}

/// Rays through the centres of sub-samples, with unit depth along the view's axis, as `ray_through` in
/// `shaders/shared/rays.wgsl`.
#[inline(always)]
fn directions<L: Lanes>(rays: &Rays, column: L, row: L) -> Directions<L> {
    let (x, y) = (column + L::splat(0.5), row + L::splat(0.5));
    let mut directions = [x; 3];
    for (axis, direction) in directions.iter_mut().enumerate() {
        let (right, down) = (L::splat(rays.right[axis]), L::splat(rays.down[axis]));
        *direction = L::splat(rays.top_left[axis]) + x * right + y * down;
    }
    directions
}
