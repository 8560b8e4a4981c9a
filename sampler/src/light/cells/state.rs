//! What a sampler keeps of its cells, behind a lock.

use std::collections::HashMap;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use argus_scene::{CellContent, Lighting, SurfaceLight};

use super::super::lattice::{CellKey, PageKey};
use super::super::shading_points::ShadingPoints;
use super::lookup::Answer;
use super::queue::Queue;
use super::store::{Store, TIERS};

/// Most memory of cells: 1.6 M sides of 16 rays take 110 MB.
const MOST_BYTES: usize = 256 << 20;
/// Milliseconds of a corner or refined cell, before any is measured.
const FIRST_GUESS_MS: f64 = 0.05;

/// What a job asks of the light of sky and surfaces.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum CellUse {
    /// Rays from each pixel.
    Rays,
    /// Cells of the best tier that all of the view has, or soon would have; else rays.
    Open,
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
            None => Self::Open,
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
    /// The lighting that the cells are of.
    pub(super) lighting: Option<Lighting>,
    /// What the cells are of, once that is known; `None` within if it has no name.
    pub(super) content: Option<Option<CellContent>>,
    pub(super) asked: Asked,
    pub(super) job: Job,
    /// Milliseconds of a corner of the first tier and of a cell's refinement to each further one.
    pub(super) costs: [f64; TIERS],
    pub(super) filled: u64,
    pub(super) fill_ms: f64,
    /// Pixels that asked for cells, and those that cells lit.
    pub(super) pixels: u64,
    pub(super) pixels_lit: u64,
}

/// The light of the present job.
pub(super) struct Job {
    pub(super) asked: CellUse,
    /// The tier of its own pixels, once that is known; `None` within for rays.
    pub(super) found: Option<Option<usize>>,
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
    /// Pages taken, and the milliseconds spent on them.
    pub(super) taken: u64,
    pub(super) take_ms: f64,
}

impl Asked {
    /// Forgets the pages, but not the counts.
    pub(super) fn forget(&mut self) {
        self.asked.clear();
        self.awaited.clear();
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
            lighting: None,
            content: None,
            asked: Asked::default(),
            job: Job::new(CellUse::Rays),
            costs: [FIRST_GUESS_MS; TIERS],
            filled: 0,
            fill_ms: 0.0,
            pixels: 0,
            pixels_lit: 0,
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
        Self { asked, found: None, reflected: None }
    }
}

impl State {
    pub(super) fn forget(&mut self) {
        self.store.clear();
        self.queue = Queue::default();
        self.refined.clear();
        self.may_refine = false;
        self.content = None;
        self.asked.forget();
    }

    /// Counts points that asked for cells, and answers that are light of cells.
    pub(super) fn count(&mut self, points: &ShadingPoints, answers: &[Answer]) {
        self.pixels += points.all.iter().filter(|point| point.exists).count() as u64;
        self.pixels_lit += answers.iter().filter(|answer| matches!(answer, Answer::Light(_))).count() as u64;
    }

    /// Forgets the cells of another lighting, and has `content` name what the cells are of.
    pub(super) fn relight(&mut self, lighting: &Lighting, content: impl FnOnce() -> Option<CellContent>) {
        if self.lighting.as_ref() != Some(lighting) {
            self.forget();
            self.lighting = Some(lighting.clone());
        }
        self.content.get_or_insert_with(content);
    }
}
