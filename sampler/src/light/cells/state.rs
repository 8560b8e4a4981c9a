//! What a sampler keeps of its cells, behind a lock.

use std::collections::HashMap;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use argus_scene::{CellContent, SurfaceLight};
use rayon::prelude::*;

use super::super::lattice::{CellKey, PageKey};
use super::super::shading_points::ShadingPoints;
use super::changes::Changes;
use super::faces::KnownFaces;
use super::inputs::CellInputs;
use super::lookup::Answer;
use super::queue::Queue;
use super::store::{Kept, Store, TIERS};

/// Most memory of cells: 1.6 M sides of 16 rays take 110 MB.
const MOST_BYTES: usize = 256 << 20;
/// Longest time for which an open view fills cells that it lacks, milliseconds, as predicted; more where its rays would take longer.
pub(super) const VIEW_FILLS_MS: f64 = 20.0;
/// Share of the time of its rays that an open view may spend on filling. A lookup takes less than the rest, so that no view takes
/// longer than by rays, and each leaves cells to the next.
const VIEW_FILLS_SHARE: f64 = 0.5;
/// Share of its time that a sampler spends on cells that wait, where views follow one another without a pause: nobody else fills them.
const WAITING_SHARE: f64 = 0.15;
/// Longest time that a view spends on them.
const MOST_ON_WAITING: Duration = Duration::from_millis(50);
/// Milliseconds of a corner or refined cell, before any is measured.
const FIRST_GUESS_MS: f64 = 0.05;

/// What a job asks of the light of sky and surfaces.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum CellUse {
    /// Rays from each pixel.
    Rays,
    /// Rays from each pixel. Cells that lack are filled beside views.
    Later,
    /// Cells of the best tier that all of the view has, or soon would have; else rays.
    Open,
    /// Cells of the best tier that all of the view has, at most of so many rays; else rays. Nothing is filled for it, and what lacks is
    /// filled beside views.
    Held {
        /// As in [`Self::Whole`].
        rays: u32,
        /// Whether reflected points may take cells.
        reflected: bool,
    },
    /// Cells of so many rays. Those that lack are filled first.
    Whole {
        /// 16, 64 or 256; others count as the next lower one.
        rays: u32,
        /// Whether reflected points take cells, too, of the first tier; else they cast rays.
        reflected: bool,
    },
}

impl From<Option<SurfaceLight>> for CellUse {
    fn from(asked: Option<SurfaceLight>) -> Self {
        match asked {
            // Cells of an earlier pose are shown, but callers refuse to be asked for them.
            None | Some(SurfaceLight::OlderCells { .. }) => Self::Open,
            Some(SurfaceLight::Rays) => Self::Rays,
            Some(SurfaceLight::Cells { rays, reflected }) => Self::Whole { rays, reflected },
        }
    }
}

/// Cells behind a lock, since other threads send them to other samplers and take over theirs.
pub(super) struct SharedCells(Mutex<State>);

pub(super) struct State {
    pub(super) store: Store,
    /// Corners that views lacked.
    pub(super) queue: Queue,
    /// Cells to be refined, and whether there may be more.
    pub(super) refined: Vec<CellKey>,
    pub(super) may_refine: bool,
    /// The posed and lit scene that the cells are of.
    pub(super) inputs: Option<CellInputs>,
    /// What the cells are of, once that is known; `None` within if it has no name.
    pub(super) content: Option<Option<CellContent>>,
    pub(super) asked: Asked,
    pub(super) job: Job,
    /// When the present job began, and the time between the one before it and this one that is not spent on what waits.
    began: Instant,
    unspent: Duration,
    /// Milliseconds of a corner of the first tier and of a cell's refinement to each further one.
    pub(super) costs: [f64; TIERS],
    /// Milliseconds of a texel's light by rays; `None` until it is measured.
    pub(super) ray_ms: Option<f64>,
    pub(super) filled: u64,
    pub(super) fill_ms: f64,
    /// Pixels that asked for cells, and those that cells lit.
    pub(super) pixels: u64,
    pub(super) pixels_lit: u64,
    /// Pages that were kept as things moved, and those that were not.
    pub(super) kept: Kept,
    /// Faces of samples that are as if they were rendered now.
    pub(super) faces: KnownFaces,
    /// How often the pose or lighting has changed.
    pub(super) poses: u64,
}

/// The light of the present job.
pub(super) struct Job {
    pub(super) asked: CellUse,
    /// The tier of its own pixels, once that is known; `None` within for rays.
    pub(super) found: Option<Option<usize>>,
    /// Whether it shows light of an earlier pose. Then nothing is filled.
    pub(super) lags: bool,
    /// Whether cells of an earlier pose count for it, too.
    pub(super) shows_older: bool,
    /// Whether its reflected points take cells, once that is known.
    pub(super) reflected: Option<bool>,
}

/// Pages that were asked of other samplers.
#[derive(Default)]
pub(super) struct Asked {
    /// When they were asked for.
    pub(super) asked: HashMap<PageKey, Instant>,
    /// Until when they are awaited.
    pub(super) awaited: HashMap<PageKey, Instant>,
    /// When all corners that waited were last looked at.
    pub(super) all_at: Option<Instant>,
    /// Pages taken, and the milliseconds spent on them.
    pub(super) taken: u64,
    pub(super) take_ms: f64,
}

impl Asked {
    /// Forgets the pages, but not the counts.
    pub(super) fn forget(&mut self) {
        self.asked.clear();
        self.awaited.clear();
        self.all_at = None;
    }

    /// Whether a cell of a corner is awaited.
    pub(super) fn awaits(&self, corner: CellKey, now: Instant) -> bool {
        let is_awaited = |page: &PageKey| self.awaited.get(page).is_some_and(|until| *until > now);
        !self.awaited.is_empty() && corner.corner().any(|(_, key)| is_awaited(&key.in_page().0))
    }
}

impl Default for SharedCells {
    fn default() -> Self {
        Self(Mutex::new(State {
            store: Store::new(MOST_BYTES),
            queue: Queue::default(),
            refined: Vec::new(),
            may_refine: false,
            inputs: None,
            content: None,
            asked: Asked::default(),
            job: Job::new(CellUse::Rays),
            began: Instant::now(),
            unspent: Duration::ZERO,
            costs: [FIRST_GUESS_MS; TIERS],
            ray_ms: None,
            filled: 0,
            fill_ms: 0.0,
            pixels: 0,
            pixels_lit: 0,
            kept: Kept::default(),
            faces: KnownFaces::default(),
            poses: 0,
        }))
    }
}

impl SharedCells {
    pub(super) fn lock(&self) -> MutexGuard<'_, State> {
        // A panic leaves no cell half filled.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Job {
    pub(super) fn new(asked: CellUse) -> Self {
        Self { asked, lags: false, found: None, shows_older: false, reflected: None }
    }
}

impl State {
    /// Forgets all cells.
    pub(super) fn forget(&mut self) {
        self.store.clear();
        self.queue = Queue::default();
        self.refined.clear();
        self.may_refine = false;
        self.content = None;
        self.asked.forget();
        self.inputs = None;
        self.faces.forget();
    }

    /// Keeps the cells that changes leave as they are.
    fn keep_untouched(&mut self, changes: &Changes) {
        let Kept { kept, touched } = self.store.keep_untouched(changes);
        self.kept = Kept { kept: self.kept.kept + kept, touched: self.kept.touched + touched };
        self.faces.keep_untouched(changes, &self.store);
        self.refined.clear();
        self.content = None;
        self.asked.forget();
    }

    /// Counts points that asked for cells, and answers that are light of cells.
    pub(super) fn count(&mut self, points: &ShadingPoints, answers: &[Answer]) {
        self.pixels += existing(points) as u64;
        self.pixels_lit +=
            answers.par_iter().filter(|answer| matches!(answer, Answer::Light(_))).count() as u64;
    }

    /// Milliseconds for which an open view of so many texels with a surface fills cells that it lacks.
    pub(super) fn view_fills_ms(&self, texels: f64) -> f64 {
        let by_rays = self.ray_ms.map_or(0.0, |ms| ms * texels);
        (VIEW_FILLS_SHARE * by_rays).max(VIEW_FILLS_MS)
    }

    /// Begins another job.
    pub(super) fn begin(&mut self, job: Job) {
        let now = Instant::now();
        self.unspent = now.saturating_duration_since(self.began);
        (self.job, self.began) = (job, now);
        self.store.begin_job();
    }

    /// For how long the present job fills cells that earlier views lacked: once, and a share of the time since the job before it. If
    /// that was long, somebody else filled them.
    pub(super) fn time_for_waiting(&mut self) -> Duration {
        std::mem::take(&mut self.unspent).mul_f64(WAITING_SHARE).min(MOST_ON_WAITING)
    }

    /// Learns the time of light by rays at so many texels, which cast one of `divisor`.
    pub(super) fn took_rays(&mut self, texels: f64, divisor: u32, took: Duration) {
        /// Share of the newest measurement.
        const NEW: f64 = 0.25;
        if texels > 0.0 {
            let ms = took.as_secs_f64() * 1e3 * f64::from(divisor) / texels;
            self.ray_ms = Some(self.ray_ms.map_or(ms, |before| before + (ms - before) * NEW));
        }
    }

    /// Takes over another pose or lighting: forgets the cells that are not the same there. `content` names what the cells are of.
    pub(super) fn relight(&mut self, inputs: &CellInputs, content: impl FnOnce() -> Option<CellContent>) {
        if !self.inputs.as_ref().is_some_and(|known| known.is(inputs)) {
            match self.inputs.as_ref().and_then(|before| Changes::between(before, inputs)) {
                Some(changes) => self.keep_untouched(&changes),
                None => self.forget(),
            }
            self.inputs = Some(inputs.clone());
            self.poses += 1;
        }
        self.content.get_or_insert_with(content);
    }
}

/// Texels with a surface.
pub(super) fn existing(points: &ShadingPoints) -> f64 {
    points.all.par_iter().filter(|point| point.exists).count() as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_job_fills_what_waits_once_and_for_a_share_of_the_time_since_the_last() {
        let cells = SharedCells::default();
        let mut state = cells.lock();
        std::thread::sleep(Duration::from_millis(20));
        state.begin(Job::new(CellUse::Open));
        assert!(state.time_for_waiting() >= Duration::from_millis(3));
        assert_eq!(state.time_for_waiting(), Duration::ZERO);
        state.unspent = Duration::from_secs(100);
        assert_eq!(state.time_for_waiting(), MOST_ON_WAITING);
    }

    #[test]
    fn a_view_fills_for_half_of_what_its_rays_take_or_for_a_slice() {
        let cells = SharedCells::default();
        let mut state = cells.lock();
        assert_eq!(state.view_fills_ms(1e6), VIEW_FILLS_MS, "nothing is known of rays");
        state.took_rays(0.0, 1, Duration::from_secs(1));
        assert_eq!(state.view_fills_ms(1e6), VIEW_FILLS_MS, "nothing was lit");
        state.took_rays(1000.0, 4, Duration::from_millis(25));
        assert_eq!(state.view_fills_ms(2000.0), 100.0);
        assert_eq!(state.view_fills_ms(10.0), VIEW_FILLS_MS);
        state.took_rays(1000.0, 1, Duration::from_millis(300));
        assert_eq!(state.view_fills_ms(2000.0), 150.0, "a quarter of what is new");
    }
}
