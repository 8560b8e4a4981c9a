//! Where samples are taken beside the rig's own cameras: at its refinements, where views have holes.
//!
//! Every answered frame says how many of its pixels none of its samples saw. Unresolved pixels are counted for the
//! refinement *site* that would have seen most of them: the rig's refinement nearest to the viewpoint, of the coarsest
//! level that the view did not use already. Sites are given samples greedily, those with most uncovered pixels first,
//! within a budget of rendering time and of memory. A sample that is placed earns, with every view that uses it,
//! the pixels that it spares; in a full memory one that would spare twice as many replaces the least useful.
//!
//! Samplers render them when they have nothing else to do, compositors fetch them ahead of demand, and only what
//! is there is used: a view is never made to wait for one. What a view uses stands in its plan, so its bytes
//! remain a function of its provenance.
//!
//! Nothing moves without cause: accounts fade by half within [`HALF_LIFE_TICKS`], alike for all; what is placed
//! stays unless something twice as useful needs its room.

use std::collections::BTreeMap;

use argus_scene::rig::{MAX_LEVEL, Sight};
use argus_scene::{Camera, Rig};
use serde::Serialize;

/// A frame in which fewer of the pixels are uncovered is good enough. Half of what is promised on average, so
/// that views between those that were seen keep the promise too.
const BEARABLE: f64 = 0.0025;

/// Ticks in which an account fades by half: as long as a viewer may take to come back.
const HALF_LIFE_TICKS: f64 = 120.0;

/// In a full memory, a sample gives way to one that is this many times as useful.
const MARGIN: f64 = 2.0;

/// Sites below this many pixels are forgotten.
const NEGLIGIBLE: f64 = 1.0;

/// Sites that are remembered at most.
const MOST_SITES: usize = 4096;

/// Samples that may be placed at once after a pause.
const MOST_CREDIT: f64 = 4.0;

/// A sample that is not there after this many ticks was lost on its way; its site starts anew.
const GIVE_UP_TICKS: u32 = 120;

/// How far refining has come.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct Refinements {
    /// Places that views would gain from and that have no sample yet.
    pub wanted: u32,
    /// Samples that workers were told to have at hand.
    pub placed: u32,
    /// Those that are where views are composed, so that plans name them.
    pub usable: u32,
}

/// What may be spent on refinements.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Budget {
    /// Samples a tick.
    pub(super) per_tick: f64,
    /// Samples that may exist at the same time.
    pub(super) most: usize,
}

/// What views that were answered say of one refinement.
#[derive(Debug, Clone, Copy, Default)]
struct Site {
    /// Pixels that no sample saw, or that this one spared; fading.
    pixels: f64,
    /// Views that those were counted in, fading likewise.
    views: f64,
    placed: Option<Placed>,
}

/// A refinement that is given a sample.
#[derive(Debug, Clone, Copy)]
struct Placed {
    /// Pixels that it spares a view.
    gain: f64,
    /// It is where views are composed.
    there: bool,
    /// Ticks since it was ordered, as long as it is not there.
    waited: u32,
}

/// The refinements of a rig, as far as views had need of them.
#[derive(Debug, Clone, Default)]
pub(in crate::core) struct Placement {
    sites: BTreeMap<u64, Site>,
    credit: f64,
    /// Those that views may use, ascending.
    usable: Vec<u64>,
}

impl Placement {
    /// Refinements that a plan may name, ascending.
    pub(in crate::core) fn usable(&self) -> &[u64] {
        &self.usable
    }

    /// Refinements that shall be rendered and kept, ascending.
    pub(in crate::core) fn placed(&self) -> impl Iterator<Item = u64> {
        self.sites.iter().filter(|(_, site)| site.placed.is_some()).map(|(index, _)| *index)
    }

    /// Whether that refinement shall be rendered and kept.
    pub(in crate::core) fn is_placed(&self, index: u64) -> bool {
        self.sites.get(&index).is_some_and(|site| site.placed.is_some())
    }

    /// Sites that views have need of and no sample, those that are given one, and those of them that views may use.
    pub(in crate::core) fn counts(&self) -> Refinements {
        let placed = self.placed().count();
        Refinements {
            wanted: (self.sites.len() - placed) as u32,
            placed: placed as u32,
            usable: self.usable.len() as u32,
        }
    }

    /// A view was answered from the samples of these indices, and `uncovered` of its `pixels` none of them saw.
    pub(super) fn learn(
        &mut self,
        (rig, sight): (&Rig, Option<&dyn Sight>),
        camera: &Camera,
        used: &[u64],
        uncovered: u64,
        pixels: u64,
    ) {
        for index in used {
            if let Some(site) = self.sites.get_mut(index)
                && let Some(placed) = site.placed
            {
                site.pixels += placed.gain;
                site.views += 1.0;
            }
        }
        if !(uncovered as f64 > BEARABLE * pixels as f64) {
            return;
        }
        for level in 1..=MAX_LEVEL {
            let Some(index) = rig.refinement(camera, level, sight) else { return };
            // The view used it, or one of the rig's own in its place, and still has holes: a nearer one.
            if used.contains(&index) || rig.level(index) == Some(0) {
                continue;
            }
            let site = self.sites.entry(index).or_default();
            match site.placed {
                // There, and yet others served the view better.
                Some(placed) if placed.there => {}
                // On its way.
                Some(_) => return,
                None => {
                    site.pixels += uncovered as f64;
                    site.views += 1.0;
                    return;
                }
            }
        }
    }

    /// Says which of those that are placed are where views are composed. What was there stays usable until
    /// nobody has it, so that a compositor that joins takes nothing away.
    pub(super) fn update(&mut self, is_there: impl Fn(u64) -> bool, is_anywhere: impl Fn(u64) -> bool) {
        self.usable.clear();
        for (index, site) in &mut self.sites {
            let Some(placed) = &mut site.placed else { continue };
            placed.there = is_there(*index) || (placed.there && is_anywhere(*index));
            if placed.there {
                placed.waited = 0;
                self.usable.push(*index);
            }
        }
    }

    /// Gives a camera a sample, since it is part of a bundle that is worth its price: `pixels` is what it is worth a view,
    /// in the currency of holes.
    pub(super) fn invest(&mut self, index: u64, pixels: f64) {
        let site = self.sites.entry(index).or_default();
        site.pixels += pixels;
        site.views += 1.0;
        site.placed.get_or_insert(Placed { gain: pixels, there: false, waited: 0 });
    }

    /// A view used the samples of these cameras, and saved by that what is worth so many pixels of holes.
    pub(super) fn credit(&mut self, used: &[u64], pixels: f64) {
        for index in used {
            if let Some(site) = self.sites.get_mut(index).filter(|site| site.placed.is_some()) {
                site.pixels += pixels.max(0.0);
                site.views += 1.0;
            }
        }
    }

    /// A tick has passed: places what the budget allows; how many.
    pub(super) fn tick(&mut self, budget: Budget) -> usize {
        let fade = 0.5_f64.powf(1.0 / HALF_LIFE_TICKS);
        for site in self.sites.values_mut() {
            site.pixels *= fade;
            site.views *= fade;
            if let Some(placed) = &mut site.placed {
                placed.waited += u32::from(!placed.there);
                if placed.waited >= GIVE_UP_TICKS {
                    *site = Site::default();
                }
            }
        }
        self.sites.retain(|_, site| site.placed.is_some() || site.pixels >= NEGLIGIBLE);
        while self.sites.len() > MOST_SITES
            && let Some((index, _)) = self.least(|site| site.placed.is_none())
        {
            self.sites.remove(&index);
        }
        self.credit = (self.credit + budget.per_tick.max(0.0)).min(MOST_CREDIT.max(budget.per_tick));
        let mut count = 0;
        while self.credit >= 1.0 && self.place_one(budget.most) {
            self.credit -= 1.0;
            count += 1;
        }
        self.usable.retain(|index| self.sites.get(index).is_some_and(|site| site.placed.is_some()));
        count
    }

    /// Places the site with most uncovered pixels; false if none is worth its room.
    fn place_one(&mut self, most: usize) -> bool {
        let Some((best, pixels)) = self.greatest() else { return false };
        if self.placed().count() >= most {
            let Some((least, spared)) = self.least(|site| site.placed.is_some()) else { return false };
            if !(pixels >= MARGIN * spared) {
                return false;
            }
            if let Some(site) = self.sites.get_mut(&least) {
                site.placed = None;
            }
        }
        if let Some(site) = self.sites.get_mut(&best) {
            let gain = site.pixels / site.views.max(1.0);
            site.placed = Some(Placed { gain, there: false, waited: 0 });
        }
        true
    }

    /// The site without a sample that has most uncovered pixels; of equals the one of the lowest index.
    fn greatest(&self) -> Option<(u64, f64)> {
        let open = self.sites.iter().filter(|(_, site)| site.placed.is_none());
        let best = open.max_by(|a, b| a.1.pixels.total_cmp(&b.1.pixels).then(b.0.cmp(a.0)));
        best.map(|(index, site)| (*index, site.pixels)).filter(|(_, pixels)| *pixels >= NEGLIGIBLE)
    }

    /// The least useful site of a kind; of equals the one of the lowest index.
    fn least(&self, of: impl Fn(&Site) -> bool) -> Option<(u64, f64)> {
        let least = self.sites.iter().filter(|(_, site)| of(site));
        let least = least.min_by(|a, b| a.1.pixels.total_cmp(&b.1.pixels).then(a.0.cmp(b.0)));
        least.map(|(index, site)| (*index, site.pixels))
    }
}
