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
//! 7. [`alone`]: pixels that no side describes cast rays of their own. Then [`super::filter`] joins those, and pixels
//!    lit by cells of few rays, with what is around them.
//! 8. [`sharing`]: samplers of one scene and lighting send one another their cells.
//! 9. [`record`]: what the rays of a page met, in a scene that moves. [`changes`]: which pages the next pose or lighting leaves as
//!    they are. The others are *older*: open views show them until they are filled anew, and say so.
//! 10. [`mirror`] and [`on_device`]: a device looks cells up in a copy of its own.
//!
//! A view's own pixels are lit by cells of one tier throughout, or by rays throughout, and so is all that its reflections show,
//! so that a frame can be repeated. [`CellUse`] says which a job asks for. Cells that an open view lacks are filled later, in slices ([`LightCells::fill_slice`]).

mod alone;
mod blocks;
mod changes;
mod corner;
mod corner_cache;
mod faces;
mod filling;
#[cfg(feature = "fuzzing")]
pub(crate) mod fuzzing;
mod inputs;
mod lookup;
mod mirror;
mod on_device;
mod queue;
mod rays;
mod record;
mod scene;
mod sharing;
mod sides;
mod state;
mod store;
#[cfg(test)]
mod tests;
mod trail;
mod tree;
mod unchanged;
mod weighing;

use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex, MutexGuard, OnceLock};
use std::time::{Duration, Instant};

use argus_gpu::wgpu;
use argus_scene::{CellPages, CellReport, CellSettings, SurfaceLight};
use glam::DVec3;
use rayon::prelude::*;

use super::filter::{Listed, REACH_OF_CELLS, smoothed_at};
use super::lattice::CellKey;
use super::shading_points::ShadingPoints;
use crate::light_rays::{LightRaysAbout, has_avx2};
use crate::surfaces::Surfaces;
use alone::Surroundings;
use blocks::Blocks;
use lookup::{Answer, Lookup};
use mirror::CellMirror;
use scene::{CellScene, RAYS, Sequence};
use state::{Job, SharedCells, State, existing};

pub(super) use alone::RAYS as ALONE_RAYS;
pub(super) use faces::FaceLights;
pub(crate) use faces::SampleOf;
pub(super) use inputs::CellInputs;
pub(super) use lookup::CellLight;
pub(super) use on_device::{Asking, DeviceLookup};
pub(crate) use state::CellUse;
pub(crate) use trail::Trail;
pub(super) use tree::BoxTree;

/// Pixels from one to the next, in each direction, that are asked before a view whether its cells are filled. Cells are
/// about as wide.
const ASKED: usize = 2;
/// What is found to lack among them may be so many times as much among all pixels.
const LACKS_MORE: f64 = 1.2;
/// Of a view that shows cells of an earlier pose, one of so many pixels may lack cells.
const MOST_LACKING: usize = 4;
/// Pause while all cells that lack are awaited from other samplers.
const PAUSE: Duration = Duration::from_millis(1);

/// The scene's parts, as a caller has them.
#[derive(Clone, Copy)]
pub(super) struct Parts<'a> {
    pub(super) inputs: &'a CellInputs,
    pub(super) surfaces: &'a Surfaces,
    pub(super) about: &'a LightRaysAbout<'a>,
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
    /// Where it is written down what the light was found by.
    pub(super) trail: Option<&'a Trail>,
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
    /// What a device holds of them.
    mirror: Mutex<CellMirror>,
    /// Room for the numbers of corners that a device found lacking.
    lacking: OnceLock<wgpu::Buffer>,
    /// Whether a device will probably find all cells.
    expects_whole: AtomicBool,
}

impl LightCells {
    pub(crate) fn new(settings: CellSettings) -> Self {
        Self {
            settings,
            sequence: Sequence::new(),
            state: Arc::default(),
            mirror: Mutex::default(),
            lacking: OnceLock::new(),
            expects_whole: AtomicBool::new(false),
        }
    }

    pub(crate) fn settings(&self) -> CellSettings {
        self.settings
    }

    /// Forgets all cells: surfaces exchange light in another way.
    pub(crate) fn forget(&mut self) {
        self.state().forget();
    }

    /// Begins a job. `lags`: it shows light of an earlier pose.
    pub(crate) fn begin(&self, asked: CellUse, lags: bool) {
        self.state().begin(Job { lags, ..Job::new(asked) });
    }

    /// What the job is lit by so far; rays before any of it is.
    pub(crate) fn light(&self) -> SurfaceLight {
        let state = self.state();
        let cells = |tier: usize| {
            let (rays, reflected) = (RAYS[tier] as u32, state.job.reflected.unwrap_or(true));
            match state.job.shows_older {
                false => SurfaceLight::Cells { rays, reflected },
                true => SurfaceLight::OlderCells { rays, reflected },
            }
        };
        match (state.job.found.flatten(), state.job.lags) {
            (Some(tier), _) => cells(tier),
            // Rays gathered what surfaces reflected in an earlier pose.
            (None, true) => SurfaceLight::OlderCells { rays: RAYS[0] as u32, reflected: false },
            (None, false) => SurfaceLight::Rays,
        }
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
            pages_kept: state.kept.kept as u64,
            pages_touched: state.kept.touched as u64,
            pages_older: state.store.older_pages(),
            faces_kept: state.faces.kept,
            faces_changed: state.faces.changed,
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
        // Cells of an earlier pose have no name with the surfaces of the present one.
        let lags = state.job.lags;
        state.relight(parts.inputs, || if lags { None } else { sharing::content_of(&scene) });
        let question = Question { scene: &scene, points, eye };
        let answers = match eye.reflected {
            true => self.of_reflected(&mut state, question),
            false => self.of_pixels(&mut state, question),
        };
        if state.job.asked != CellUse::Rays {
            state.count(points, answers.as_deref().unwrap_or_default());
        }
        if let Some(trail) = eye.trail {
            trail.add_pages(state.store.used_pages());
        }
        let answers = answers?;
        let lights = with_alone(question, &answers);
        // What reflections show has no neighbours in the image.
        Some(if eye.reflected { lights } else { joined(points, &answers, lights, state.job.found) })
    }

    /// The answers of the job's own pixels; `None` if it is lit by rays.
    fn of_pixels(&self, state: &mut State, question: Question<'_>) -> Option<Vec<Answer>> {
        let light = match (state.job.asked, state.job.found) {
            (CellUse::Later, _) => {
                // Those that lack wait in the queue.
                let _ = self.answers(state, question, 0, 0.0);
                None
            }
            (CellUse::Rays, _) | (_, Some(None)) => None,
            (CellUse::Whole { rays, .. }, _) => Some((tier_of(rays), None)),
            (CellUse::Held { rays, .. }, None) => {
                self.held(state, question, tier_of(rays)).map(|(tier, answers)| (tier, Some(answers)))
            }
            (_, Some(Some(tier))) if state.job.shows_older => {
                Some((tier, Some(self.older_answers(state, question, tier))))
            }
            (_, Some(Some(tier))) => Some((tier, None)),
            (CellUse::Open, None) if state.job.lags => {
                self.older(state, question).map(|(tier, answers)| (tier, Some(answers)))
            }
            (CellUse::Open, None) => {
                let found = self.best(state, question).or_else(|| self.older(state, question));
                found.map(|(tier, answers)| (tier, Some(answers)))
            }
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
            (CellUse::Rays | CellUse::Later, _) => return None,
            // Nothing is filled from light of an earlier pose.
            (CellUse::Open, _) if state.job.lags => return None,
            (CellUse::Whole { reflected, .. }, _) => Some(reflected),
            (CellUse::Held { reflected: false, .. }, _) => Some(false),
            (CellUse::Held { .. }, _) if state.job.found.flatten().is_none() => Some(false),
            (CellUse::Held { .. }, known) => known,
            (CellUse::Open, _) if state.job.found.flatten().is_none() => Some(false),
            (CellUse::Open, known) => known,
        };
        let answers = match has_cells {
            Some(true) => self.answers(state, question, 0, f64::INFINITY),
            Some(false) => None,
            None if state.job.asked != CellUse::Open => self.answers(state, question, 0, 0.0),
            None => self.answers_soon(state, question, 0, &self.corners_of(state, question)),
        };
        if state.job.asked == CellUse::Open && has_cells == Some(false) {
            self.ask(state, question);
        }
        state.job.reflected = Some(answers.is_some());
        answers
    }

    /// The best tier up to `most` that a view has without filling anything, with its answers.
    fn held(&self, state: &mut State, question: Question<'_>, most: usize) -> Option<(usize, Vec<Answer>)> {
        let most = most.min(tier_of(self.settings.rays));
        (0..=most).rev().find_map(|tier| Some((tier, self.answers(state, question, tier, 0.0)?)))
    }

    /// The best tier that a view has, with its answers; `None` if it has none and waits for none.
    fn best(&self, state: &mut State, question: Question<'_>) -> Option<(usize, Vec<Answer>)> {
        state.fill_waiting(question.scene);
        let corners = self.corners_of(state, question);
        for tier in (0..=tier_of(self.settings.rays)).rev() {
            if let Some(answers) = self.answers_soon(state, question, tier, &corners) {
                state.may_refine |= tier < tier_of(self.settings.rays);
                return Some((tier, answers));
            }
        }
        None
    }

    /// The best tier that nearly all of a view has where cells of an earlier pose count, too, until they are filled anew; `None` if it has
    /// none. Then the job says so. Rays light what is left.
    fn older(&self, state: &mut State, question: Question<'_>) -> Option<(usize, Vec<Answer>)> {
        if !state.job.lags && state.store.older_pages() == 0 {
            return None;
        }
        state.job.shows_older = true;
        let exist = question.points.all.iter().filter(|point| point.exists).count();
        let found = (0..=tier_of(self.settings.rays)).rev().find_map(|tier| {
            let answers = self.older_answers(state, question, tier);
            let lacking = answers.iter().filter(|answer| **answer == Answer::Missing).count();
            (lacking * MOST_LACKING <= exist).then_some((tier, answers))
        });
        state.job.shows_older = found.is_some();
        found
    }

    /// The answers of a tier where cells of an earlier pose count. What lacks waits in the queue.
    fn older_answers(&self, state: &mut State, question: Question<'_>, tier: usize) -> Vec<Answer> {
        let mut answers = vec![Answer::Missing; question.points.all.len()];
        let lacking = self.lookup(state, question, tier).look_up(question.points, &mut answers);
        state.queue.add(lacking);
        answers
    }

    /// The answers of a tier if they are there, or for the first tier soon would be; else `None`, and cells of the first tier wait
    /// in the queue. `corners` are those of some of the pixels.
    fn answers_soon(
        &self,
        state: &mut State,
        question: Question<'_>,
        tier: usize,
        corners: &[CellKey],
    ) -> Option<Vec<Answer>> {
        let missing = self.lookup(state, question, tier).lacking(corners);
        let most_ms = state.view_fills_ms(existing(question.points));
        let within = state.costs[tier] * missing.len() as f64 * LACKS_MORE <= most_ms;
        // Better light is no reason to wait.
        let found = match within && (tier == 0 || missing.is_empty()) {
            true => self.answers(state, question, tier, most_ms),
            false => None,
        };
        if found.is_none() && tier == 0 {
            self.ask(state, question);
        }
        found
    }

    /// Has the cells of the first tier that the pixels lack filled beside views.
    fn ask(&self, state: &mut State, question: Question<'_>) {
        let lookup = self.lookup(state, question, 0);
        let missing = lookup.lacking(&lookup.corners_of(question.points, 1));
        state.queue.add(missing);
    }

    /// The corners that some of the pixels look up.
    fn corners_of(&self, state: &State, question: Question<'_>) -> Vec<CellKey> {
        self.lookup(state, question, 0).corners_of(question.points, ASKED)
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
            let missing = self.lookup(state, question, tier).look_up(question.points, &mut answers);
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

    /// Learns the time of light by rays, of which texels cast one of `divisor`.
    pub(super) fn took_rays(&self, points: &ShadingPoints, divisor: u32, took: Duration) {
        self.state().took_rays(existing(points), divisor, took);
    }

    /// Fills cells that views lacked and that are not awaited from other samplers, then with `refines` refines those that were used
    /// last, for about so long. Returns whether there is more to do.
    pub(super) fn fill_slice(&self, parts: Parts<'_>, time: Duration, refines: bool) -> bool {
        let begin = Instant::now();
        let mut guard = self.state();
        let (state, scene) = (&mut *guard, self.scene(parts));
        state.relight(parts.inputs, || sharing::content_of(&scene));
        while begin.elapsed() < time {
            let refined = |state: &mut State| refines && state.refine(&scene, tier_of(self.settings.rays));
            if !state.fill_some(&scene) && !refined(state) {
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
        let Parts { inputs: CellInputs { leaves, tree, pose, lighting, radiance }, surfaces, about } = parts;
        let (lattice, sky, sequence) = (leaves.lattice(), &lighting.sky, &self.sequence);
        let blocks = pose.is_some().then(|| Blocks::new(&lattice));
        CellScene { lattice, leaves, tree, surfaces, about, sky, radiance, sequence, blocks }
    }

    fn lookup<'a>(&self, state: &'a State, question: Question<'a>, tier: usize) -> Lookup<'a> {
        let Question { scene, eye, .. } = question;
        let places = scene.lattice.about(eye.position - scene.leaves.center());
        let pixels = self.settings.pixels as f32;
        Lookup {
            store: &state.store,
            shows_older: state.job.shows_older,
            lattice: scene.lattice,
            eye: places,
            tier,
            pixels,
            pixel: eye.pixel,
            has_avx2: has_avx2(),
        }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock()
    }
}

/// The light of all pixels: those that cells do not describe cast rays of their own.
fn with_alone(question: Question<'_>, answers: &[Answer]) -> Vec<CellLight> {
    let Question { scene, points, eye } = question;
    let light = |answer: &Answer| match answer {
        Answer::Light(light) => *light,
        Answer::Nothing | Answer::Alone | Answer::Missing => CellLight::default(),
    };
    let mut lights: Vec<CellLight> = answers.par_iter().map(light).collect();
    let alone = Listed::of(points, |index| !matches!(answers[index], Answer::Light(_) | Answer::Nothing));
    if !alone.is_empty() {
        let from_eye = (eye.position - scene.leaves.center()).as_vec3();
        let (about, leaves, radiance, sky) = (eye.about, scene.leaves, scene.radiance, scene.sky);
        let surroundings = Surroundings { about, leaves, radiance, sky, from_eye, trail: eye.trail };
        let found = surroundings.light(points, &alone);
        alone.texels().zip(found).for_each(|(index, light)| lights[index] = light);
    }
    lights
}

/// Joins pixels that would stand out with those around them that show the same surface: pixels that cells do not describe, and all
/// of them where cells have the fewest rays, since those differ from one to the next. Other pixels keep what they have.
fn joined(
    points: &ShadingPoints,
    answers: &[Answer],
    mut lights: Vec<CellLight>,
    tier: Option<Option<usize>>,
) -> Vec<CellLight> {
    let is_first = tier.flatten() == Some(0);
    let stands_out = |index: usize| is_first || matches!(answers[index], Answer::Alone | Answer::Missing);
    let standing_out = Listed::of(points, stands_out);
    let smooth = smoothed_at(&lights, &standing_out, points, REACH_OF_CELLS);
    standing_out.texels().zip(smooth).for_each(|(index, light)| lights[index] = light);
    lights
}

/// The tier with at most so many rays.
fn tier_of(rays: u32) -> usize {
    RAYS.iter().rposition(|most| *most <= rays as usize).unwrap_or(0)
}
