//! Where cuts are kept from frame to frame.

use wgpu::{Buffer, BufferUsages};

use super::counters::WORDS;
use crate::Gpu;
use crate::hierarchy::{HierarchyError, largest_array};

/// Entries of a chunk; a workgroup looks at one.
pub(super) const CHUNK: u32 = 64;
/// Chunks that bins leave half empty, beyond those that entries fill.
const SPARE: u32 = 1024;

/// Memory of the cuts of all views.
#[derive(Debug)]
pub(super) struct Pool {
    /// Entries that the queues hold, and so the cuts.
    pub(super) capacity: u32,
    pub(super) chunk_count: u32,
    pub(super) entries: Buffer,
    pub(super) chunks: Buffer,
    pub(super) free: Buffer,
    pub(super) due: Buffer,
    pub(super) settled: Buffer,
    pub(super) places: Buffer,
    pub(super) queues: [Buffer; 2],
    pub(super) counters: Buffer,
    pub(super) state: Buffer,
    pub(super) arguments: Buffer,
}

/// Most entries that one array of this device holds.
pub(super) fn most_entries(gpu: &Gpu) -> u32 {
    let all = (largest_array(gpu) / 8).min(1 << 30) as u32;
    (all - SPARE * CHUNK).min(all / 8 * 7)
}

impl Pool {
    /// For so many entries; without order it needs less beside them.
    pub(super) fn new(gpu: &Gpu, capacity: u32, ordered: bool) -> Result<Self, HierarchyError> {
        if capacity > most_entries(gpu) {
            return Err(HierarchyError::TooLarge {
                what: "cuts of all views",
                needed: u64::from(capacity) * 8,
                limit: u64::from(most_entries(gpu)) * 8,
            });
        }
        let chunk_count = capacity.div_ceil(CHUNK) + capacity / (8 * CHUNK) + SPARE;
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_SRC | BufferUsages::COPY_DST;
        let array = |label, count: u32, bytes: u64| gpu.buffer(label, u64::from(count.max(1)) * bytes, usage);
        let kept = if ordered { capacity } else { 1 };
        Ok(Self {
            capacity,
            chunk_count,
            entries: array("cuts", chunk_count * CHUNK, 8),
            chunks: array("chunks of cuts", chunk_count, 8),
            free: array("free chunks", chunk_count, 4),
            due: array("due chunks", chunk_count, 8),
            settled: array("settled nodes", kept, 8),
            places: array("places of settled nodes", kept, 4),
            queues: [array("nodes to divide", capacity, 8), array("nodes to divide", capacity, 8)],
            counters: array("counters of cuts", WORDS, 4),
            state: array("clock of cuts", 16, 4),
            arguments: gpu.buffer("workgroups", 64, usage | BufferUsages::INDIRECT),
        })
    }

    /// Bytes of all.
    pub(super) fn bytes(&self) -> u64 {
        let [a, b] = &self.queues;
        let all = [&self.entries, &self.chunks, &self.free, &self.due, &self.settled, &self.places, a, b];
        all.into_iter().map(Buffer::size).sum()
    }
}
