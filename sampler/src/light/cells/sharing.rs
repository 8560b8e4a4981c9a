//! Cells that samplers send one another, page by page.
//!
//! Equal contents have equal cells, so a page from another sampler is as good as one that is filled here, and much cheaper. What
//! is asked of others waits for a few seconds at most; then it is filled here.

use std::time::{Duration, Instant};

use argus_scene::{CellContent, CellPage, CellPages, InvalidField, Sky};
use bytes::Bytes;

use super::super::lattice::{CellKey, PageKey};
use super::scene::CellScene;
use super::state::{SharedCells, State};
use super::store::Unpacked;

/// Version of what cells hold and how they are packed.
const VERSION: u8 = 2;
/// How long filling waits for a page that was asked of other samplers.
const PATIENCE: Duration = Duration::from_secs(3);
/// How long after it was asked for a page is asked for again.
const ASKED_AGAIN: Duration = Duration::from_secs(20);
/// Corners in the queue that are looked at for pages to ask for.
const LOOKED_AT: usize = 1 << 14;
/// Most pages that are remembered as asked for.
const MOST_ASKED: usize = 1 << 16;

/// The content of a scene's cells; `None` if its surfaces change shape, which no hash covers.
pub(super) fn content_of(scene: &CellScene<'_>) -> Option<CellContent> {
    let of_pose = scene.surfaces.pose_hash()?;
    let mut hasher = blake3::Hasher::new();
    hasher.update(&[VERSION]).update(&of_pose);
    // Vector units of another kind may round otherwise.
    hasher.update(std::env::consts::ARCH.as_bytes()).update(&[u8::from(crate::light_rays::has_avx2())]);
    hasher.update(bytemuck::bytes_of(&scene.leaves.center().to_array()));
    hasher
        .update(bytemuck::bytes_of(&scene.lattice.low.to_array()))
        .update(&scene.lattice.edge.to_le_bytes());
    let Sky { zenith, horizon, ground, map, reach } = scene.sky;
    hasher.update(bytemuck::bytes_of(&[zenith, horizon, ground].map(|color| color.to_array())));
    // The scene's hash covers the map.
    hasher.update(&[u8::from(map.is_some())]).update(&reach.unwrap_or(-1.0).to_le_bytes());
    hasher.update(bytemuck::cast_slice(scene.radiance));
    Some(hasher.finalize().into())
}

impl State {
    /// Pages with cells that a corner lacks.
    fn lacking(&self, corner: CellKey) -> impl Iterator<Item = PageKey> {
        let lacks_groups = self.store.groups(corner).is_none().then_some(corner);
        let cells = corner.corner().filter(|(_, key)| self.store.tier(*key).is_none()).map(|(_, key)| key);
        cells.chain(lacks_groups).map(|key| key.in_page().0)
    }
}

impl CellPages for SharedCells {
    fn content(&self) -> Option<CellContent> {
        self.lock().content.flatten()
    }

    fn wanted(&self, most: usize) -> Vec<CellPage> {
        let (mut state, now) = (self.lock(), Instant::now());
        if state.content.flatten().is_none() {
            return Vec::new();
        }
        if state.asked.asked.len() > MOST_ASKED {
            state.asked.forget();
        }
        state.asked.awaited.retain(|_, until| *until > now);
        let mut wanted = Vec::new();
        // All that wait are looked at rarely: other samplers may have filled them meanwhile.
        let all_are_due = state.asked.all_at.is_none_or(|at| now.duration_since(at) > ASKED_AGAIN);
        let fresh = state.queue.take_fresh(LOOKED_AT);
        let corners: Vec<CellKey> = match all_are_due {
            true => state.queue.newest().take(LOOKED_AT).collect(),
            false => fresh,
        };
        if all_are_due {
            state.asked.all_at = Some(now);
        }
        for (index, corner) in corners.iter().enumerate() {
            let lacking: Vec<PageKey> = state.lacking(*corner).collect();
            for page in lacking {
                if wanted.len() >= most {
                    state.queue.are_fresh(&corners[index..]);
                    return wanted;
                }
                let asked = &mut state.asked;
                if asked.asked.get(&page).is_none_or(|when| now.duration_since(*when) > ASKED_AGAIN) {
                    asked.asked.insert(page, now);
                    asked.awaited.insert(page, now + PATIENCE);
                    wanted.push(page.number());
                }
            }
        }
        wanted
    }

    fn packed(&self, content: CellContent, pages: &[CellPage]) -> Vec<(CellPage, Bytes)> {
        let state = self.lock();
        if state.content.flatten() != Some(content) {
            return Vec::new();
        }
        let packed = |number: &CellPage| {
            let packed = state.store.packed(PageKey::from_number(*number)?)?;
            Some((*number, packed.into()))
        };
        pages.iter().filter_map(packed).collect()
    }

    fn add(&self, content: CellContent, page: CellPage, packed: &[u8]) -> Result<(), InvalidField> {
        let begin = Instant::now();
        let key =
            PageKey::from_number(page).ok_or_else(|| InvalidField::new("page", "is not in the lattice"))?;
        let unpacked = Unpacked::new(packed)?;
        let unpacking = begin.elapsed();
        let mut state = self.lock();
        // A view may have held the lock for long.
        let begin = Instant::now();
        if state.content.flatten() == Some(content) {
            state.store.add(key, unpacked);
            state.store.keep_bound();
            state.asked.awaited.remove(&key);
            state.asked.taken += 1;
            state.asked.take_ms += (unpacking + begin.elapsed()).as_secs_f64() * 1e3;
            state.may_refine = true;
        }
        Ok(())
    }

    fn give_up(&self, pages: &[CellPage]) {
        let mut state = self.lock();
        for page in pages.iter().filter_map(|number| PageKey::from_number(*number)) {
            state.asked.awaited.remove(&page);
        }
    }
}
