//! Benchmark of atomics at pseudo-random addresses of a buffer. Program: `shaders/gpu/scattered_atomics.wgsl`.
//!
//! Traversals of many views write texels this way (`papers/megaviews`), to buffers that fit the device's caches or do
//! not.

use std::sync::Arc;
use std::time::Instant;

use argus_shaders::gpu::SCATTERED_ATOMICS;
use argus_shaders::layout::gpu::Scatter;
use wgpu::{Buffer, BufferUsages};

use crate::{ComputePipeline, Gpu, GpuError};

/// Operations of an invocation; `EACH` in the program.
const EACH: u64 = 16;

/// Most operations of a dispatch: 2³² invocation indices of [`EACH`] operations.
const MOST: u64 = 1 << 30;

/// Width of the atomics.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Word {
    /// 32 bits.
    Bits32,
    /// 64 bits.
    Bits64,
}

impl Word {
    /// Width in bits.
    pub fn bits(self) -> u32 {
        match self {
            Self::Bits32 => 32,
            Self::Bits64 => 64,
        }
    }
}

/// A buffer, and the program that writes atomic maxima to it.
#[derive(Debug)]
pub struct ScatteredAtomics {
    gpu: Arc<Gpu>,
    word: Word,
    words: u32,
    buffer: Buffer,
    pipeline: ComputePipeline,
    dispatches: u32,
}

impl ScatteredAtomics {
    /// Allocates a zeroed buffer of `bytes`.
    ///
    /// # Errors
    /// [`GpuError::OutOfMemory`] if the buffer exceeds the limits of the device.
    pub fn new(gpu: &Arc<Gpu>, word: Word, bytes: u64) -> Result<Self, GpuError> {
        let limits = gpu.device.limits();
        let most = limits.max_storage_buffer_binding_size.min(limits.max_buffer_size);
        if bytes > most {
            let reason = format!("one binding of the device reaches {most} bytes, not {bytes}");
            return Err(GpuError::OutOfMemory(reason));
        }
        let before = gpu.fault_count();
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_SRC;
        let buffer = gpu.buffer("scattered words", bytes, usage);
        if let Some(fault) = gpu.fault_since(before) {
            return Err(fault);
        }
        let entry = match word {
            Word::Bits32 => "scatter_32",
            Word::Bits64 => "scatter_64",
        };
        Ok(Self {
            gpu: Arc::clone(gpu),
            word,
            words: u32::try_from(bytes * 8 / u64::from(word.bits())).unwrap_or(u32::MAX),
            buffer,
            pipeline: gpu.compute_pipeline(&SCATTERED_ATOMICS, entry),
            dispatches: 0,
        })
    }

    /// Runs one dispatch of about that many operations. Returns milliseconds (of the device's clock if it has one) and
    /// the number of operations.
    ///
    /// # Errors
    /// A fault of the device.
    pub fn run(&mut self, operations: u64) -> Result<(f64, u64), GpuError> {
        // A power of two fills whole rows of workgroups, so the count is exact.
        let invocations = (operations.clamp(EACH * 64, MOST) / EACH).next_power_of_two();
        self.dispatches = self.dispatches.wrapping_add(1);
        let scatter = Scatter { words: self.words, seed: self.dispatches.wrapping_mul(0x9e37_79b9) };
        let name = match self.word {
            Word::Bits32 => "words_32",
            Word::Bits64 => "words_64",
        };
        let mut commands = self.gpu.commands("scattered atomics");
        commands
            .compute("scatter", &self.pipeline)
            .write(name, &self.buffer)
            .immediates(bytemuck::bytes_of(&scatter))
            .dispatch_linear(invocations);
        let begin = Instant::now();
        let stages = commands.submit().wait()?.stages;
        let waited = begin.elapsed().as_secs_f64() * 1e3;
        Ok((stages.first().map_or(waited, |stage| stage.ms), invocations * EACH))
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)] // a test ends at the first thing that goes wrong

    use super::*;
    use crate::GpuOptions;

    #[test]
    fn every_operation_leaves_something_somewhere_in_the_buffer() {
        let gpu = Gpu::new(&GpuOptions::default()).unwrap();
        for (word, bytes) in [(Word::Bits32, 1 << 20), (Word::Bits64, 1 << 20)] {
            let mut atomics = ScatteredAtomics::new(&gpu, word, bytes).unwrap();
            let (ms, operations) = atomics.run(1 << 12).unwrap();
            assert!(ms >= 0.0);
            assert_eq!(operations, 1 << 12);
            let mut commands = gpu.commands("read words");
            let pending = commands.read_buffer(&atomics.buffer, 0..bytes);
            let found = commands.submit().wait().unwrap().take(pending);
            let size = word.bits() as usize / 8;
            let written: Vec<usize> = (0..found.len() / size)
                .filter(|&i| found[i * size..(i + 1) * size].iter().any(|&byte| byte != 0))
                .collect();
            // Of 4096 throws into 131,072 or more words, few meet: at least 98 of 100 have a word of their own.
            assert!(written.len() > 4000 && written.len() <= 4096, "{word:?}: {}", written.len());
            let words = found.len() / size;
            for quarter in 0..4 {
                let in_it = written.iter().filter(|&&at| at * 4 / words == quarter).count();
                assert!((900..1150).contains(&in_it), "{word:?}, quarter {quarter}: {in_it}");
            }
        }
    }

    #[test]
    fn a_buffer_beyond_the_device_is_refused_with_both_sizes() {
        let gpu = Gpu::new(&GpuOptions::default()).unwrap();
        let error = ScatteredAtomics::new(&gpu, Word::Bits32, u64::MAX / 2).unwrap_err().to_string();
        assert!(error.contains("reaches") && error.contains(&(u64::MAX / 2).to_string()), "{error}");
    }
}
