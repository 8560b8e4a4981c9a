//! Where the slowest frames spend their time, beside the mean of all frames.

use std::cmp::{Ordering, Reverse};
use std::collections::{BTreeMap, BinaryHeap};

use argus_scene::Stage;

/// Frames that are kept: enough for the slowest hundredth of 100 times as many.
const KEPT: usize = 1000;

/// Stages in the sentence.
const SAID: usize = 4;

/// Time outside all stages: on the wire, and in queues outside the workers.
const ELSEWHERE: &str = "elsewhere";

/// Means of all frames' stages, and the slowest frames.
#[derive(Debug, Default)]
pub(super) struct Tail {
    frames: u64,
    sums: BTreeMap<String, f64>,
    slowest: BinaryHeap<Reverse<Slow>>,
}

#[derive(Debug)]
struct Slow {
    ms: f64,
    stages: Vec<Stage>,
}

impl Tail {
    /// Records a frame and its latency in milliseconds.
    pub(super) fn push(&mut self, ms: f64, stages: &[Stage]) {
        self.frames += 1;
        let mut named = stages.to_vec();
        named.push(Stage::new(ELSEWHERE, (ms - stages.iter().map(|stage| stage.ms).sum::<f64>()).max(0.0)));
        for stage in &named {
            *self.sums.entry(stage.name.clone()).or_default() += stage.ms;
        }
        let slow = Slow { ms, stages: named };
        if self.slowest.len() < KEPT {
            self.slowest.push(Reverse(slow));
        } else if let Some(mut fastest) = self.slowest.peek_mut()
            && fastest.0 < slow
        {
            *fastest = Reverse(slow);
        }
    }

    /// One sentence about the stages of the slowest hundredth; `None` with fewer than 100 frames.
    pub(super) fn sentence(self) -> Option<String> {
        let count = (self.frames / 100) as usize;
        let mut slowest: Vec<Slow> = self.slowest.into_iter().map(|Reverse(slow)| slow).collect();
        slowest.sort_by(|a, b| b.cmp(a));
        slowest.truncate(count);
        if slowest.is_empty() {
            return None;
        }
        let mut means: BTreeMap<&str, f64> = BTreeMap::new();
        for stage in slowest.iter().flat_map(|slow| &slow.stages) {
            *means.entry(&stage.name).or_default() += stage.ms / slowest.len() as f64;
        }
        let mut more: Vec<(&str, f64, f64)> = means
            .into_iter()
            .map(|(name, ms)| (name, ms, self.sums.get(name).map_or(0.0, |sum| sum / self.frames as f64)))
            .collect();
        more.sort_by(|a, b| (b.1 - b.2).total_cmp(&(a.1 - a.2)));
        let said = more.iter().take(SAID);
        let said = said.map(|(name, slow, mean)| format!("{name} {slow:.1} ms ({mean:.1})"));
        Some(format!(
            "The slowest 1% of all frames, with the mean of all in parentheses: {}.",
            said.collect::<Vec<_>>().join(", ")
        ))
    }
}

impl PartialEq for Slow {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Slow {}

impl PartialOrd for Slow {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Slow {
    fn cmp(&self, other: &Self) -> Ordering {
        self.ms.total_cmp(&other.ms)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_slowest_hundredth_is_found_among_any_number_of_frames() {
        let mut tail = Tail::default();
        for i in 0..200_000_u32 {
            // One of two hundred frames waits; the rest only render.
            let waits = if i % 200 == 0 { 90.0 } else { 0.0 };
            let stages = [Stage::new("queue", waits), Stage::new("warp", 4.0)];
            tail.push(waits + 5.0, &stages);
        }
        assert_eq!(tail.slowest.len(), KEPT);
        let said = tail.sentence().unwrap();
        assert!(said.contains(": queue 90.0 ms (0.5)"), "{said}");
        assert!(said.contains("elsewhere 1.0 ms (1.0)"), "{said}");
    }

    #[test]
    fn with_few_frames_there_is_no_sentence() {
        let mut tail = Tail::default();
        (0..99).for_each(|_| tail.push(1.0, &[]));
        assert_eq!(tail.sentence(), None);
    }
}
