//! Light cells: the light of the sky and of other surfaces, kept on surfaces and looked up by all views.
//!
//! Both vary slowly over a surface, and do not depend on who looks. So they are computed once for a *cell* of a lattice
//! over the scene, when a view first needs it, and kept for later views and samples of all viewers. Relatives are
//! irradiance caching (Ward, Rubinstein and Clear, "A Ray Tracing Solution for Diffuse Interreflection", 1988) and spatial
//! hashes of radiance (Binder, Fricke and Keller, "Fast Path Space Filtering by Jittered Spatial Hashing", 2018).
//!
//! What a cell holds is a pure function of the scene's pose, its lighting, the cell and the number of rays. So the cells
//! are only a cache: equal plans give equal bytes, in whatever order cells were filled or evicted. All sums are made in a
//! fixed order, for each cell by one thread.
//!
//! # Steps
//!
//! 1. [`super::lattice`]: the lattice. A cell has a level, whose spacing halves from one to the next, and three numbers.
//! 2. [`sides`]: what lies in a cell and faces the same way; [`tree`] finds its triangles.
//! 3. [`rays`]: the light that arrives at a side, by 16 rays, by 64 or by 256: its *tiers*.
//! 4. [`corner`]: which of the eight cells of a lookup have a wall between them.
//! 5. [`store`]: holds what is filled, within a bound.
//! 6. [`lookup`]: pixels take the mean of the sides around them.
//! 7. [`alone`]: pixels that no side describes cast rays of their own.
//! 8. [`sharing`]: samplers of one scene and lighting send one another their cells.
//!
//! A view's own pixels are lit by cells of one tier throughout, or by rays throughout, and so is all that its reflections show,
//! so that a frame can be repeated. [`CellUse`] says which a job asks for. Cells that an open view lacks are filled later, in slices ([`LightCells::fill_slice`]).

mod alone;
mod corner;
mod filling;
mod lookup;
mod queue;
mod rays;
mod scene;
mod sharing;
mod sides;
mod state;
mod store;
mod tree;

use std::sync::{Arc, MutexGuard};
use std::time::{Duration, Instant};

use argus_scene::{CellPages, CellReport, CellSettings, Lighting, SurfaceLight};
use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::lattice::CellKey;
use super::paths::Leaves;
use super::shading_points::ShadingPoints;
use crate::light_rays::LightRaysAbout;
use crate::surfaces::Surfaces;
use alone::Surroundings;
use lookup::{Answer, Lookup, only};
use scene::{CellScene, RAYS, Sequence};
use state::{Job, SharedCells, State};
use store::Store;

pub(super) use lookup::CellLight;
pub(crate) use state::CellUse;
pub(super) use tree::BoxTree;

/// Longest time for which an open view fills cells that it lacks, milliseconds, as predicted.
const VIEW_FILLS_MS: f64 = 20.0;
/// Pixels from one to the next, in each direction, that are asked before a view whether its cells are filled. Cells are
/// about as wide.
const ASKED: usize = 4;
/// What is found to lack among them may be so many times as much among all pixels.
const LACKS_MORE: f64 = 1.5;
/// Pause while all cells that lack are awaited from other samplers.
const PAUSE: Duration = Duration::from_millis(1);
/// Corners that are filled between two looks at the clock.
const CORNERS_AT_ONCE: usize = 48;

/// The scene's parts, as a caller has them.
#[derive(Clone, Copy)]
pub(super) struct Parts<'a> {
    pub(super) leaves: &'a Leaves,
    pub(super) tree: &'a BoxTree,
    pub(super) surfaces: &'a Surfaces,
    pub(super) about: &'a LightRaysAbout<'a>,
    pub(super) lighting: &'a Lighting,
    pub(super) radiance: &'a [Vec3],
}

/// Where pixels are seen from.
#[derive(Clone, Copy)]
pub(super) struct Eye<'a> {
    pub(super) position: DVec3,
    /// The scene about it.
    pub(super) about: &'a LightRaysAbout<'a>,
    /// Angle of a pixel, radians.
    pub(super) pixel: f32,
    /// Whether its reflections are looked up instead of its own pixels.
    pub(super) reflected: bool,
}

/// What is asked of cells: the light at points of a scene, seen from an eye.
#[derive(Clone, Copy)]
struct Question<'a> {
    scene: &'a CellScene<'a>,
    points: &'a ShadingPoints,
    eye: Eye<'a>,
}

/// The light cells of one scene.
pub(crate) struct LightCells {
    settings: CellSettings,
    sequence: Sequence,
    state: Arc<SharedCells>,
}

impl LightCells {
    pub(crate) fn new(settings: CellSettings) -> Self {
        Self { settings, sequence: Sequence::new(), state: Arc::default() }
    }

    pub(crate) fn settings(&self) -> CellSettings {
        self.settings
    }

    /// Forgets all cells: surfaces moved.
    pub(crate) fn forget(&mut self) {
        self.state().forget();
    }

    /// Begins a job.
    pub(crate) fn begin(&self, asked: CellUse) {
        let mut state = self.state();
        state.job = Job::new(asked);
        state.store.begin_job();
    }

    /// What the job is lit by so far; rays before any of it is.
    pub(crate) fn light(&self) -> SurfaceLight {
        let state = self.state();
        let cells = |tier: usize| SurfaceLight::Cells {
            rays: RAYS[tier] as u32,
            reflected: state.job.reflected.unwrap_or(true),
        };
        state.job.found.flatten().map_or(SurfaceLight::Rays, cells)
    }

    /// What the cells are.
    pub(crate) fn report(&self) -> CellReport {
        let state = self.state();
        CellReport {
            pages: state.store.pages(),
            cells: state.store.cells(),
            bytes: state.store.bytes(),
            filled: state.filled,
            fill_ms: state.fill_ms,
            waiting: state.queue.len(),
            pixels: state.pixels,
            pixels_lit: state.pixels_lit,
            pages_taken: state.asked.taken,
            take_ms: state.asked.take_ms,
            is_due: state.queue.len() > 0 || state.may_refine,
        }
    }

    /// The cells' pages, for other threads.
    pub(crate) fn pages(&self) -> Arc<dyn CellPages> {
        self.state.clone()
    }

    /// Looks the light of texels up; `None` if the job is lit by rays.
    pub(super) fn look_up(
        &self,
        parts: Parts<'_>,
        points: &ShadingPoints,
        eye: Eye<'_>,
    ) -> Option<Vec<CellLight>> {
        let mut state = self.state();
        let scene = self.scene(parts);
        state.relight(parts.lighting, || sharing::content_of(&scene));
        let question = Question { scene: &scene, points, eye };
        let answers = match eye.reflected {
            true => self.of_reflected(&mut state, question),
            false => self.of_pixels(&mut state, question),
        };
        if state.job.asked != CellUse::Rays {
            state.count(points, answers.as_deref().unwrap_or_default());
        }
        Some(with_alone(question, &answers?))
    }

    /// The answers of the job's own pixels; `None` if it is lit by rays.
    fn of_pixels(&self, state: &mut State, question: Question<'_>) -> Option<Vec<Answer>> {
        let light = match (state.job.asked, state.job.found) {
            (CellUse::Rays, _) | (_, Some(None)) => None,
            (CellUse::Whole { rays, .. }, _) => Some((tier_of(rays), None)),
            (_, Some(Some(tier))) => Some((tier, None)),
            (CellUse::Open, None) => self.best(state, question).map(|(tier, answers)| (tier, Some(answers))),
        };
        state.job.found = Some(light.as_ref().map(|(tier, _)| *tier));
        match light? {
            (_, Some(answers)) => Some(answers),
            (tier, None) => self.answers(state, question, tier, f64::INFINITY),
        }
    }

    /// The answers of points that the job's reflections show, always of the first tier; `None` if rays light them. An open view
    /// whose own pixels have cells does not wait for those of its reflections.
    fn of_reflected(&self, state: &mut State, question: Question<'_>) -> Option<Vec<Answer>> {
        let has_cells = match (state.job.asked, state.job.reflected) {
            (CellUse::Rays, _) => return None,
            (CellUse::Whole { reflected, .. }, _) => Some(reflected),
            (CellUse::Open, _) if state.job.found.flatten().is_none() => Some(false),
            (CellUse::Open, known) => known,
        };
        let answers = match has_cells {
            Some(true) => self.answers(state, question, 0, f64::INFINITY),
            Some(false) => None,
            None => self.answers_soon(state, question, 0),
        };
        if state.job.asked == CellUse::Open && has_cells == Some(false) {
            let missing = self.lookup(&state.store, question, 0).missing(question.points, ASKED);
            state.queue.add(missing);
        }
        state.job.reflected = Some(answers.is_some());
        answers
    }

    /// The best tier that a view has, with its answers; `None` if it has none and waits for none.
    fn best(&self, state: &mut State, question: Question<'_>) -> Option<(usize, Vec<Answer>)> {
        for tier in (0..=tier_of(self.settings.rays)).rev() {
            if let Some(answers) = self.answers_soon(state, question, tier) {
                state.may_refine |= tier < tier_of(self.settings.rays);
                return Some((tier, answers));
            }
        }
        None
    }

    /// The answers of a tier if they are there, or for the first tier soon would be; else `None`, and cells of the first tier wait
    /// in the queue.
    fn answers_soon(&self, state: &mut State, question: Question<'_>, tier: usize) -> Option<Vec<Answer>> {
        let missing = self.lookup(&state.store, question, tier).missing(question.points, ASKED);
        let within = state.costs[tier] * missing.len() as f64 * LACKS_MORE <= VIEW_FILLS_MS;
        // Better light is no reason to wait.
        let found = match within && (tier == 0 || missing.is_empty()) {
            true => self.answers(state, question, tier, VIEW_FILLS_MS),
            false => None,
        };
        if found.is_none() && tier == 0 {
            state.queue.add(missing);
        }
        found
    }

    /// The answers of a tier; cells that lack are filled if that is predicted to take no longer than `most_ms`, else they wait
    /// in the queue, and `None` is returned.
    fn answers(
        &self,
        state: &mut State,
        question: Question<'_>,
        tier: usize,
        most_ms: f64,
    ) -> Option<Vec<Answer>> {
        let mut answers = vec![Answer::Missing; question.points.all.len()];
        loop {
            let missing = self.lookup(&state.store, question, tier).look_up(question.points, &mut answers);
            if missing.is_empty() {
                return Some(answers);
            }
            if state.costs[tier] * missing.len() as f64 > most_ms {
                if tier == 0 {
                    state.queue.add(missing);
                }
                return None;
            }
            for corners in missing.chunks(1 << 14) {
                state.fill_corners(question.scene, corners, tier);
            }
            state.store.keep_bound();
        }
    }

    /// Fills cells that views lacked and that are not awaited from other samplers, then with `refines` refines those that were used
    /// last, for about so long. Returns whether there is more to do.
    pub(super) fn fill_slice(&self, parts: Parts<'_>, time: Duration, refines: bool) -> bool {
        let begin = Instant::now();
        let mut guard = self.state();
        let (state, scene) = (&mut *guard, self.scene(parts));
        state.relight(parts.lighting, || sharing::content_of(&scene));
        while begin.elapsed() < time {
            let (State { queue, store, asked, .. }, now) = (&mut *state, Instant::now());
            let lacks = |key: CellKey| !store.is_whole(key, 0);
            let corners = queue.take(CORNERS_AT_ONCE, lacks, |key| asked.awaits(key, now));
            if !corners.is_empty() {
                state.fill_corners(&scene, &corners, 0);
                state.may_refine = true;
            } else if !refines || !state.refine(&scene, tier_of(self.settings.rays)) {
                let (awaits, may_refine) = (state.queue.len() > 0, state.may_refine);
                drop(guard);
                if awaits {
                    std::thread::sleep(PAUSE);
                }
                return awaits || may_refine;
            }
            state.store.keep_bound();
        }
        true
    }

    fn scene<'a>(&'a self, parts: Parts<'a>) -> CellScene<'a> {
        let Parts { leaves, tree, surfaces, about, lighting, radiance } = parts;
        let (lattice, sky, sequence) = (leaves.lattice(), &lighting.sky, &self.sequence);
        CellScene { lattice, leaves, tree, surfaces, about, sky, radiance, sequence }
    }

    fn lookup<'a>(&self, store: &'a Store, question: Question<'a>, tier: usize) -> Lookup<'a> {
        let Question { scene, eye, .. } = question;
        let places = scene.lattice.about(eye.position - scene.leaves.center());
        let pixels = self.settings.pixels as f32;
        Lookup {
            store,
            lattice: scene.lattice,
            about: eye.about,
            eye: places,
            tier,
            pixels,
            pixel: eye.pixel,
        }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock()
    }
}

/// Adds the light of pixels that cast rays of their own.
fn with_alone(question: Question<'_>, answers: &[Answer]) -> Vec<CellLight> {
    let Question { scene, points, eye } = question;
    let is_alone = |index: usize| !matches!(answers[index], Answer::Light(_) | Answer::Nothing);
    let alone = (0..answers.len()).into_par_iter().any(is_alone).then(|| {
        let from_eye = (eye.position - scene.leaves.center()).as_vec3();
        let (about, leaves, radiance, sky) = (eye.about, scene.leaves, scene.radiance, scene.sky);
        Surroundings { about, leaves, radiance, sky, from_eye }.light(&only(points, is_alone))
    });
    let light = |(index, answer): (usize, &Answer)| match answer {
        Answer::Light(light) => *light,
        Answer::Nothing => CellLight::default(),
        Answer::Alone | Answer::Missing => alone.as_ref().map_or(CellLight::default(), |all| all[index]),
    };
    answers.par_iter().enumerate().map(light).collect()
}

/// The tier with at most so many rays.
fn tier_of(rays: u32) -> usize {
    RAYS.iter().rposition(|most| *most <= rays as usize).unwrap_or(0)
}
