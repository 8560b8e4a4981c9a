//! Waits for submissions and reads their results back.

use std::sync::mpsc;

use argus_scene::Stage;
use bytes::Bytes;

use crate::timing::Timings;
use crate::{Gpu, GpuError};

/// A readback of a submission. [`Finished::take`] returns its bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct PendingReadback(pub(crate) usize);

/// One pending copy within a readback buffer.
#[derive(Debug)]
pub(crate) struct Copy {
    /// Offset in the readback buffer, bytes.
    pub(crate) offset: u64,
    /// Bytes of a row, and bytes from one row to the next. Equal if rows are tightly packed.
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

/// The results of a submission.
#[derive(Debug)]
pub struct Finished {
    /// GPU time by pass, milliseconds. Empty without timestamps.
    pub stages: Vec<Stage>,
    results: Vec<Option<Bytes>>,
}

impl Finished {
    /// Takes the bytes of a readback, rows tightly packed. Empty if they were taken before.
    pub fn take(&mut self, pending: PendingReadback) -> Bytes {
        self.results.get_mut(pending.0).and_then(Option::take).unwrap_or_default()
    }
}

/// Most time for another thread's poll to run a map callback, once the work is done.
const CALLBACK_PATIENCE: std::time::Duration = std::time::Duration::from_secs(5);

/// Waits for a submission and copies its results.
pub(crate) fn collect(
    gpu: &Gpu,
    submission: wgpu::SubmissionIndex,
    buffer: Option<wgpu::Buffer>,
    copies: &[Copy],
    timings: &Timings,
    timestamps: Option<Copy>,
    faults_before: u64,
) -> Result<Finished, GpuError> {
    gpu.waits.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
    let (send, receive) = mpsc::channel();
    if let Some(buffer) = &buffer {
        buffer.slice(..).map_async(wgpu::MapMode::Read, move |mapped| {
            // The receiver is gone if the wait below failed first; that error is reported.
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
    // Another thread's poll may run the callback: quirk `late-map-callbacks`.
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
