//! Counters of a traversal.

use argus_scene::Stage;

use super::schedule::{Part, Step};

/// Words of the header: whether there are more maps than allocated.
pub(super) const HEAD: u32 = 8;
/// Words of an entry.
pub(super) const ENTRY: u32 = 8;

/// First word of an entry of a pass. Entry 0 counts seeds; entry i + 1 counts what step i queued and tested.
pub(super) fn entry(pass: u32, step: usize, steps: usize) -> u32 {
    HEAD + (pass * (steps as u32 + 1) + step as u32) * ENTRY
}

/// The word that is set if a queue of a part overflowed: the last of its entry 0.
pub(super) fn overflow(pass: u32, steps: usize) -> u32 {
    entry(pass, 0, steps) + ENTRY - 1
}

/// Counts of one step, summed over all parts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct StepStats {
    /// Level of the scene nodes of the tested pairs.
    pub scene_level: u32,
    /// Level of the view nodes of the tested pairs.
    pub view_level: u32,
    /// Tested pairs: those that a queue of untested pairs would have held.
    pub tested: u64,
    /// Tested pairs that were culled.
    pub culled: u64,
    /// Tested pairs that were rendered.
    pub rendered: u64,
    /// Tested pairs that were queued, to be divided or, in the last step, to fill many texels.
    pub queued: u64,
    /// Sum of the number of views that share a rendered pair.
    pub sharing: u64,
}

/// Statistics of a frame.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct FrameStats {
    /// Counts by step.
    pub steps: Vec<StepStats>,
    /// Number of times that overflowing parts were split in eight; 0 if one pass held all pairs.
    pub multipass_level: u32,
    /// Discarded frames whose queues or maps overflowed.
    pub reruns: u32,
    /// Whether each view was traversed alone, because views shared too little in an earlier frame.
    pub fell_back: bool,
    /// Levels of the view octree that divide cells; 0 without a view octree.
    pub view_depth: u32,
    /// Whether one more level divides views by direction.
    pub tells_directions: bool,
    /// Number of maps, inner nodes included.
    pub maps: u32,
    /// Nodes of the view octree; the number of views without one.
    pub view_nodes: u32,
    /// Leaves of the view octree; the number of views without one.
    pub view_leaves: u32,
    /// Milliseconds of wall time from the call to the last counter, discarded frames included.
    pub frame_ms: f64,
    /// Device time of the kept frame, by stage. Empty without timestamps.
    pub stages: Vec<Stage>,
    /// Bytes of the maps.
    pub map_bytes: u64,
    /// Bytes of both queues.
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

    /// Most pairs in one queue, as if there had been one pass.
    pub fn peak_queued(&self) -> u64 {
        self.steps.iter().map(|step| step.queued).max().unwrap_or(0)
    }

    /// Most pairs in one queue if pairs were queued before they are tested.
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
