//! Placement of samples at refinements of the rig, where views have holes.
//!
//! Every answered frame reports how many of its pixels no sample saw. Unresolved pixels are counted for the
//! refinement *site* that would have seen most of them: the rig's refinement nearest to the viewpoint, of the
//! coarsest level that the view did not use. Sites get samples greedily by their count, within a budget of rendering
//! time and memory. A placed sample earns the pixels that it saves, with every view that uses it. In a full memory, a
//! sample that would save twice as many replaces the least useful.
//!
//! Samplers render them when they are idle, and compositors prefetch them. Plans use only samples that are held, so
//! no view waits for one. A view's plan names the samples it uses, so its bytes remain a function of its provenance.
//!
//! Counts fade by half within [`HALF_LIFE_TICKS`], all alike. A placed sample stays unless something twice as useful
//! needs its room.

use std::collections::BTreeMap;

use argus_proto::v1::Refinements;
use argus_scene::rig::{MAX_LEVEL, VisibilityQuery};
use argus_scene::{Camera, FaceMask, Rig};

/// Share of uncovered pixels below which a frame is good enough: half of the promised mean, so that views between
/// observed ones keep the promise, too.
const BEARABLE: f64 = 0.0025;

/// Half-life of a count, ticks: as long as a viewer may take to come back.
const HALF_LIFE_TICKS: f64 = 120.0;

/// In a full memory, a sample is replaced by one that is this many times as useful.
const MARGIN: f64 = 2.0;

/// Sites below this many pixels are forgotten.
const NEGLIGIBLE: f64 = 1.0;

/// Most remembered sites.
const MOST_SITES: usize = 4096;

/// Most samples placed at once after a pause.
const MOST_CREDIT: f64 = 4.0;

/// A sample that is not held after this many ticks was lost; its site starts anew.
const GIVE_UP_TICKS: u32 = 120;

/// The budget of refinements.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Budget {
    /// Samples per tick.
    pub(super) per_tick: f64,
    /// Most samples at the same time.
    pub(super) most: usize,
}

/// Counts of answered views for one refinement.
#[derive(Debug, Clone, Copy, Default)]
struct Site {
    /// Pixels that no sample saw, or that this one saved; fading.
    pixels: f64,
    /// Views in which they were counted; fading.
    views: f64,
    placed: Option<Placed>,
}

/// A refinement with a placed sample.
#[derive(Debug, Clone, Copy)]
struct Placed {
    /// Pixels that it saves per view.
    gain: f64,
    /// The faces that are rendered.
    faces: FaceMask,
    /// Whether compositors hold it.
    there: bool,
    /// Ticks since it was ordered, until it is held.
    waited: u32,
}

/// The refinements that views needed.
#[derive(Debug, Clone, Default)]
pub(in crate::core) struct Placement {
    sites: BTreeMap<u64, Site>,
    credit: f64,
    /// Refinements with all faces, which any view may use, ascending.
    usable: Vec<u64>,
}

impl Placement {
    /// Refinements that a plan may use, ascending.
    pub(in crate::core) fn usable(&self) -> &[u64] {
        &self.usable
    }

    /// Placed refinements, which are rendered and kept, ascending.
    pub(in crate::core) fn placed(&self) -> impl Iterator<Item = u64> {
        self.sites.iter().filter(|(_, site)| site.placed.is_some()).map(|(index, _)| *index)
    }

    /// Whether a refinement is placed.
    pub(in crate::core) fn is_placed(&self, index: u64) -> bool {
        self.sites.get(&index).is_some_and(|site| site.placed.is_some())
    }

    /// The faces of a refinement that shall be rendered and kept; `None` if it shall not.
    pub(in crate::core) fn faces(&self, index: u64) -> Option<FaceMask> {
        self.sites.get(&index).and_then(|site| site.placed).map(|placed| placed.faces)
    }

    /// Counts of wanted, placed and usable refinements.
    pub(in crate::core) fn counts(&self) -> Refinements {
        let placed = self.placed().count();
        Refinements {
            wanted: (self.sites.len() - placed) as u32,
            placed: placed as u32,
            usable: self.usable.len() as u32,
        }
    }

    /// Learns from a view that used the samples of these cameras, and whose `uncovered` of `pixels` none of them saw.
    pub(super) fn learn(
        &mut self,
        (rig, sight): (&Rig, Option<&dyn VisibilityQuery>),
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
        let own = rig.own_level(camera, sight).max(0) as u32;
        for level in own + 1..=own + MAX_LEVEL {
            let Some(index) = rig.refinement(camera, level, sight) else { return };
            // The view used it, or the rig's own camera in its place, and still has holes: a finer refinement is
            // needed.
            if used.contains(&index) || rig.level(index) <= Some(own) {
                continue;
            }
            let site = self.sites.entry(index).or_default();
            match &mut site.placed {
                // The view may look anywhere, and found none that shows all directions.
                Some(placed) if placed.faces != FaceMask::ALL => {
                    *placed = Placed { faces: FaceMask::ALL, there: false, waited: 0, ..*placed };
                    return;
                }
                // It is held, but other samples served the view better.
                Some(placed) if placed.there => {}
                // It is being rendered or fetched.
                Some(_) => return,
                None => {
                    site.pixels += uncovered as f64;
                    site.views += 1.0;
                    return;
                }
            }
        }
    }

    /// Updates which placed samples are usable. A usable one stays so until no worker holds it, so that a compositor
    /// that joins removes none.
    pub(super) fn update(
        &mut self,
        is_there: impl Fn(u64, FaceMask) -> bool,
        is_anywhere: impl Fn(u64, FaceMask) -> bool,
    ) {
        self.usable.clear();
        for (index, site) in &mut self.sites {
            let Some(placed) = &mut site.placed else { continue };
            let faces = placed.faces;
            placed.there = is_there(*index, faces) || (placed.there && is_anywhere(*index, faces));
            if placed.there {
                placed.waited = 0;
                // A view whose way is not open may look anywhere.
                self.usable.extend((faces == FaceMask::ALL).then_some(*index));
            }
        }
    }

    /// Closes a tick: places samples within the budget. Returns their number.
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
            site.placed = Some(Placed { gain, faces: FaceMask::ALL, there: false, waited: 0 });
        }
        true
    }

    /// The site without a sample that has most uncovered pixels; of equal ones the lowest index.
    fn greatest(&self) -> Option<(u64, f64)> {
        let open = self.sites.iter().filter(|(_, site)| site.placed.is_none());
        let best = open.max_by(|a, b| a.1.pixels.total_cmp(&b.1.pixels).then(b.0.cmp(a.0)));
        best.map(|(index, site)| (*index, site.pixels)).filter(|(_, pixels)| *pixels >= NEGLIGIBLE)
    }

    /// The least useful site of a kind; of equal ones the lowest index.
    fn least(&self, of: impl Fn(&Site) -> bool) -> Option<(u64, f64)> {
        let least = self.sites.iter().filter(|(_, site)| of(site));
        let least = least.min_by(|a, b| a.1.pixels.total_cmp(&b.1.pixels).then(a.0.cmp(b.0)));
        least.map(|(index, site)| (*index, site.pixels))
    }
}
