//! Exclusive prefix sums of 32-bit numbers, in place. Program: `shaders/gpu/scan.wgsl`.

use argus_shaders::gpu::SCAN;
use wgpu::{Buffer, BufferUsages};

use crate::{Commands, ComputePipeline, Gpu};

/// Values of an invocation; `RUN` in the program.
const RUN: u64 = 32;

/// The pipelines.
#[derive(Debug)]
pub struct Scan {
    reduce: ComputePipeline,
    spread: ComputePipeline,
    spread_top: ComputePipeline,
}

/// Scratch buffers for the sums of runs.
#[derive(Debug)]
pub struct ScanSums {
    levels: Vec<Buffer>,
}

impl ScanSums {
    /// Buffers for at most `capacity` values.
    pub fn new(gpu: &Gpu, capacity: u64) -> Self {
        let mut levels = Vec::new();
        let mut count = capacity.max(1);
        loop {
            count = count.div_ceil(RUN);
            levels.push(gpu.buffer("sums", count * 4, BufferUsages::STORAGE | BufferUsages::COPY_SRC));
            if count == 1 {
                return Self { levels };
            }
        }
    }

    /// One u32: the sum of all values of the latest scan.
    pub fn total(&self) -> &Buffer {
        &self.levels[self.levels.len() - 1]
    }
}

impl Scan {
    /// Makes the pipelines.
    pub fn new(gpu: &Gpu) -> Self {
        let pipeline = |entry| gpu.compute_pipeline(&SCAN, entry);
        Self { reduce: pipeline("reduce"), spread: pipeline("spread"), spread_top: pipeline("spread_top") }
    }

    /// Replaces each of the first `count` values by the sum of those before it. `count` is at most the capacity of
    /// `sums`. The total is in [`ScanSums::total`].
    pub fn run(&self, commands: &mut Commands, name: &str, values: &Buffer, count: u32, sums: &ScanSums) {
        let top = sums.levels.len() - 1;
        let counts: Vec<u32> = std::iter::successors(Some(count), |n| Some(n.div_ceil(RUN as u32)))
            .take(sums.levels.len())
            .collect();
        let source = |level: usize| if level == 0 { values } else { &sums.levels[level - 1] };
        let mut pass = commands.compute_pass(name);
        for (level, count) in counts.iter().enumerate() {
            pass.call(&self.reduce)
                .write("values", source(level))
                .write("sums", &sums.levels[level])
                .immediates(bytemuck::bytes_of(count))
                .dispatch_linear(u64::from(*count).div_ceil(RUN));
        }
        pass.call(&self.spread_top)
            .write("values", source(top))
            .immediates(bytemuck::bytes_of(&counts[top]))
            .dispatch([1, 1, 1]);
        for (level, count) in counts.iter().enumerate().take(top).rev() {
            pass.call(&self.spread)
                .write("values", source(level))
                .write("sums", &sums.levels[level])
                .immediates(bytemuck::bytes_of(count))
                .dispatch_linear(u64::from(*count).div_ceil(RUN));
        }
    }
}
