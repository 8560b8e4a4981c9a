//! Counters of a frame of cuts, in the layout of `shaders/cut.wgsl`.

use argus_scene::Stage;

/// Set on overflow.
pub(crate) const OVERFLOW: usize = 0;
const VISITS: usize = 2;
const SPLITS: usize = 3;
const MERGES: usize = 4;
pub(crate) const SETTLED: usize = 5;
const DUE: usize = 6;
const STARTED: usize = 7;
/// Set if a view used up all generations.
pub(crate) const WRAPPED: usize = 8;
const DRAWN: usize = 11;
/// First counter of the queues, one a step.
pub(crate) const QUEUES: u32 = 272;
/// Number of words.
pub(crate) const WORDS: u32 = QUEUES + 32;

/// Statistics of a frame of cuts.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct CutStats {
    /// Tested pairs of node and view.
    pub visits: u64,
    /// Divided nodes.
    pub splits: u64,
    /// Nodes that replaced their children.
    pub merges: u64,
    /// Nodes that were put into a cut.
    pub settled: u64,
    /// Due chunks of 64 nodes of the last frame.
    pub due_chunks: u64,
    /// Views that restarted from the root.
    pub started: u64,
    /// Nodes in the cuts of all views. Counted only if maps are drawn.
    pub nodes: u64,
    /// Discarded frames that overflowed.
    pub reruns: u32,
    /// Milliseconds of wall time from the call to the last counter, discarded frames included.
    pub frame_ms: f64,
    /// Device time of the kept frame, by stage. Empty without timestamps.
    pub stages: Vec<Stage>,
    /// Bytes of cuts and queues.
    pub cut_bytes: u64,
    /// Bytes of the maps.
    pub map_bytes: u64,
}

impl CutStats {
    /// Splits and merges.
    pub fn operations(&self) -> u64 {
        self.splits + self.merges
    }

    /// Device time of finding the cuts without drawing them, milliseconds.
    pub fn cut_ms(&self) -> f64 {
        let draws = ["clear maps", "draw", "fill"];
        self.stages.iter().filter(|stage| !draws.contains(&stage.name.as_str())).map(|stage| stage.ms).sum()
    }

    pub(crate) fn of(words: &[u32]) -> Self {
        let word = |at: usize| words.get(at).copied().map_or(0, u64::from);
        Self {
            visits: word(VISITS),
            splits: word(SPLITS),
            merges: word(MERGES),
            settled: word(SETTLED),
            due_chunks: word(DUE),
            started: word(STARTED),
            nodes: word(DRAWN),
            ..Self::default()
        }
    }
}
