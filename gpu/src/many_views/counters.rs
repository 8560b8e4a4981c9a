//! What a traversal counts while it runs.

use argus_scene::Stage;

use super::schedule::Step;
use super::traverse::Part;

/// Words at the beginning: whether there are more maps than there is room for.
pub(super) const HEAD: u32 = 8;
/// Words of an entry.
pub(super) const ENTRY: u32 = 8;

/// Where a pass's queues are counted: its entry 0 is the seeds', entry i + 1 what step i queued and tested.
pub(super) fn entry(pass: u32, step: usize, steps: usize) -> u32 {
    HEAD + (pass * (steps as u32 + 1) + step as u32) * ENTRY
}

/// The word that says whether a queue of a part overflowed: the last of its seeds' entry.
pub(super) fn overflow(pass: u32, steps: usize) -> u32 {
    entry(pass, 0, steps) + ENTRY - 1
}

/// What one step did, over all parts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct StepStats {
    /// Level of the scene's nodes in the pairs tested.
    pub scene_level: u32,
    /// Level of the view nodes in them.
    pub view_level: u32,
    /// Pairs tested: those that a queue of untested pairs would have held.
    pub tested: u64,
    /// Of these, culled.
    pub culled: u64,
    /// Of these, rendered.
    pub rendered: u64,
    /// Of these, queued: to be divided, or in the last step, to fill many texels.
    pub queued: u64,
    /// Views that share a rendered pair, summed over those.
    pub sharing: u64,
}

/// What a frame did.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct FrameStats {
    /// Step by step.
    pub steps: Vec<StepStats>,
    /// Times that what overflowed was split in eight: 0 where one pass held all pairs.
    pub multipass_level: u32,
    /// Frames that were thrown away because a queue or the maps overflowed.
    pub reruns: u32,
    /// Whether each view was traversed by itself because too few shared anything in a frame before.
    pub fell_back: bool,
    /// Levels of the view octree below its root that divide cells; 0 where there is none.
    pub view_depth: u32,
    /// Whether one below them tells views apart by direction.
    pub tells_directions: bool,
    /// Maps, those of inner nodes counted.
    pub maps: u32,
    /// Nodes of the view octree; the views where there is none.
    pub view_nodes: u32,
    /// Leaves of the view octree; the views where there is none.
    pub view_leaves: u32,
    /// From the call to the last counter, milliseconds by the clock; frames thrown away counted.
    pub frame_ms: f64,
    /// Device time of the frame that counts, by stage; empty where the device cannot time.
    pub stages: Vec<Stage>,
    /// Bytes of the maps.
    pub map_bytes: u64,
    /// Bytes of both queues as they are allocated.
    pub queue_bytes: u64,
    /// Bytes of the view octree.
    pub view_bytes: u64,
}

impl FrameStats {
    /// Pairs tested.
    pub fn processed(&self) -> u64 {
        self.steps.iter().map(|step| step.tested).sum::<u64>()
    }

    /// Pairs rendered.
    pub fn rendered(&self) -> u64 {
        self.steps.iter().map(|step| step.rendered).sum()
    }

    /// Most pairs that one queue held, as if there had been one pass.
    pub fn peak_queued(&self) -> u64 {
        self.steps.iter().map(|step| step.queued).max().unwrap_or(0)
    }

    /// Most pairs that one queue would have held if pairs were queued before they are tested.
    pub fn peak_untested(&self) -> u64 {
        self.steps.iter().map(|step| step.tested).max().unwrap_or(0)
    }

    /// Mean number of views that share a rendered pair.
    pub fn views_per_node(&self) -> f64 {
        self.steps.iter().map(|step| step.sharing).sum::<u64>() as f64 / self.rendered().max(1) as f64
    }
}

/// Sums the entries of all parts.
pub(super) fn read(words: &[u32], steps: &[Step], parts: &[Part]) -> Vec<StepStats> {
    let of_step = |(index, step): (usize, &Step)| {
        let mut stats =
            StepStats { scene_level: step.scene_level, view_level: step.view_level, ..StepStats::default() };
        for (pass, _) in (0..).zip(parts).filter(|(_, part)| part.counts(step)) {
            let at = entry(pass, index + 1, steps.len()) as usize;
            let word = |i: usize| words.get(at + i).copied().map_or(0, u64::from);
            stats.queued += word(0);
            stats.tested += word(1);
            stats.culled += word(2);
            stats.rendered += word(3);
            stats.sharing += word(4) | word(5) << 32;
        }
        stats
    };
    steps.iter().enumerate().map(of_step).collect()
}
