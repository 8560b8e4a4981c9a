//! What a frame of cuts counts while it runs: words of `shaders/gpu/cut.wgsl`.

use argus_scene::Stage;

/// Whether anything did not fit.
pub(super) const OVERFLOW: usize = 0;
const VISITS: usize = 2;
const SPLITS: usize = 3;
const MERGES: usize = 4;
pub(super) const SETTLED: usize = 5;
const DUE: usize = 6;
const STARTED: usize = 7;
/// Whether a view started over as often as generations can be told apart.
pub(super) const WRAPPED: usize = 8;
const DRAWN: usize = 11;
/// Where the counts of queues begin, one a step.
pub(super) const QUEUES: u32 = 272;
/// Words of them all.
pub(super) const WORDS: u32 = QUEUES + 32;

/// What a frame of cuts did.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct CutStats {
    /// Nodes looked at, for a view each: tested from the root, or of the last frame's cuts, or above or below those.
    pub visits: u64,
    /// Nodes divided.
    pub splits: u64,
    /// Nodes that took the place of those below them.
    pub merges: u64,
    /// Nodes that were found to be in a cut by looking at them or at others.
    pub settled: u64,
    /// Chunks of 64 of the last frame's nodes that were due to be looked at.
    pub due_chunks: u64,
    /// Views that started over from the root.
    pub started: u64,
    /// Nodes in the cuts of all views; counted where maps were drawn.
    pub nodes: u64,
    /// Frames that were thrown away because something did not fit.
    pub reruns: u32,
    /// From the call to the last counter, milliseconds by the clock; frames thrown away counted.
    pub frame_ms: f64,
    /// Device time of the frame that counts, by stage; empty where the device cannot time.
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

    /// Device time of finding the cuts, milliseconds: all but drawing them.
    pub fn cut_ms(&self) -> f64 {
        let draws = ["clear maps", "draw", "fill"];
        self.stages.iter().filter(|stage| !draws.contains(&stage.name.as_str())).map(|stage| stage.ms).sum()
    }

    pub(super) fn of(words: &[u32]) -> Self {
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
