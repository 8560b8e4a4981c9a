//! Points on surfaces that are shaded without what depends on the viewer: for reflection probes, and for what direct views reflect.

use argus_gpu::{Gpu, wgpu};
use argus_scene::camera::Face;
use argus_scene::rgb9e5;
use argus_shaders::layout::sampler::{LEAF_BLOCK, LeafChunk, ProbePoint};
use bytemuck::Zeroable;
use bytes::Bytes;
use glam::{DMat3, DVec2, DVec3, Vec3};
use rayon::prelude::*;

use crate::frame::{Footprint, LightSharing};
use crate::tile::Tile;

/// Columns and most rows of the image that points are shaded in.
pub const CHUNK_SIDE: u32 = 1024;

/// A surface that is to be shaded.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfacePoint {
    /// Index into [`argus_scene::Scene::instances`].
    pub instance: u32,
    /// Index of the triangle in its mesh.
    pub primitive: u32,
    /// Weights of the mesh's second and third corner.
    pub weights: [f64; 2],
    /// Metres, world space.
    pub position: DVec3,
    /// The side that is seen.
    pub side: Side,
    /// Two edges of the area that it stands for, metres, world space.
    pub footprint: [DVec3; 2],
}

/// A side of a triangle.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Side {
    /// Its corners run counter-clockwise.
    Front,
    /// They run clockwise.
    Back,
}

/// Points to be shaded.
#[derive(Default)]
pub struct Points {
    /// Squares of [`LEAF_BLOCK`]² consecutive points are squares of the images that they are shaded in.
    pub all: Vec<ProbePoint>,
    /// Where all are neighbours in one image, and share light: its first column and row, and its columns and rows, which are
    /// multiples of [`LEAF_BLOCK`]. Otherwise consecutive points are neighbours in space.
    pub image: Option<[[u32; 2]; 2]>,
}

/// A texel of the G-buffer (`shaders/shared/g_buffer.wgsl`): surface and material.
pub(crate) type GBufferTexel = [[u32; 4]; 2];

/// What is known of points once they are shaded.
#[derive(Default)]
pub(crate) struct ShadedPoints {
    pub(crate) radiance: Vec<Vec3>,
    /// The texel of each; empty unless they were asked for.
    pub(crate) g_buffer: Vec<GBufferTexel>,
}

impl ShadedPoints {
    /// Points with the words of their radiance.
    pub(crate) fn new(radiance: &[u8], g_buffer: Vec<GBufferTexel>) -> Self {
        let words = radiance.as_chunks::<4>().0.iter();
        Self { radiance: words.map(|word| rgb9e5::decode(u32::from_le_bytes(*word))).collect(), g_buffer }
    }
}

/// Points that are shaded in one submission.
pub(crate) struct PointChunk {
    /// The image that they are shaded in, as a tile.
    pub(crate) tile: Tile,
    /// Its points.
    pub(crate) range: std::ops::Range<u32>,
    /// Uniform.
    pub(crate) chunk: wgpu::Buffer,
}

impl Points {
    /// Where an image has no point.
    pub const NOTHING: ProbePoint = ProbePoint {
        instance: u32::MAX,
        primitive: 0,
        width: 0.0,
        front: 0,
        position: [0.0; 3],
        across: 0.0,
    };

    /// Which sub-samples share light.
    pub(crate) fn sharing(&self) -> LightSharing {
        if self.image.is_some() { LightSharing::Image } else { LightSharing::Leaves }
    }

    /// The images that the points are shaded in.
    pub(crate) fn chunks(&self, gpu: &Gpu) -> Vec<PointChunk> {
        let count = self.all.len() as u32;
        let chunk = |first: u32, begin: [u32; 2], size: [u32; 2]| {
            let params = LeafChunk { size, first, leaves: count, ..LeafChunk::zeroed() };
            let chunk = gpu.upload("points", &[params], wgpu::BufferUsages::UNIFORM);
            let range = first..count.min(first + size[0] * size[1]);
            PointChunk { tile: Tile { begin, ..image_of(size) }, range, chunk }
        };
        if let Some([begin, size]) = self.image {
            return vec![chunk(0, begin, size)];
        }
        let most = CHUNK_SIDE * CHUNK_SIDE;
        let of_list = |first: u32| {
            let rows = most.min(count - first).div_ceil(CHUNK_SIDE);
            chunk(first, [0, 0], [CHUNK_SIDE, rows.next_multiple_of(LEAF_BLOCK)])
        };
        (0..count).step_by(most as usize).map(of_list).collect()
    }
}

/// The image that points are shaded in, as a tile. Its rays are not used.
pub fn image_of(size: [u32; 2]) -> Tile {
    let (tan_half_fov, tan_center) = (DVec2::ONE, DVec2::ZERO);
    let face = Face { view_from_world: DMat3::IDENTITY, tan_half_fov, tan_center, offset: [0, 0], size };
    Tile { face, begin: [0, 0], size, side: 1 }
}

/// A surface for the device, relative to a place.
pub fn probe_point(point: &SurfacePoint, middle: DVec3) -> ProbePoint {
    let [first, second] = point.footprint.map(DVec3::length);
    ProbePoint {
        instance: point.instance,
        primitive: point.primitive,
        width: first as f32,
        front: u32::from(point.side == Side::Front),
        position: (point.position - middle).as_vec3().to_array(),
        across: (first * second).sqrt() as f32,
    }
}

impl PointChunk {
    /// The texels of its points, of the G-buffer that was read back for its image: surfaces and materials.
    pub(crate) fn g_buffer(&self, read: &[Bytes; 2]) -> impl IndexedParallelIterator<Item = GBufferTexel> {
        let texel = |point: u32| {
            let at = 16 * self.place_of(point);
            [0, 1].map(|which| bytemuck::pod_read_unaligned(&read[which][at..at + 16]))
        };
        self.range.clone().into_par_iter().with_min_len(4096).map(texel)
    }

    /// The areas of points that stand for more than none, in the order of the image's sub-samples.
    pub(crate) fn footprint(&self, points: &[ProbePoint]) -> Footprint {
        let [columns, rows] = self.tile.size;
        let of_points = &points[self.range.start as usize..self.range.end as usize];
        let across = |at: u32| {
            let index = index_in_blocks([at % columns, at / columns], columns);
            of_points.get(index).map_or(0.0, |point| point.across)
        };
        Footprint::Areas((0..columns * rows).into_par_iter().with_min_len(4096).map(across).collect())
    }

    /// Where the image has a point: the number of its sub-sample, row by row. The inverse of `leaf_side` in
    /// `shaders/shared/surfel.wgsl`.
    fn place_of(&self, point: u32) -> usize {
        let index = point - self.range.start;
        place_in_blocks(index, self.tile.size[0])
    }
}

/// The number, row by row, of the texel at an index of an image of so many columns that is stored in squares of
/// [`LEAF_BLOCK`]² texels.
fn place_in_blocks(index: u32, columns: u32) -> usize {
    let (block, within) = (index / LEAF_BLOCK.pow(2), index % LEAF_BLOCK.pow(2));
    let in_row = columns / LEAF_BLOCK;
    let (x, y) = (block % in_row, block / in_row);
    let [column, row] = [x * LEAF_BLOCK + within % LEAF_BLOCK, y * LEAF_BLOCK + within / LEAF_BLOCK];
    (row * columns + column) as usize
}

/// The inverse of [`place_in_blocks`].
pub(crate) fn index_in_blocks([column, row]: [u32; 2], columns: u32) -> usize {
    let block = row / LEAF_BLOCK * (columns / LEAF_BLOCK) + column / LEAF_BLOCK;
    (block * LEAF_BLOCK.pow(2) + row % LEAF_BLOCK * LEAF_BLOCK + column % LEAF_BLOCK) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_texel_of_an_image_has_one_index_and_squares_are_consecutive() {
        let columns = 48;
        let places: Vec<usize> = (0..48 * 32).map(|index| place_in_blocks(index, columns)).collect();
        let back =
            |place: &usize| index_in_blocks([*place as u32 % columns, *place as u32 / columns], columns);
        assert!(places.iter().map(back).eq(0..48 * 32));
        assert_eq!(places[..17], [&(0..16).collect::<Vec<_>>()[..], &[48]].concat());
        assert_eq!(places[256], 16, "the next square is to the right");
    }
}
