//! Buffers of cuts, which are kept from frame to frame.

use argus_gpu::wgpu::{Buffer, BufferUsages};

use crate::counters::WORDS;
use argus_gpu::Gpu;
use argus_megaviews::hierarchy::HierarchyError;

/// Entries of a chunk. A workgroup tests one chunk.
pub(crate) const CHUNK: u32 = 64;
/// Extra chunks, since each bin may leave a chunk partly empty.
const SPARE: u32 = 1024;

/// Buffers of the cuts of all views.
#[derive(Debug)]
pub(crate) struct Pool {
    /// Capacity of each queue and of the cuts, entries.
    pub(crate) capacity: u32,
    /// Number of chunks.
    pub(crate) chunk_count: u32,
    /// Entries of the cuts, by chunk: node, view and generation.
    pub(crate) entries: Buffer,
    /// Due time and number of entries of each chunk.
    pub(crate) chunks: Buffer,
    /// Stack of empty chunks.
    pub(crate) free: Buffer,
    /// Due chunks of the frame.
    pub(crate) due: Buffer,
    /// Entries of the frame that are not sorted yet.
    pub(crate) settled: Buffer,
    /// Bin of each settled entry, and its number within the bin.
    pub(crate) slots: Buffer,
    /// Nodes to divide: the queue that is read, and the one that is filled, alternating.
    pub(crate) queues: [Buffer; 2],
    /// Counters of the frame.
    pub(crate) counters: Buffer,
    /// Clock, free chunks and prediction of motion.
    pub(crate) state: Buffer,
    /// Arguments of indirect dispatches.
    pub(crate) arguments: Buffer,
}

/// Largest capacity of a pool whose arrays fit the device's limits, entries.
pub(crate) fn most_entries(gpu: &Gpu) -> u32 {
    let all = (gpu.largest_array() / 8).min(1 << 30) as u32;
    (all - SPARE * CHUNK).min(all / 8 * 7)
}

impl Pool {
    /// Allocates buffers for `capacity` entries. `ordered`: entries are sorted, which needs further arrays.
    ///
    /// # Errors
    /// An array too large for the device.
    pub(crate) fn new(gpu: &Gpu, capacity: u32, ordered: bool) -> Result<Self, HierarchyError> {
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
        let sorted = if ordered { capacity } else { 1 };
        Ok(Self {
            capacity,
            chunk_count,
            entries: array("cuts", chunk_count * CHUNK, 8),
            chunks: array("chunks of cuts", chunk_count, 8),
            free: array("free chunks", chunk_count, 4),
            due: array("due chunks", chunk_count, 8),
            settled: array("settled nodes", sorted, 8),
            slots: array("slots of settled nodes", sorted, 4),
            queues: [array("nodes to divide", capacity, 8), array("nodes to divide", capacity, 8)],
            counters: array("counters of cuts", WORDS, 4),
            state: array("clock of cuts", 16, 4),
            arguments: gpu.buffer("workgroups", 64, usage | BufferUsages::INDIRECT),
        })
    }

    /// Bytes of all large buffers.
    pub(crate) fn bytes(&self) -> u64 {
        let [a, b] = &self.queues;
        let all = [&self.entries, &self.chunks, &self.free, &self.due, &self.settled, &self.slots, a, b];
        all.into_iter().map(Buffer::size).sum()
    }
}
