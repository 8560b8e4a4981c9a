//! Program: `shaders/imperfect.wgsl`. Imperfect shadow maps of VPLs (Ritschel et al. 2008).

use crate::layout::Imperfect as Parameters;
use crate::programs::IMPERFECT;
use argus_gpu::{Commands, ComputePipeline, Gpu, wgpu};

/// Invocations of a row of workgroups. One dimension has at most 65,535 workgroups.
const ROW: u64 = 32_768 * 64;

/// Splats points into maps and fills gaps.
pub(crate) struct Imperfect {
    reset: ComputePipeline,
    splat: ComputePipeline,
    pull: ComputePipeline,
    push: ComputePipeline,
}

impl Imperfect {
    pub(crate) fn new(gpu: &Gpu) -> Self {
        let pipeline = |entry| gpu.compute_pipeline(&IMPERFECT, entry);
        Self {
            reset: pipeline("reset"),
            splat: pipeline("splat"),
            pull: pipeline("pull"),
            push: pipeline("push"),
        }
    }

    /// Fills `count` maps of `side`² texels a hemisphere with the distances of `points` random points each.
    pub(crate) fn record(
        &self,
        gpu: &Gpu,
        commands: &mut Commands,
        [vpls, points, maps]: [&wgpu::Buffer; 3],
        parameters: Parameters,
    ) {
        let Parameters { side, count, .. } = parameters;
        let texels = |side: u32| u64::from(count) * 2 * u64::from(side) * u64::from(side);
        let levels: Vec<u32> = (0..=side.ilog2()).map(|level| side >> level).collect();
        // Level 0 is in the maps. The other levels are consecutive.
        let begins: Vec<u64> = levels
            .iter()
            .scan(0, |end, &side| {
                let begin = *end;
                *end += if side == parameters.side { 0 } else { texels(side) };
                Some(begin)
            })
            .collect();
        let words = levels[1..].iter().map(|&side| texels(side)).sum::<u64>().max(1);
        let pyramid = gpu.buffer("coarser levels of maps", words * 4, wgpu::BufferUsages::STORAGE);
        let params = |to: usize, from: usize| {
            let parameters = Parameters {
                to_side: levels[to],
                from_side: levels[from],
                to_begin: begins[to] as u32,
                from_begin: begins[from] as u32,
                ..parameters
            };
            gpu.upload("imperfect maps", &[parameters], wgpu::BufferUsages::UNIFORM)
        };
        commands.compute("reset maps", &self.reset).write("maps", maps).dispatch_threads(grid(texels(side)));
        let own = params(0, 0);
        commands
            .compute("splat points", &self.splat)
            .read("imperfect", &own)
            .read("vpls", vpls)
            .read("surface_points", points)
            .write("splats", maps)
            .dispatch_threads(grid(u64::from(count) * u64::from(parameters.points)));
        for (level, &level_side) in levels.iter().enumerate().skip(1) {
            let uniform = params(level, level - 1);
            commands
                .compute("pull maps", &self.pull)
                .read("imperfect", &uniform)
                .write("maps", maps)
                .write("pyramid", &pyramid)
                .dispatch_threads(grid(texels(level_side)));
        }
        for level in (0..levels.len() - 1).rev() {
            let uniform = params(level, level + 1);
            commands
                .compute("push maps", &self.push)
                .read("imperfect", &uniform)
                .write("maps", maps)
                .write("pyramid", &pyramid)
                .dispatch_threads(grid(texels(levels[level])));
        }
    }
}

/// Invocations in two dimensions; the program computes a linear index.
fn grid(invocations: u64) -> [u32; 3] {
    [invocations.min(ROW) as u32, invocations.div_ceil(ROW) as u32, 1]
}
