//! Oddities of drivers and compilers, with what works around each of them.
//!
//! Constants and decisions that follow from an oddity are here; code elsewhere uses them. A comment `Quirk: name.` in a
//! WGSL program says that the code below works around that oddity. A test compares these names with [`ALL`].
//!
//! "The software driver" is Mesa's lavapipe (llvmpipe); figures without a version are of Mesa 22.3.6.

use wgpu::{AdapterInfo, DeviceType, ShaderRuntimeChecks};

/// One oddity.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Quirk {
    /// Name in comments.
    pub name: &'static str,
    /// What happens.
    pub happens: &'static str,
    /// Where it was seen, with figures.
    pub measured: &'static str,
    /// What works around it.
    pub around: &'static str,
    /// When that can go.
    pub until: &'static str,
    /// Whether WGSL programs work around it, and name it.
    pub in_wgsl: bool,
}

/// All oddities.
pub const ALL: &[Quirk] = &[
    Quirk {
        name: "uniform-bound",
        happens: "The software driver compiles a uniform that bounds a loop into the machine code, and compiles again for \
                  every other value.",
        measured: "Mesa 22.2 and later: 45 ms and more a draw, where the work itself takes one.",
        around: "Bounds also depend on something that is no uniform: `runtime_bound` in shared/fetch.wgsl, or the length of \
                 an array. The checks of all programs (`argus_shaders::checks`) find bare uniforms.",
        until: "The software driver keeps uniforms in memory.",
        in_wgsl: true,
    },
    Quirk {
        name: "both-sides",
        happens: "The software driver runs both sides of every branch that is not constant, and zeroes the memory of every \
                  loop for every eight pixels. It skips a loop that none of its eight lanes needs.",
        measured: "An unused highlight cost 0.95 of 1.9 ms for a view of 200×150, a list of unsettled pixels 0.3 ms.",
        around: "Features are `override`s, rare cases are programs of their own, and loops of one turn replace branches.",
        until: "The software driver jumps over sides that no lane takes.",
        in_wgsl: true,
    },
    Quirk {
        name: "loop-limit",
        happens: "The software driver ends loops without a word after 65,535 iterations of all loops of a program.",
        measured: "Tiles and rays that were cut off, found by their flags.",
        around: "Tracers report a walk that was cut off: a tile is then rasterised (sampler/src/visibility.rs), and rays are \
                 traced on the CPU. Short loops of tracers are unrolled.",
        until: "The limit is gone, or the software driver is never asked to trace.",
        in_wgsl: true,
    },
    Quirk {
        name: "loop-body-once",
        happens: "The software driver runs a loop's body once even if it should not run, and once more if the loop ends at \
                  its head.",
        measured: "No figure: the tracer of packets was wrong without its checks.",
        around: "Each body begins with a check that there is work.",
        until: "The software driver is never asked to trace.",
        in_wgsl: true,
    },
    Quirk {
        name: "unrolled-loops",
        happens: "Drivers unroll loops with constant bounds; the software driver then compiles for minutes.",
        measured: "Minutes for the filter of shadows, which visits a square of texels.",
        around: "Bounds depend on the length of an array.",
        until: "WGSL can forbid unrolling.",
        in_wgsl: true,
    },
    Quirk {
        name: "lockstep",
        happens: "On the software driver eight invocations run together: one that takes long delays seven.",
        measured: "Subgroups have 8 lanes there: a texel of four triangles would delay seven texels of one.",
        around: "Rare work is collected and runs in a dispatch of its own.",
        until: "Never: GPUs have the same in groups of 32.",
        in_wgsl: true,
    },
    Quirk {
        name: "slow-atomics",
        happens: "On the software driver an atomic costs as much as a fetch.",
        measured: "Work queues: 41 M items a second with an atomic each, 98 with one reservation a thread.",
        around: "Each invocation has its own segment of a list and its own counters.",
        until: "Never: reservations are faster on GPUs, too.",
        in_wgsl: true,
    },
    Quirk {
        name: "slow-scalars",
        happens: "The software driver reads a vector of four in about the time of a scalar where lanes read different \
                  addresses.",
        measured: "No figure.",
        around: "Fields of such structs are vectors of four.",
        until: "The software driver gathers scalars.",
        in_wgsl: true,
    },
    Quirk {
        name: "slow-division",
        happens: "The software driver divides integers one lane at a time.",
        measured: "No figure.",
        around: "Small numbers are divided as floats.",
        until: "The software driver divides vectors.",
        in_wgsl: true,
    },
    Quirk {
        name: "slow-pow",
        happens: "`pow` is slow on the software driver.",
        measured: "Three cost as much as all else in the warp: 0.9 ms a view of 200×150.",
        around: "sRGB is encoded by a fitted polynomial in square roots.",
        until: "The polynomial is no faster.",
        in_wgsl: true,
    },
    Quirk {
        name: "slow-shared-exponents",
        happens: "On the software driver filtering colours with a shared exponent costs four times as much as filtering \
                  bytes.",
        measured: "That ratio.",
        around: "Samples have a display plane of bytes beside their radiance.",
        until: "Both filter alike.",
        in_wgsl: true,
    },
    Quirk {
        name: "level-of-quad",
        happens: "The software driver reads the mip level of the first pixel for all four pixels of a quad.",
        measured: "Pyramids in mip levels failed.",
        around: "All levels of a pyramid are side by side in one image.",
        until: "A test of explicit levels passes on the software driver.",
        in_wgsl: true,
    },
    Quirk {
        name: "folded-nan",
        happens: "Compilers may assume that there are no NaN and no infinities, and fold `x != x`.",
        measured: "No figure: WGSL allows it.",
        around: "Checks test exponent bits.",
        until: "WGSL defines NaN.",
        in_wgsl: true,
    },
    Quirk {
        name: "idle-workgroups",
        happens: "The software driver runs workgroups one after another, and an idle one still costs time.",
        measured: "No figure.",
        around: "[`crate::Gpu::list_workgroups`].",
        until: "Lists are dispatched by their length without waiting for it.",
        in_wgsl: false,
    },
    Quirk {
        name: "compiled-at-first-use",
        happens: "Drivers compile a program at its first use, not when its pipeline is made.",
        measured: "First frames of every study, which do not count.",
        around: "A step of background work with a new program ends its submission (compositor/src/sample_store.rs), first \
                 rounds of measurements are not counted, and workers render a view with every pipeline before they count as \
                 ready (cluster/src/worker/warm.rs).",
        until: "Compilation can be asked for.",
        in_wgsl: false,
    },
    Quirk {
        name: "long-passes",
        happens: "Drivers that also serve a display reset the device after a submission of two seconds or more.",
        measured: "No figure. The software driver has no limit; the self-test times the longest pass elsewhere.",
        around: "[`LONGEST_PASS_MS`].",
        until: "Never.",
        in_wgsl: false,
    },
    Quirk {
        name: "dispatch-limit",
        happens: "A dimension of a dispatch has at most 65,535 workgroups. For an indirect dispatch beyond, wgpu's validation \
                  writes zeros: the work is lost without a word.",
        measured: "wgpu 30: beyond 4.2 M invocations in workgroups of 64.",
        around: "[`MAX_WORKGROUPS`], and dispatches in two dimensions of at most [`WORKGROUPS_ACROSS`].",
        until: "Never.",
        in_wgsl: false,
    },
    Quirk {
        name: "runtime-checks",
        happens: "wgpu adds checks of indices and counters of loops to programs.",
        measured: "An H200: 1% of a tracer of rays (64 invocations a workgroup, stacks in its memory). Nothing on the software \
                   driver.",
        around: "[`UNCHECKED`], for a tracer whose loops and indices are proven.",
        until: "They cost nothing.",
        in_wgsl: false,
    },
    Quirk {
        name: "zeroed-workgroup-memory",
        happens: "wgpu zeroes workgroup memory, which costs a barrier.",
        measured: "No figure.",
        around: "[`ZEROES_WORKGROUP_MEMORY`]. The checks of all programs list those that have such memory, which write before \
                 they read.",
        until: "Compilers see that it is written first.",
        in_wgsl: false,
    },
    Quirk {
        name: "cleared-layers",
        happens: "wgpu clears all unwritten layers of a texture at once, when one of them is first read.",
        measured: "No figure. Copying 64 layers at once took 233 ms.",
        around: "New layers of a pool copy any old layer (compositor/src/pool.rs).",
        until: "wgpu clears layers one by one.",
        in_wgsl: false,
    },
    Quirk {
        name: "late-map-callbacks",
        happens: "A buffer's map callback runs inside a poll, maybe of another thread, after this thread's poll returned.",
        measured: "wgpu 30, where two threads wait.",
        around: "Readbacks wait for the callback (readback.rs).",
        until: "A poll for a submission includes its callbacks.",
        in_wgsl: false,
    },
    Quirk {
        name: "odd-timestamps",
        happens: "A driver may reset its clock between two timestamps. The software driver has gaps between those of \
                  consecutive passes.",
        measured: "No figure.",
        around: "Negative times count as 0 (timing.rs); the rest is a row of its own (sampler/src/timing.rs).",
        until: "Never.",
        in_wgsl: false,
    },
    Quirk {
        name: "slow-fragments",
        happens: "Data-centre GPUs run graphics on few of their multiprocessors.",
        measured: "An H100: 4 of 132. Fragments of one test were 30 times slower than the same arithmetic in compute.",
        around: "Each search has a compute twin, and the faster is measured (compositor/src/autotune.rs).",
        until: "Never.",
        in_wgsl: false,
    },
    Quirk {
        name: "slow-clocks",
        happens: "An idle GPU takes tenths of a second to raise its clocks.",
        measured: "An H200.",
        around: "Measurements of rays are preceded by rounds that are not counted (sampler/src/ray_timing/device.rs).",
        until: "Never.",
        in_wgsl: false,
    },
    Quirk {
        name: "thread-per-core",
        happens: "The software driver starts a thread for each core in every process.",
        measured: "Only its fragment work uses them: with one thread a process, c/g is 0.05 for the splat and 0.10 for 64 linear steps.",
        around: "[`worker_environment`] shares the cores among workers; comparisons of processes give each one thread.",
        until: "Workers share a pool of threads.",
        in_wgsl: false,
    },
    Quirk {
        name: "device-selection",
        happens: "Mesa's layer for the selection of devices prints errors without a desktop session.",
        measured: "No figure.",
        around: "[`worker_environment`] switches it off; adapters are chosen here.",
        until: "The layer is silent.",
        in_wgsl: false,
    },
];

/// Whether an adapter is a software driver, which runs on the CPU.
pub(crate) fn is_software(adapter: &AdapterInfo) -> bool {
    adapter.device_type == DeviceType::Cpu
}

/// Most milliseconds of a pass: half of what drivers allow.
///
/// Passes are bounded by sampler tiles of 2048² sub-samples, compositor chunks of 4 million sub-pixels, the queues of
/// traversals, and 2²⁹ pairs of triangle and view for brute-force maps.
pub const LONGEST_PASS_MS: f64 = 1000.0;

/// Most workgroups of a dispatch in one dimension.
pub const MAX_WORKGROUPS: u32 = 65_535;

/// Most workgroups along the first axis of a dispatch that is spread over two.
pub(crate) const WORKGROUPS_ACROSS: u64 = 1 << 15;

/// Pipelines for programs whose loops and indices are proven have no checks.
pub(crate) const UNCHECKED: fn() -> ShaderRuntimeChecks = ShaderRuntimeChecks::unchecked;

/// Pipelines do not zero workgroup memory.
pub(crate) const ZEROES_WORKGROUP_MEMORY: bool = false;

/// Workgroups for a list of unknown length: one on a software driver, else `most`.
pub(crate) fn list_workgroups(adapter: &AdapterInfo, most: u32) -> u32 {
    if is_software(adapter) { 1 } else { most }
}

/// Variables of a worker process that has `threads` of the machine's cores. Those that are set already are left out.
pub fn worker_environment(threads: usize) -> impl Iterator<Item = (&'static str, String)> {
    let variables = [("LP_NUM_THREADS", threads.max(1).to_string()), ("NODEVICE_SELECT", "1".to_owned())];
    variables.into_iter().filter(|(name, _)| std::env::var_os(name).is_none())
}
