//! Lists on the device, each made from the one before it, whose lengths the CPU does not know: dispatches for their elements,
//! and exclusive prefix sums. Program: `shaders/gpu/list_scan.wgsl`.
//!
//! So a chain of steps, such as the levels of a hierarchy, is recorded at once, and its lengths are read back once at its end.

use argus_shaders::gpu::LIST_SCAN;
use argus_shaders::layout::gpu::ListStep;
use wgpu::{Buffer, BufferUsages};

use crate::{Commands, ComputeCall, ComputePipeline, Gpu};

/// Values of an invocation; `RUN` in the program.
const RUN: u64 = 32;
/// Dispatches whose workgroups are computed: one for the elements, and one for each level of sums of 2³² values.
const ARGUMENTS: u64 = 8;
/// Bytes of the workgroups of a dispatch.
const ARGUMENT_BYTES: u64 = 16;

/// The pipelines.
#[derive(Debug)]
pub struct ListScan {
    advance: ComputePipeline,
    reduce: ComputePipeline,
    spread: ComputePipeline,
    spread_top: ComputePipeline,
}

/// Lengths of lists, and scratch buffers for their sums.
#[derive(Debug)]
pub struct Lists {
    capacity: u32,
    /// Two u32 a list: its length, which is 0 if the list does not fit; and the length that it should have.
    pub lengths: Buffer,
    arguments: Buffer,
    sums: Vec<Buffer>,
}

/// Where the length of a list is.
#[derive(Debug, Clone, Copy)]
pub struct LengthAt<'a> {
    /// Buffer of u32.
    pub buffer: &'a Buffer,
    /// Index in the buffer.
    pub word: u32,
    /// What is added to that word.
    pub more: u32,
}

impl<'a> LengthAt<'a> {
    /// The first word of a buffer, such as [`Lists::total`].
    pub fn first(buffer: &'a Buffer) -> Self {
        Self { buffer, word: 0, more: 0 }
    }
}

impl Lists {
    /// Buffers for so many lists of at most `capacity` elements each.
    pub fn new(gpu: &Gpu, lists: u32, capacity: u32) -> Self {
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_SRC;
        let mut sums = Vec::new();
        let mut count = u64::from(capacity.max(1));
        loop {
            count = count.div_ceil(RUN);
            sums.push(gpu.buffer("sums of lists", count * 4, usage));
            if count == 1 {
                break;
            }
        }
        let arguments = ARGUMENTS * ARGUMENT_BYTES;
        Self {
            capacity,
            lengths: gpu.buffer("lengths of lists", u64::from(lists) * 8, usage),
            arguments: gpu.buffer("workgroups of a list", arguments, usage | BufferUsages::INDIRECT),
            sums,
        }
    }

    /// One u32: the sum of all values of the latest scan.
    pub fn total(&self) -> &Buffer {
        &self.sums[self.sums.len() - 1]
    }

    /// Dispatches at least an invocation for each element of the list that [`ListScan::advance`] came to. The program
    /// computes its index with `shared/linear.wgsl`, and checks it against the list's length.
    pub fn dispatch(&self, call: ComputeCall<'_>) {
        call.dispatch_indirect(&self.arguments, 0);
    }
}

impl ListScan {
    /// Makes the pipelines.
    pub fn new(gpu: &Gpu) -> Self {
        let pipeline = |entry| gpu.compute_pipeline(&LIST_SCAN, entry);
        Self {
            advance: pipeline("advance"),
            reduce: pipeline("reduce"),
            spread: pipeline("spread"),
            spread_top: pipeline("spread_top"),
        }
    }

    /// Comes to a list, by index, of a length that the device knows.
    pub fn advance(
        &self,
        commands: &mut Commands,
        name: &str,
        lists: &Lists,
        list: u32,
        length: LengthAt<'_>,
    ) {
        let LengthAt { buffer, word, more } = length;
        let step = ListStep { list, level: 0, capacity: lists.capacity, word, more };
        commands
            .compute(name, &self.advance)
            .write("lengths", &lists.lengths)
            .read("total", buffer)
            .write("arguments", &lists.arguments)
            .immediates(bytemuck::bytes_of(&step))
            .dispatch([1, 1, 1]);
    }

    /// Replaces each value of the list that [`Self::advance`] came to by the sum of those before it.
    pub fn run(&self, commands: &mut Commands, name: &str, lists: &Lists, list: u32, values: &Buffer) {
        let top = lists.sums.len() - 1;
        let source = |level: usize| if level == 0 { values } else { &lists.sums[level - 1] };
        let step = |level: usize| ListStep { list, level: level as u32, ..bytemuck::Zeroable::zeroed() };
        let offset = |level: usize| (level as u64 + 1) * ARGUMENT_BYTES;
        let mut pass = commands.compute_pass(name);
        for level in 0..=top {
            pass.call(&self.reduce)
                .read("length_of", &lists.lengths)
                .write("values", source(level))
                .write("sums", &lists.sums[level])
                .immediates(bytemuck::bytes_of(&step(level)))
                .dispatch_indirect(&lists.arguments, offset(level));
        }
        pass.call(&self.spread_top)
            .read("length_of", &lists.lengths)
            .write("values", source(top))
            .immediates(bytemuck::bytes_of(&step(top)))
            .dispatch([1, 1, 1]);
        for level in (0..top).rev() {
            pass.call(&self.spread)
                .read("length_of", &lists.lengths)
                .write("values", source(level))
                .write("sums", &lists.sums[level])
                .immediates(bytemuck::bytes_of(&step(level)))
                .dispatch_indirect(&lists.arguments, offset(level));
        }
    }
}
