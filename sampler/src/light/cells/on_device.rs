//! Lookups that a device makes: what it is asked, and what follows from what it found.
//!
//! A device finds out which tier all cells of a tile have, and looks that tier up; nothing is read in between. What it found is
//! read with the finished image, where cells are expected to be whole, and at once elsewhere. Where cells lack, the CPU fills
//! them, and the device looks up again.

use std::sync::atomic::Ordering;
use std::sync::{Arc, PoisonError};

use argus_gpu::Gpu;
use argus_scene::RenderError;
use argus_shaders::layout::surface_light::{CellEye, CellQuery};
use glam::{IVec3, Vec3};

use super::super::lattice::{CellKey, Lattice, PageKey};
use super::lookup::sorted;
use super::sharing;
use super::state::{CellUse, Job, State, VIEW_FILLS_MS};
use super::store::TIERS;
use super::{Eye, LightCells, Parts, tier_of};
use crate::lit_cells::{CellOutcome, CellsAbout, MOST_LACKING};

/// Corners that are filled at once.
const CORNERS_AT_ONCE: usize = 1 << 14;

/// A lookup of a tile's texels.
pub(in crate::light) struct DeviceLookup {
    pub(in crate::light) cells: CellsAbout,
    /// The pages in the order of their places on the device.
    pages: Arc<Vec<PageKey>>,
    wanted: Wanted,
    /// Whether the texels are points that reflections show.
    reflected: bool,
    texels: u64,
}

/// The texels that ask for cells.
#[derive(Clone, Copy)]
pub(in crate::light) struct Asking<'a> {
    pub(in crate::light) texels: u32,
    /// Mean sides of the areas that they stand for, metres; none for what pixels show.
    pub(in crate::light) across: &'a [f32],
}

/// What a job wants of cells.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Wanted {
    /// This tier: cells that lack it are filled.
    Tier(usize),
    /// The best tier that all cells have, up to this one.
    Best(usize),
    /// Nothing, but that cells of the first tier are filled later.
    Later,
}

impl Wanted {
    /// Number of tiers that all cells must have.
    fn needed(self) -> usize {
        match self {
            Wanted::Tier(tier) => tier + 1,
            Wanted::Best(_) | Wanted::Later => 1,
        }
    }

    /// The best tier that is asked for.
    fn best(self) -> usize {
        match self {
            Wanted::Tier(tier) | Wanted::Best(tier) => tier,
            Wanted::Later => 0,
        }
    }
}

impl LightCells {
    /// Begins a lookup of texels; `None` if the job is lit by rays.
    ///
    /// # Errors
    /// [`RenderError::OutOfMemory`] if the cells are larger than the device can bind.
    pub(in crate::light) fn begin_on_device(
        &self,
        parts: Parts<'_>,
        eye: Eye<'_>,
        gpu: &Gpu,
        asking: Asking<'_>,
    ) -> Result<Option<DeviceLookup>, RenderError> {
        let mut state = self.state();
        let scene = self.scene(parts);
        state.relight(parts.inputs, || sharing::content_of(&scene));
        let wanted = match eye.reflected {
            true => state.job.wanted_of_reflected(),
            false => state.job.wanted(tier_of(self.settings.rays)),
        };
        let Some(wanted) = wanted else { return Ok(None) };
        if matches!(wanted, Wanted::Best(_)) {
            state.fill_waiting(&scene);
        }
        let mut mirror = self.mirror.lock().unwrap_or_else(PoisonError::into_inner);
        let (buffers, pages) = mirror.synchronise(gpu, &state.store)?;
        let places = scene.lattice.about(eye.position - scene.leaves.center());
        let eyes = eyes_of(scene.lattice, &places);
        let pixels = self.settings.pixels as f32;
        let (reflected, texels) = (eye.reflected, u64::from(asking.texels));
        let query = CellQuery {
            edge: scene.lattice.edge,
            edge_by_distance: pixels * eye.pixel,
            edge_by_side: pixels,
            tier: wanted.best() as u32,
            needed: wanted.needed() as u32,
        };
        let cells = CellsAbout::new(gpu, buffers, query, &eyes, asking.across, self.lacking(gpu));
        Ok(Some(DeviceLookup { cells, pages, wanted, reflected, texels }))
    }

    /// Whether the last lookup of a device found all cells, so that the next one probably will.
    pub(in crate::light) fn are_expected_whole(&self) -> bool {
        self.expects_whole.load(Ordering::Relaxed)
    }

    /// Takes over what a device found. Returns whether the tile is lit by cells: false if some lack.
    pub(in crate::light) fn accept(&self, lookup: &DeviceLookup, outcome: &CellOutcome) -> bool {
        let mut state = self.state();
        let used = lookup.pages.iter().zip(&outcome.used).filter(|(_, used)| **used);
        used.for_each(|(page, _)| state.store.touch(*page));
        let tiers = TIERS - (outcome.lacks as usize).min(TIERS);
        let is_lit = tiers >= lookup.wanted.needed() && lookup.wanted != Wanted::Later;
        if !lookup.reflected {
            self.expects_whole.store(is_lit, Ordering::Relaxed);
        }
        if is_lit && lookup.reflected {
            state.job.reflected = Some(true);
        } else if is_lit {
            let (tier, best) = ((tiers - 1).min(lookup.wanted.best()), tier_of(self.settings.rays));
            state.may_refine |= state.job.asked == CellUse::Open && tier < best;
            state.job.found = Some(Some(tier));
        }
        if is_lit {
            state.count_texels(lookup.texels, outcome);
        }
        is_lit
    }

    /// Fills the cells of corners that a device found lacking. Returns false if they wait in the queue instead, and the job is lit by
    /// rays: an open view waits only for few.
    pub(in crate::light) fn fill_lacking(
        &self,
        parts: Parts<'_>,
        lookup: &DeviceLookup,
        outcome: &CellOutcome,
        numbers: &[u64],
    ) -> bool {
        let mut state = self.state();
        let corners = sorted(numbers.iter().copied().filter_map(CellKey::from_number).collect());
        let ms = state.costs[0] * corners.len() as f64;
        let waits = !matches!(state.job.asked, CellUse::Held { .. });
        let are_few = waits && outcome.lacking <= MOST_LACKING && ms <= VIEW_FILLS_MS;
        let fills = matches!(lookup.wanted, Wanted::Tier(_)) || lookup.wanted != Wanted::Later && are_few;
        if !fills || corners.is_empty() {
            state.queue.add(corners);
            match lookup.reflected {
                true => state.job.reflected = Some(false),
                false => state.job.found = Some(None),
            }
            state.pixels += lookup.texels.saturating_sub(u64::from(outcome.nothing));
            return false;
        }
        let scene = self.scene(parts);
        for corners in corners.chunks(CORNERS_AT_ONCE) {
            state.fill_corners(&scene, corners, lookup.wanted.needed() - 1);
        }
        state.store.keep_bound();
        true
    }

    /// Room for the numbers of corners that lack.
    fn lacking(&self, gpu: &Gpu) -> argus_gpu::wgpu::Buffer {
        use argus_gpu::wgpu::BufferUsages;
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_SRC;
        let make = || gpu.buffer("corners that lack", u64::from(MOST_LACKING) * 8, usage);
        self.lacking.get_or_init(make).clone()
    }
}

impl Job {
    /// What its own pixels want, of which `best` is the best tier; `None` if rays light them.
    fn wanted(&mut self, best: usize) -> Option<Wanted> {
        match (self.asked, self.found) {
            (CellUse::Rays | CellUse::Later, _) | (_, Some(None)) => {
                self.found = Some(None);
                None
            }
            (CellUse::Whole { rays, .. }, _) => Some(Wanted::Tier(tier_of(rays))),
            (CellUse::Open | CellUse::Held { .. }, Some(Some(tier))) => Some(Wanted::Tier(tier)),
            (CellUse::Held { rays, .. }, None) => Some(Wanted::Best(best.min(tier_of(rays)))),
            (CellUse::Open, None) => Some(Wanted::Best(best)),
        }
    }

    /// What points that its reflections show want, always of the first tier; `None` if rays light them. An open view whose own pixels
    /// have cells does not wait for those of its reflections.
    fn wanted_of_reflected(&mut self) -> Option<Wanted> {
        match (self.asked, self.reflected) {
            (CellUse::Rays | CellUse::Later, _) => None,
            (CellUse::Whole { reflected, .. }, _) => {
                self.reflected = Some(reflected);
                reflected.then_some(Wanted::Tier(0))
            }
            (CellUse::Held { reflected: false, .. }, _) => {
                self.reflected = Some(false);
                None
            }
            (CellUse::Open | CellUse::Held { .. }, _) if self.found.flatten().is_none() => {
                Some(Wanted::Later)
            }
            (CellUse::Open | CellUse::Held { .. }, Some(true)) => Some(Wanted::Tier(0)),
            (CellUse::Open | CellUse::Held { .. }, Some(false)) => Some(Wanted::Later),
            (CellUse::Open | CellUse::Held { .. }, None) => Some(Wanted::Best(0)),
        }
    }
}

impl State {
    /// Counts texels that asked for cells, and those that cells lit.
    fn count_texels(&mut self, texels: u64, outcome: &CellOutcome) {
        let shown = texels.saturating_sub(u64::from(outcome.nothing));
        self.pixels += shown;
        self.pixels_lit += shown.saturating_sub(u64::from(outcome.alone));
    }
}

/// The eye in the cells of each level.
fn eyes_of(lattice: Lattice, places: &[Option<(IVec3, Vec3)>]) -> Vec<CellEye> {
    let eye = |(level, place): (u32, &Option<(IVec3, Vec3)>)| {
        let (cell, within) = place.unwrap_or_default();
        CellEye {
            cell: cell.to_array(),
            exists: u32::from(place.is_some()),
            within: within.to_array(),
            spacing: lattice.spacing(level),
        }
    };
    (0..).zip(places).map(eye).collect()
}
