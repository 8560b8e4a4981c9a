//! Which way triangles are seen, chosen by measurement.
//!
//! Under [`Visibility::Auto`] the first tile of the first sample, and that of the first direct view, is done in
//! every way and the cheapest one stays for as long as the sampler lives: so for a generation. What is measured
//! is real work, and the picture of that tile is by the way that was chosen.

use std::sync::Arc;
use std::time::{Duration, Instant};

use argus_scene::Scene;
use tracing::info;

use crate::Visibility;
use crate::bvh::Hierarchy;
use crate::packets::PacketTracer;
use crate::resident::Placement;

/// A measured way that is this much slower than the best so far is not measured again.
const HOPELESS: u32 = 2;
/// Work longer than this is not repeated: what a first run compiles is little beside it.
const LONG: Duration = Duration::from_millis(40);

/// One way to fill a visibility buffer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Way {
    /// The device's rasteriser.
    Raster,
    /// Packets in compute.
    Trace,
    /// Packets on the processor.
    Cpu,
}

impl Way {
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Raster => Visibility::Raster.name(),
            Self::Trace => Visibility::Trace.name(),
            Self::Cpu => Visibility::Cpu.name(),
        }
    }

    /// The way that a user's wish leaves no choice about.
    pub(crate) fn wished(visibility: Visibility) -> Option<Self> {
        match visibility {
            Visibility::Auto => None,
            Visibility::Raster => Some(Self::Raster),
            Visibility::Trace => Some(Self::Trace),
            Visibility::Cpu => Some(Self::Cpu),
        }
    }
}

/// What became of a choice.
#[derive(Debug, Clone)]
pub(crate) struct Choice {
    pub(crate) way: Way,
    pub(crate) why: String,
}

/// The choices of a sampler.
#[derive(Debug, Default)]
pub(crate) struct Choices {
    pub(crate) samples: Option<Choice>,
    pub(crate) views: Option<Choice>,
}

/// Does one piece of work in each of some ways, and says which is the cheapest. `work` returns once it is done.
///
/// # Errors
/// Those of `work`.
pub(crate) fn choose<E>(
    what: &str,
    ways: &[Way],
    mut work: impl FnMut(Way) -> Result<(), E>,
) -> Result<Choice, E> {
    let mut times: Vec<(Way, Duration)> = Vec::new();
    for &way in ways {
        let mut once = || {
            let begin = Instant::now();
            work(way).map(|()| begin.elapsed())
        };
        let best = times.iter().map(|(_, time)| *time).min();
        let first = once()?;
        let hopeless = best.is_some_and(|best| first > best * HOPELESS);
        let time = if first > LONG && hopeless { first } else { first.min(once()?) };
        times.push((way, time));
    }
    let way = times.iter().min_by_key(|(_, time)| *time).map_or(Way::Raster, |(way, _)| *way);
    let said = |(way, time): &(Way, Duration)| format!("{} {:.1} ms", way.name(), time.as_secs_f64() * 1e3);
    let why = format!("measured: {}", times.iter().map(said).collect::<Vec<_>>().join(", "));
    info!(way = way.name(), "{what} see triangles by the cheapest way; {why}");
    Ok(Choice { way, why })
}

/// Starts to build what tracers need, on a thread of its own.
pub(crate) struct Building(std::thread::JoinHandle<PacketTracer>);

impl Building {
    pub(crate) fn start(scene: &Arc<Scene>, placements: &[Placement], near: f32) -> Self {
        let (scene, placements) = (Arc::clone(scene), placements.to_vec());
        Self(std::thread::spawn(move || build(&scene, &placements, near)))
    }

    /// Waits for it.
    pub(crate) fn finish(self) -> PacketTracer {
        self.0.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
    }
}

/// Builds what tracers need.
pub(crate) fn build(scene: &Arc<Scene>, placements: &[Placement], near: f32) -> PacketTracer {
    let begin = Instant::now();
    let hierarchy = Hierarchy::new(scene, placements);
    let (triangles, objects) = (hierarchy.triangles.len(), hierarchy.placed.len());
    let ms = begin.elapsed().as_secs_f64() * 1e3;
    info!(ms, triangles, objects, "hierarchy built");
    PacketTracer::new(scene, hierarchy, near)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_cheaper_way_is_chosen_and_the_reason_names_both() {
        for (slow, fast) in [(Way::Raster, Way::Cpu), (Way::Cpu, Way::Raster)] {
            let choice = choose::<()>("tests", &[Way::Raster, Way::Cpu], |way| {
                std::thread::sleep(Duration::from_millis(if way == slow { 30 } else { 1 }));
                Ok(())
            });
            let choice = choice.unwrap();
            assert_eq!(choice.way, fast);
            assert!(choice.why.contains("raster") && choice.why.contains("cpu"), "{}", choice.why);
        }
        assert_eq!(choose("tests", &[Way::Trace], |_| Err("broken")).unwrap_err(), "broken");
    }
}
