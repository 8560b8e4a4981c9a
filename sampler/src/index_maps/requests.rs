//! Ids that maps show and that are wanted: each is shaded once.

use std::sync::atomic::{AtomicU64, Ordering};

use rayon::prelude::*;

use super::IndexMaps;

/// Requested ids: a bit for each.
pub struct Requests {
    /// The texel of each lookup, in order, if lookups were made: the same are not made twice.
    pub texels: Vec<u32>,
    bits: Vec<AtomicU64>,
    /// Requested ids before each word.
    before: Vec<u32>,
}

impl Requests {
    /// No request yet of `count` ids.
    pub fn none(count: usize) -> Self {
        let bits = (0..count.div_ceil(64)).map(|_| AtomicU64::new(0)).collect();
        Self { texels: Vec::new(), bits, before: Vec::new() }
    }

    /// Requests an id. Slots are known after [`Self::counted`].
    #[inline]
    pub fn add(&self, id: u32) {
        let (word, bit) = (&self.bits[id as usize / 64], 1u64 << (id % 64));
        // Most have been requested before: reading alone leaves the word shared.
        if word.load(Ordering::Relaxed) & bit == 0 {
            word.fetch_or(bit, Ordering::Relaxed);
        }
    }

    /// Requests with slots.
    pub fn counted(mut self) -> Self {
        let mut sum = 0;
        let before = self.bits.iter().map(|word| {
            let here = sum;
            sum += word.load(Ordering::Relaxed).count_ones();
            here
        });
        self.before = before.collect();
        self
    }

    /// Every id that a texel sees, as if all of them were looked up. `count` is the number of ids, and `id_of` gives
    /// that of a texel.
    pub fn all(maps: &IndexMaps, count: usize, id_of: impl Fn(usize, u32) -> u32 + Sync) -> Self {
        let requests = Self::none(count);
        (0..maps.texels()).into_par_iter().with_min_len(4096).for_each(|texel| {
            if let Some((seen, _)) = maps.get(texel) {
                requests.add(id_of(texel, seen));
            }
        });
        requests.counted()
    }

    /// All requested ids, ascending.
    pub fn ids(&self) -> Vec<u32> {
        let of_word = |(word, bits): (usize, &AtomicU64)| {
            let bits = bits.load(Ordering::Relaxed);
            let set = (0..64u32).filter(move |bit| bits >> bit & 1 == 1);
            set.map(move |bit| word as u32 * 64 + bit)
        };
        self.bits.iter().enumerate().flat_map(of_word).collect()
    }

    /// Place of a requested id among all.
    #[inline]
    pub fn slot(&self, id: u32) -> usize {
        let word = id as usize / 64;
        let lower = (1u64 << (id % 64)) - 1;
        let before = (self.bits[word].load(Ordering::Relaxed) & lower).count_ones();
        (self.before[word] + before) as usize
    }

    /// Bytes of texels, bits and sums.
    pub fn bytes(&self) -> usize {
        size_of_val(&self.texels[..]) + size_of_val(&self.bits[..]) + size_of_val(&self.before[..])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn requested_ids_are_listed_once_and_in_order() {
        let bits = [1u64 << 3 | 1 << 63, 0, 1, u64::MAX].map(AtomicU64::new).into();
        let requests = Requests { texels: Vec::new(), bits, before: Vec::new() }.counted();
        assert_eq!(requests.before, [0, 2, 2, 3]);
        let ids = requests.ids();
        assert_eq!(ids[..4], [3, 63, 128, 192]);
        assert_eq!(ids.len(), 67);
        assert!(ids.iter().enumerate().all(|(slot, &id)| requests.slot(id) == slot));
    }
}
