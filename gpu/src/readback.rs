//! Results on their way back: a pool of mapped buffers, so that a steady stream of frames allocates none.

use std::sync::mpsc;

use argus_scene::Stage;
use bytes::Bytes;
use parking_lot::Mutex;

use crate::timing::Timings;
use crate::{Gpu, GpuError};

/// Buffers that wait for their next use, and the bytes they may occupy together.
#[derive(Debug, Default)]
pub(crate) struct ReadbackPool {
    free: Mutex<Vec<wgpu::Buffer>>,
}

/// Idle bytes beyond which a returned buffer is dropped instead of kept.
const MAX_IDLE_BYTES: u64 = 256 << 20;

impl ReadbackPool {
    /// A mappable buffer of at least `size` bytes: the smallest idle one that is not wastefully large.
    pub(crate) fn take(&self, gpu: &Gpu, size: u64) -> wgpu::Buffer {
        let mut free = self.free.lock();
        let fits = |b: &wgpu::Buffer| b.size() >= size && b.size() <= 4 * size.max(64 << 10);
        let best = (0..free.len()).filter(|&i| fits(&free[i])).min_by_key(|&i| free[i].size());
        if let Some(index) = best {
            return free.swap_remove(index);
        }
        drop(free);
        let usage = wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST;
        gpu.buffer("readback", size.next_power_of_two(), usage)
    }

    fn give_back(&self, buffer: wgpu::Buffer) {
        let mut free = self.free.lock();
        if free.iter().map(wgpu::Buffer::size).sum::<u64>() + buffer.size() <= MAX_IDLE_BYTES {
            free.push(buffer);
        }
    }
}

/// A claim on bytes that a submission will bring back.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct PendingReadback(pub(crate) usize);

/// One pending copy within a readback buffer.
#[derive(Debug)]
pub(crate) struct Copy {
    /// Where its bytes begin in the readback buffer.
    pub(crate) offset: u64,
    /// Bytes of a row, and bytes from row to row; equal where rows are tight.
    pub(crate) row: u64,
    pub(crate) pitch: u64,
    pub(crate) rows: u64,
}

impl Copy {
    pub(crate) fn size(&self) -> u64 {
        self.pitch * self.rows
    }

    /// The copy's bytes without the padding between rows.
    fn unpack(&self, mapped: &[u8]) -> Bytes {
        let begin = self.offset as usize;
        let (row, pitch, rows) = (self.row as usize, self.pitch as usize, self.rows as usize);
        if row == pitch {
            return Bytes::copy_from_slice(&mapped[begin..begin + row * rows]);
        }
        let mut tight = Vec::with_capacity(row * rows);
        for y in 0..rows {
            tight.extend_from_slice(&mapped[begin + y * pitch..][..row]);
        }
        Bytes::from(tight)
    }
}

/// What a submission brought back.
#[derive(Debug)]
pub struct Finished {
    /// GPU time by pass; empty where the device cannot time.
    pub stages: Vec<Stage>,
    results: Vec<Option<Bytes>>,
}

impl Finished {
    /// The bytes of a ticket: rows tightly packed. Empty if they were taken before.
    pub fn take(&mut self, pending: PendingReadback) -> Bytes {
        self.results.get_mut(pending.0).and_then(Option::take).unwrap_or_default()
    }
}

/// How long a callback may be on its way in another thread's poll once the work that it waits for is done.
const CALLBACK_PATIENCE: std::time::Duration = std::time::Duration::from_secs(5);

/// Waits for a submission and copies its results out.
pub(crate) fn collect(
    gpu: &Gpu,
    submission: wgpu::SubmissionIndex,
    buffer: Option<wgpu::Buffer>,
    copies: &[Copy],
    timings: &Timings,
    timestamps: Option<Copy>,
    faults_before: u64,
) -> Result<Finished, GpuError> {
    let (send, receive) = mpsc::channel();
    if let Some(buffer) = &buffer {
        buffer.slice(..).map_async(wgpu::MapMode::Read, move |mapped| {
            // Nobody listens if the wait below failed first; that error is the one that is reported.
            let _ = send.send(mapped);
        });
    }
    let wait = wgpu::PollType::Wait { submission_index: Some(submission), timeout: None };
    gpu.device
        .poll(wait)
        .map_err(|e| gpu.fault_since(faults_before).unwrap_or(GpuError::Lost(e.to_string())))?;
    if let Some(fault) = gpu.fault_since(faults_before) {
        return Err(fault);
    }
    let Some(buffer) = buffer else { return Ok(Finished { stages: Vec::new(), results: Vec::new() }) };
    // The map's callback runs within a poll, this one or that of another thread, which may have taken the callback just
    // before this one looked: it is about to run then, so it is waited for.
    let mapped = receive.recv_timeout(CALLBACK_PATIENCE).or_else(|_| {
        let _ = gpu.device.poll(wgpu::PollType::wait_indefinitely());
        receive.recv_timeout(CALLBACK_PATIENCE)
    });
    let mapped = mapped.map_err(|e| GpuError::Lost(format!("a readback never came: {e}")))?;
    mapped.map_err(|e| gpu.fault_since(faults_before).unwrap_or(GpuError::Lost(e.to_string())))?;
    let finished = {
        let view = buffer.slice(..).get_mapped_range().map_err(|e| GpuError::Lost(e.to_string()))?;
        let results = copies.iter().map(|copy| Some(copy.unpack(&view))).collect();
        let timestamps = timestamps.map(|copy| copy.unpack(&view)).unwrap_or_default();
        timings.passes(&timestamps).for_each(|(name, ms)| gpu.note_pass(name, ms));
        let stages = timings.stages(&timestamps);
        Finished { stages, results }
    };
    buffer.unmap();
    gpu.readback.give_back(buffer);
    Ok(finished)
}
