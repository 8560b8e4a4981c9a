//! A stable radix sort of 64-bit keys. Program: `shaders/gpu/sort.wgsl`.

use std::ops::Range;

use argus_shaders::gpu::SORT;
use argus_shaders::layout::gpu::Digit;
use wgpu::{Buffer, BufferUsages};

use crate::{Commands, ComputePipeline, Gpu, Scan, ScanSums};

/// Keys of an invocation; `RUN` in the program.
const RUN: u64 = 64;
/// Bits of a digit.
const DIGIT_BITS: u32 = 4;

/// The pipelines.
#[derive(Debug)]
pub struct Sort {
    histogram: ComputePipeline,
    scatter: ComputePipeline,
}

/// Scratch buffers for keys and digit counts.
#[derive(Debug)]
pub struct SortScratch {
    keys: Buffer,
    counts: Buffer,
    sums: ScanSums,
}

impl SortScratch {
    /// Buffers for at most `capacity` keys.
    pub fn new(gpu: &Gpu, capacity: u64) -> Self {
        let counts = capacity.div_ceil(RUN) << DIGIT_BITS;
        Self {
            keys: gpu.buffer(
                "keys while sorted",
                capacity * 8,
                BufferUsages::STORAGE | BufferUsages::COPY_SRC,
            ),
            counts: gpu.buffer("counts by digit", counts * 4, BufferUsages::STORAGE),
            sums: ScanSums::new(gpu, counts),
        }
    }
}

impl Sort {
    /// Makes the pipelines.
    pub fn new(gpu: &Gpu) -> Self {
        let pipeline = |entry| gpu.compute_pipeline(&SORT, entry);
        Self { histogram: pipeline("histogram"), scatter: pipeline("scatter") }
    }

    /// Sorts the first `count` keys by the bits in `bits`, ascending and stable. The other bits are payload. `count` is
    /// at most the capacity of the scratch buffers.
    pub fn run<'a>(
        &self,
        commands: &mut Commands,
        scan: &Scan,
        keys: &'a Buffer,
        count: u32,
        bits: Range<u32>,
        scratch: &'a SortScratch,
    ) -> &'a Buffer {
        let runs = u64::from(count).div_ceil(RUN);
        let (mut from, mut to) = (keys, &scratch.keys);
        for shift in bits.step_by(DIGIT_BITS as usize) {
            let digit = Digit { count, runs: runs as u32, shift };
            commands
                .compute("sort", &self.histogram)
                .read("keys", from)
                .write("counts", &scratch.counts)
                .immediates(bytemuck::bytes_of(&digit))
                .dispatch_linear(runs);
            scan.run(commands, "sort", &scratch.counts, (runs as u32) << DIGIT_BITS, &scratch.sums);
            commands
                .compute("sort", &self.scatter)
                .read("keys", from)
                .write("counts", &scratch.counts)
                .write("sorted", to)
                .immediates(bytemuck::bytes_of(&digit))
                .dispatch_linear(runs);
            std::mem::swap(&mut from, &mut to);
        }
        from
    }
}
