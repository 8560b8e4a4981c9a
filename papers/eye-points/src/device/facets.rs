//! Triangles on the device, in as many arrays as they need, and ranges of them.

use argus_gpu::wgpu::{Buffer, BufferUsages};
use glam::DVec3;

use super::{PointPasses, PointsError, in_two_parts};
use crate::layout::PointFacet;

/// A triangle, for the device.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DeviceFacet {
    /// Metres, world space.
    pub corners: [DVec3; 3],
    /// Index of its instance.
    pub instance: u32,
    /// Whether the back is seen, too.
    pub both_sides: bool,
    /// Whether parts of it are cut out. The device does not splat it.
    pub cutout: bool,
    /// A number in 0..1 that decides whether it is culled.
    pub chance: f32,
}

/// Triangles on the device, in as many arrays as they need.
#[derive(Debug)]
pub struct PointFacets {
    pub(super) chunks: Vec<Buffer>,
    /// Triangles of each chunk but the last.
    each: u32,
    count: u32,
}

impl PointFacets {
    /// The array of all triangles.
    ///
    /// # Errors
    /// There are several arrays.
    pub(crate) fn whole(&self) -> Result<&Buffer, PointsError> {
        match &self.chunks[..] {
            [all] => Ok(all),
            _ => {
                let bytes = |count: u32| u64::from(count) * size_of::<PointFacet>() as u64;
                let (needed, limit) = (bytes(self.count), bytes(self.each));
                Err(PointsError::TooLarge { what: "triangles", needed, limit })
            }
        }
    }

    /// The array that has a range.
    pub(crate) fn chunk(&self, range: FacetRange) -> &Buffer {
        &self.chunks[range.chunk]
    }

    /// Index of the first triangle of a chunk.
    pub(crate) fn first_of(&self, chunk: usize) -> u32 {
        chunk as u32 * self.each
    }
}

/// Triangles that are cut together, of one chunk.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FacetRange {
    /// Index of the chunk.
    pub chunk: usize,
    /// First triangle in the chunk.
    pub first: u32,
    /// Number of triangles.
    pub count: u32,
}

impl FacetRange {
    /// Two halves; `None` for a single triangle.
    pub fn halves(self) -> Option<[Self; 2]> {
        let half = self.count / 2;
        (half > 0).then_some([
            Self { count: half, ..self },
            Self { first: self.first + half, count: self.count - half, ..self },
        ])
    }
}

impl PointFacets {
    /// A range for each chunk.
    pub fn ranges(&self) -> Vec<FacetRange> {
        let count = |chunk: u32| self.each.min(self.count - chunk * self.each);
        let range = |chunk: usize| FacetRange { chunk, first: 0, count: count(chunk as u32) };
        (0..self.chunks.len()).map(range).filter(|range| range.count > 0).collect()
    }
}

impl PointPasses {
    /// Uploads triangles. `origin` is near them: positions are relative to it.
    pub fn facets(&self, facets: impl Iterator<Item = DeviceFacet>, origin: DVec3) -> PointFacets {
        let facet = |facet: DeviceFacet| {
            let corners = facet.corners;
            let [[a, a_low], [b, b_low], [c, c_low]] = corners.map(|corner| in_two_parts(corner - origin));
            let area = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
            PointFacet {
                a,
                b,
                c,
                a_low,
                b_low,
                c_low,
                normal: area.normalize_or_zero().as_vec3().to_array(),
                instance: facet.instance,
                flags: u32::from(facet.both_sides) | u32::from(facet.cutout) << 1,
                chance: facet.chance,
                area: (0.5 * area.length()) as f32,
                ..bytemuck::Zeroable::zeroed()
            }
        };
        let facets: Vec<PointFacet> = facets.map(facet).collect();
        let each = (self.largest / size_of::<PointFacet>() as u64).clamp(1, 1 << 30) as usize;
        let upload = |chunk: &[PointFacet]| self.gpu.upload("point facets", chunk, BufferUsages::STORAGE);
        let chunks = match facets.is_empty() {
            true => vec![upload(&[])],
            false => facets.chunks(each).map(upload).collect(),
        };
        PointFacets { chunks, each: each as u32, count: facets.len() as u32 }
    }
}
