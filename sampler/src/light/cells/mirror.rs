//! Keeps a copy of filled cells on a device, for lookups there. Pages that changed are written again, and only those.

use std::collections::HashMap;
use std::sync::Arc;

use argus_gpu::{Gpu, wgpu};
use argus_scene::RenderError;

use super::super::lattice::PageKey;
use super::store::Store;
use crate::lit_cells::CellBuffers;

/// Bytes of a vector.
const VECTOR: u64 = 16;
/// Fewest vectors of a buffer of blocks.
const LEAST: u32 = 1 << 12;

/// The pages of a store on a device.
#[derive(Default)]
pub(super) struct CellMirror {
    /// The version of the store that it is of; `None` before the first.
    version: Option<u64>,
    blocks: HashMap<PageKey, Block>,
    /// Vectors behind the last block.
    end: u32,
    held: Option<CellBuffers>,
    pages: Arc<Vec<PageKey>>,
}

/// Where a page is among the vectors.
#[derive(Clone, Copy)]
struct Block {
    first: u32,
    size: u32,
    version: u64,
}

impl CellMirror {
    /// Takes over what changed in a store. Returns the buffers, and the pages in the order of their places.
    ///
    /// # Errors
    /// [`RenderError::OutOfMemory`] if the pages are larger than the device can bind.
    pub(super) fn synchronise(
        &mut self,
        gpu: &Gpu,
        store: &Store,
    ) -> Result<(CellBuffers, Arc<Vec<PageKey>>), RenderError> {
        if let (Some(held), true) = (&self.held, self.version == Some(store.version())) {
            return Ok((held.clone(), Arc::clone(&self.pages)));
        }
        let versions: HashMap<PageKey, u64> = store.versions().collect();
        self.blocks.retain(|page, _| versions.contains_key(page));
        let is_known = |page: &PageKey, version: u64| {
            self.blocks.get(page).is_some_and(|block| block.version == version)
        };
        let changed = versions.iter().filter(|(page, version)| !is_known(page, **version));
        let mut changed: Vec<(PageKey, u64)> = changed.map(|(page, version)| (*page, *version)).collect();
        // So that equal stores have equal buffers.
        changed.sort_unstable_by_key(|(page, _)| page.number());
        let data = self.held.as_ref().map(|held| held.data.clone());
        let data = match data.filter(|data| self.write(gpu, data, store, &changed)) {
            Some(data) => data,
            None => self.rebuild(gpu, store, &versions)?,
        };
        let (table, pages) = self.table();
        let held = CellBuffers {
            table: gpu.upload("pages of cells", &table, wgpu::BufferUsages::STORAGE),
            data,
            pages: pages.len(),
        };
        (self.held, self.pages) = (Some(held.clone()), Arc::new(pages));
        self.version = Some(store.version());
        Ok((held, Arc::clone(&self.pages)))
    }

    /// Writes pages that changed, in their old places or behind the last. Returns false if there is no room.
    fn write(&mut self, gpu: &Gpu, data: &wgpu::Buffer, store: &Store, changed: &[(PageKey, u64)]) -> bool {
        let room = (data.size() / VECTOR) as u32;
        for &(page, version) in changed {
            let Some(words) = store.hot(page) else { continue };
            let size = words.len() as u32;
            let first = match self.blocks.get(&page).copied() {
                Some(block) if block.size >= size => block.first,
                _ if room - self.end >= size => {
                    let first = self.end;
                    self.end += size;
                    self.blocks.insert(page, Block { first, size, version });
                    first
                }
                _ => return false,
            };
            self.blocks.entry(page).and_modify(|block| block.version = version);
            gpu.queue.write_buffer(data, u64::from(first) * VECTOR, bytemuck::cast_slice(&words));
        }
        true
    }

    /// Writes all pages into a buffer with as much room again.
    fn rebuild(
        &mut self,
        gpu: &Gpu,
        store: &Store,
        versions: &HashMap<PageKey, u64>,
    ) -> Result<wgpu::Buffer, RenderError> {
        let mut pages: Vec<(PageKey, u64)> =
            versions.iter().map(|(page, version)| (*page, *version)).collect();
        pages.sort_unstable_by_key(|(page, _)| page.number());
        (self.end, self.held) = (0, None);
        self.blocks.clear();
        let mut words = Vec::new();
        for (page, version) in pages {
            let first = words.len() as u32;
            words.extend(store.hot(page).unwrap_or_default());
            self.blocks.insert(page, Block { first, size: words.len() as u32 - first, version });
        }
        let most = gpu.largest_array() / VECTOR;
        if words.len() as u64 > most {
            self.blocks.clear();
            let message = format!("light cells take {} MiB on the device", words.len() >> 16);
            return Err(RenderError::OutOfMemory(message));
        }
        self.end = words.len() as u32;
        let room = (words.len() as u64 * 2).max(u64::from(LEAST)).min(most);
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST;
        let data = gpu.buffer("light cells", room * VECTOR, usage);
        gpu.write(&data, &words);
        Ok(data)
    }

    /// The table of pages by their number, and the pages in the order of their places.
    fn table(&self) -> (Vec<[u32; 4]>, Vec<PageKey>) {
        let mut pages: Vec<PageKey> = self.blocks.keys().copied().collect();
        pages.sort_unstable_by_key(|page| page.number());
        let mut table = vec![[0; 4]; (pages.len() * 2).max(2).next_power_of_two()];
        let mask = table.len() - 1;
        for (place, page) in pages.iter().enumerate() {
            let number = page.number();
            let words = [number as u32, (number >> 32) as u32];
            let mut slot = slot_of(words) as usize & mask;
            while table[slot][3] != 0 {
                slot = (slot + 1) & mask;
            }
            table[slot] = [words[0], words[1], self.blocks[page].first, place as u32 + 1];
        }
        (table, pages)
    }
}

/// The first slot at which the number of a page is looked for, as in the program.
fn slot_of([low, high]: [u32; 2]) -> u32 {
    let mixed = low.wrapping_mul(0x9e37_79b1) ^ high.wrapping_mul(0x85eb_ca6b);
    mixed ^ mixed >> 15
}
