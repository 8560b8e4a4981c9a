//! Entry points for fuzzing: they read pages of cells with the code of production.

use argus_scene::InvalidField;
use glam::{IVec3, Vec3};

use super::super::lattice::CellKey;
use super::blocks::{BLOCK_WORDS, BlockSet};
use super::rays::Sums;
use super::record::Record;
use super::sides::Side;
use super::store::{Store, TIERS, Unpacked};

/// A bound in bytes below which no page of an input is evicted.
const MOST_BYTES: usize = 1 << 30;

/// Packed pages: of cells without sides; of all tiers and with parted corners; and with a record.
pub fn pages() -> Vec<Vec<u8>> {
    let side = |x: f32| Side { place: Vec3::splat(x), normal: Vec3::Y, is_thin: x > 0.5, blocked: 3 };
    let sums = |x: f32| Sums { seen: Vec3::X * x, whole: Vec3::ONE, reflected: Vec3::Y, valid: 7.0 };
    let keys = || (0..8).filter_map(|x| CellKey::new(5, IVec3::new(x, 2, 3)));
    let mut stores = [(); 3].map(|()| Store::new(MOST_BYTES));
    for key in keys() {
        stores[0].insert(key, &[]);
        stores[1].insert(key, &[(side(0.1), sums(0.2)), (side(0.9), sums(0.3))]);
        stores[1].set_groups(key, Box::new([1, 2, 0]));
        for tier in 1..TIERS {
            stores[1].refine(key, tier, &[sums(0.4), sums(0.5)]);
        }
        stores[2].record(key, &Record::new(BlockSet::from_words([9; BLOCK_WORDS]), vec![2, 9, 1 << 31]));
        stores[2].insert(key, &[(side(0.4), sums(0.2))]);
    }
    let page = keys().next().map(|key| key.in_page().0);
    stores.iter().filter_map(|store| store.packed(page?)).collect()
}

/// Reads a page, adds it to a store, and checks that what is packed then is a page again.
///
/// # Errors
/// What is wrong with the bytes.
pub fn read_page(bytes: &[u8]) -> Result<(), InvalidField> {
    let unpacked = Unpacked::new(bytes)?;
    let Some(key) = CellKey::new(5, IVec3::ZERO) else { return Ok(()) };
    let (page, mut store) = (key.in_page().0, Store::new(MOST_BYTES));
    store.add(page, unpacked);
    store.keep_bound();
    if let Some(packed) = store.packed(page) {
        let mut again = Store::new(MOST_BYTES);
        again.add(page, Unpacked::new(&packed)?);
        assert!(again.packed(page).as_ref() == Some(&packed), "a page changes as it is passed on");
    }
    Ok(())
}
