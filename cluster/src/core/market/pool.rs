//! Which worker holds which source, as workers report it, and which sources are being rendered.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use argus_scene::{FrameSource, SampleId, SceneState};

use super::buy::Purchasable;
use super::source_grid::{Place, Seen, SourceGrid, ViewGrid};
use crate::core::event::{HeldSource, SourceNews, WorkerId};
use crate::core::time::Uptime;

/// Sources that are examined for a view, nearest first.
///
/// Tuned: 8 (CROWD.md, rule 2).
const MOST_NEAR: usize = 8;

/// Distance up to which views belong to a source's account, in the measure of [`Place::distance`].
///
/// Tuned: 1 (CROWD.md, rule 4).
const MOST_ACCOUNTED: f64 = 1.0;

/// Least density of a source's pixels over that of the view's: coarser ones blur.
const LEAST_DENSITY: f64 = 0.9;

/// A source that a worker holds.
#[derive(Debug, Clone)]
pub struct Held {
    /// Its id.
    pub id: SampleId,
    /// Camera, size, sampling and light.
    pub source: FrameSource,
    /// The state that it shows.
    pub state: SceneState,
    /// Its place and depth.
    pub grid: SourceGrid,
    /// Whether it was bought: other sources were rendered for a viewer.
    pub bought: bool,
    /// The workers that hold it.
    pub holders: BTreeSet<WorkerId>,
}

/// A source that a worker renders.
#[derive(Debug, Clone, PartialEq)]
pub struct Coming {
    /// The worker.
    pub worker: WorkerId,
    /// What it renders.
    pub source: FrameSource,
    /// The state that it will show.
    pub state: SceneState,
    /// Its kind, and the pixels of the view that it was bought for.
    pub kind: (Purchasable, u64),
    /// Its place.
    pub place: Place,
    /// When it was ordered, and when it is given up.
    pub due: (Uptime, Uptime),
}

/// A source near a view.
#[derive(Debug, Clone, Copy)]
pub struct Near<'a> {
    /// The source.
    pub held: &'a Held,
    /// What it shows of the view.
    pub seen: Seen,
}

/// All sources.
#[derive(Debug, Clone, Default)]
pub struct Pool {
    held: BTreeMap<SampleId, Arc<Held>>,
    coming: Vec<Coming>,
}

impl Pool {
    /// Takes a worker's report. Returns purchases that are done, with the seconds that they took.
    pub fn reported(&mut self, worker: WorkerId, news: &SourceNews) -> Vec<(Coming, f64)> {
        if news.whole {
            self.drop_of(worker, |_| true);
        }
        news.dropped.iter().for_each(|id| self.drop_of(worker, |other| other == *id));
        news.added.iter().filter_map(|added| self.add(worker, added)).collect()
    }

    fn add(&mut self, worker: WorkerId, added: &HeldSource) -> Option<(Coming, f64)> {
        let HeldSource { id, source, state, ref ranges, bought, render_ms, .. } = *added;
        if let Some(grid) = SourceGrid::new(&source, ranges) {
            let new = || Arc::new(Held { id, source, state, grid, bought, holders: BTreeSet::new() });
            Arc::make_mut(self.held.entry(id).or_insert_with(new)).holders.insert(worker);
        }
        let is_it = |coming: &Coming| {
            // The worker chose both.
            let FrameSource { light, band_rows, .. } = coming.source;
            let same = FrameSource { light, band_rows, ..source };
            coming.worker == worker && coming.state == state && coming.source == same
        };
        let done = self.coming.iter().position(is_it).map(|at| self.coming.swap_remove(at))?;
        Some((done, f64::from(render_ms) * 1e-3))
    }

    fn drop_of(&mut self, worker: WorkerId, such: impl Fn(SampleId) -> bool) {
        self.held.retain(|id, held| {
            if such(*id) && held.holders.contains(&worker) {
                Arc::make_mut(held).holders.remove(&worker);
            }
            !held.holders.is_empty()
        });
    }

    /// Forgets a lost worker.
    pub fn forget(&mut self, worker: WorkerId) {
        self.drop_of(worker, |_| true);
        self.coming.retain(|coming| coming.worker != worker);
    }

    /// Notes a purchase.
    pub fn order(&mut self, coming: Coming) {
        self.coming.push(coming);
    }

    /// Purchases that are being rendered.
    pub fn coming(&self) -> &[Coming] {
        &self.coming
    }

    /// Gives up purchases whose time is over, and those that show another state. Returns whether there were any.
    pub fn give_up(&mut self, state: SceneState, now: Uptime) -> bool {
        let before = self.coming.len();
        self.coming.retain(|coming| coming.state == state && now < coming.due.1);
        self.coming.len() < before
    }

    /// A source.
    pub fn get(&self, id: SampleId) -> Option<&Held> {
        self.held.get(&id).map(AsRef::as_ref)
    }

    /// The mean inverse range of the sources that show a state, 1/m; `None` without any.
    pub fn mean_inverse(&self, state: SceneState) -> Option<f64> {
        let shown = self.held.values().filter(|held| held.state == state);
        let (sum, count) =
            shown.fold((0.0, 0.0), |(sum, count), held| (sum + held.grid.place.mean_inverse, count + 1.0));
        (count > 0.0).then(|| sum / count)
    }

    /// Number of sources, and those of them that were bought.
    pub fn count(&self) -> (usize, usize) {
        (self.held.len(), self.held.values().filter(|held| held.bought).count())
    }

    /// The sources that show a state, near a view of some pixel density with so many samples a pixel; nearest first.
    pub fn near(&self, view: &ViewGrid, samples_per_pixel: u32, state: SceneState) -> Vec<Near<'_>> {
        let suits = |held: &&Arc<Held>| {
            held.state == state
                && held.source.samples_per_pixel >= samples_per_pixel
                && held.grid.density >= LEAST_DENSITY * view.density
        };
        let mut near: Vec<(f64, &Held)> = self
            .held
            .values()
            .filter(suits)
            .map(|held| (held.grid.place.distance(view), held.as_ref()))
            .filter(|(distance, _)| distance.is_finite())
            .collect();
        near.sort_by(|a, b| a.0.total_cmp(&b.0));
        near.into_iter().take(MOST_NEAR).map(|(_, held)| Near { held, seen: held.grid.seen(view) }).collect()
    }

    /// Whether a source that is being rendered is nearer to a view than this distance, or near enough where none is held.
    pub fn is_coming(&self, view: &ViewGrid, nearest: f64) -> bool {
        let most = nearest.min(MOST_ACCOUNTED);
        self.coming.iter().any(|coming| coming.place.distance(view) <= most)
    }

    /// Whether a view at this distance of a source belongs to its account.
    pub fn is_accounted(distance: f64) -> bool {
        distance < MOST_ACCOUNTED
    }
}
