//! Storage of maps.

use std::sync::Arc;

use argus_gpu::wgpu::{Buffer, BufferUsages};

use super::TexelCode;
use crate::hierarchy::HierarchyError;
use argus_gpu::Gpu;

/// Most arrays that programs bind.
pub(super) const MAX_ARRAYS: u32 = 4;

/// Maps in several arrays, because a binding has at most 128 MiB on some devices.
///
/// Map `m` is in array `m >> shift`, from texel `(m & (2^shift − 1)) · 2 side²`. Texels are laid out as in
/// [`argus_scene::paraboloid`].
#[derive(Debug)]
pub struct MapSet {
    /// The arrays.
    pub arrays: Vec<Buffer>,
    /// Texels on a side of a hemisphere.
    pub side: u32,
    /// Encoding of texels.
    pub code: TexelCode,
    /// Base-2 logarithm of the number of maps in one array.
    pub shift: u32,
    /// Number of maps that fit.
    pub capacity: u32,
    /// Bound in place of unused arrays.
    nothing: Buffer,
}

/// Bytes of one map.
fn map_bytes(side: u32, code: &TexelCode) -> u64 {
    code.bytes(2 * u64::from(side) * u64::from(side))
}

impl MapSet {
    /// Allocates at least `maps` maps.
    ///
    /// # Errors
    /// [`HierarchyError::TooLarge`].
    pub fn new(gpu: &Gpu, side: u32, code: TexelCode, maps: u32) -> Result<Self, HierarchyError> {
        let limit = gpu.largest_array();
        let each = map_bytes(side, &code);
        let shift = (limit / each).max(1).ilog2().min(31);
        let count = (u64::from(maps).max(1)).div_ceil(1 << shift);
        if count > u64::from(MAX_ARRAYS) || each > limit {
            let limit = limit * u64::from(MAX_ARRAYS);
            return Err(HierarchyError::TooLarge {
                what: "maps of all views",
                needed: u64::from(maps) * each,
                limit,
            });
        }
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_SRC | BufferUsages::COPY_DST;
        let size = |index: u64| (u64::from(maps) - (index << shift)).min(1 << shift) * each;
        let arrays = (0..count).map(|index| gpu.buffer("maps", size(index), usage)).collect();
        let nothing = gpu.buffer("no maps", 16, usage);
        Ok(Self { arrays, side, code, shift, capacity: maps, nothing })
    }

    /// Bytes of all arrays.
    pub fn bytes(&self) -> u64 {
        self.arrays.iter().map(Buffer::size).sum()
    }

    /// Reads one map back: for each texel, the bits of its inverse range (f32), and its node or 0.
    ///
    /// # Errors
    /// The device failed.
    pub fn read(&self, gpu: &Arc<Gpu>, map: u32) -> Result<Vec<[u32; 2]>, HierarchyError> {
        let size = map_bytes(self.side, &self.code);
        let at = u64::from(map & ((1u32 << self.shift) - 1)) * size;
        let mut commands = gpu.commands("read map");
        let pending = commands.read_buffer(&self.arrays[(map >> self.shift) as usize], at..at + size);
        let bytes = commands.submit().wait()?.take(pending);
        let words: Vec<u32> = bytemuck::pod_collect_to_vec(&bytes[..size as usize]);
        Ok(self.code.unpack(&words))
    }

    /// Values for the `override`s of `shaders/shared/map_texels.wgsl`.
    pub fn constants(&self) -> [(&'static str, f64); 7] {
        self.code.constants(self.arrays.len())
    }

    /// The arrays by their names in the programs.
    pub(super) fn bindings(&self) -> [(&'static str, &Buffer); 8] {
        let names = ["wide0", "wide1", "wide2", "wide3", "narrow0", "narrow1", "narrow2", "narrow3"];
        let first: usize = if self.code.texel().bits() == 64 { 0 } else { 4 };
        let mut index = 0usize;
        names.map(|name| {
            let array = index.checked_sub(first).and_then(|i| self.arrays.get(i).filter(|_| i < 4));
            index += 1;
            (name, array.unwrap_or(&self.nothing))
        })
    }
}
