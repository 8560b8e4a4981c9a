//! Pages as bytes, little-endian, by which samplers send one another their cells.
//!
//! A number of cells (u16), and of each: its place (u16), its number of sides and its tier (u8 each); the sides, each with place
//! and normal (6 f32), whether it is thin and how many ways are blocked (u8 each); and for each tier the sums of the sides
//! (10 f32 each). Then a number of corners that are known, and of each: its place (u16), and the number of its groups with the
//! groups (u8 each). Then what its rays met, if things move and all of it is recorded: 1 (u8), the blocks that they crossed (64 u64),
//! and a number of reads of leaf sides (u32) with the reads, ascending (u32 each). Else 0 (u8).

use argus_scene::InvalidField;
use glam::Vec3;

use super::super::super::lattice::{PAGE_CELLS, PageKey};
use super::super::super::paths::LeafRead;
use super::super::blocks::{BLOCK_WORDS, BlockSet};
use super::super::corner::MOST_GROUPS;
use super::super::rays::Sums;
use super::super::record::Record;
use super::super::scene::RAYS;
use super::super::sides::{ORIGINS, Side};
use super::{Corner, Page, Store, TIERS};

/// Most sides of a cell.
const MOST_SIDES: usize = 6;

/// The cells and corners of a page that was unpacked.
pub(in crate::light::cells) struct Unpacked {
    cells: Vec<UnpackedCell>,
    /// Places of corners, and the groups of each.
    corners: Vec<(usize, Box<[u8]>)>,
    /// What the rays of its cells met; `None` if that is not known.
    record: Option<Record>,
}

struct UnpackedCell {
    place: usize,
    /// Sides with their sums at the first tier.
    sides: Vec<(Side, Sums)>,
    /// Sums at each further tier that the cell has.
    tiers: Vec<Vec<Sums>>,
}

impl Store {
    /// The cells held of a page; `None` without any.
    pub(in crate::light::cells) fn packed(&self, page: PageKey) -> Option<Vec<u8>> {
        self.pages.get(&page).filter(|page| !page.cells.is_empty()).map(Page::packed)
    }

    /// Adds what a page lacks.
    pub(in crate::light::cells) fn add(&mut self, page: PageKey, unpacked: Unpacked) {
        self.change(page, |page| {
            match &unpacked.record {
                Some(record) => page.record.get_or_insert_default().join(record),
                None => page.has_unrecorded = true,
            }
            let cells = unpacked.cells.into_iter().map(|cell| {
                page.insert(cell.place, &cell.sides)
                    + (1..)
                        .zip(&cell.tiers)
                        .map(|(tier, sums)| page.refine(cell.place, tier, sums))
                        .sum::<usize>()
            });
            let cells = cells.sum::<usize>();
            let corners = unpacked.corners.into_iter();
            cells + corners.map(|(place, groups)| page.set_groups(place, groups)).sum::<usize>()
        });
    }
}

impl Page {
    fn packed(&self) -> Vec<u8> {
        let mut out = Vec::with_capacity(self.bytes());
        out.extend((self.cells.len() as u16).to_le_bytes());
        for (place, cell) in (0..PAGE_CELLS).filter_map(|place| Some((place, self.cell(place)?))) {
            out.extend((place as u16).to_le_bytes());
            out.extend([cell.count, cell.tier]);
            let range = cell.first as usize..cell.first as usize + usize::from(cell.count);
            for side in &self.sides[range.clone()] {
                put(&mut out, side.place);
                put(&mut out, side.normal);
                out.extend([u8::from(side.is_thin), side.blocked]);
            }
            for sums in
                self.sums.iter().take(1 + usize::from(cell.tier)).flat_map(|sums| &sums[range.clone()])
            {
                put(&mut out, sums.seen);
                put(&mut out, sums.whole);
                put(&mut out, sums.reflected);
                out.extend(sums.valid.to_le_bytes());
            }
        }
        let known = self.corners.iter().enumerate().filter(|(_, corner)| **corner != Corner::Unknown);
        out.extend((known.clone().count() as u16).to_le_bytes());
        for (place, corner) in known {
            let groups = match corner {
                Corner::Parted(groups) => self.groups.get(usize::from(*groups)).map_or(&[][..], |all| all),
                Corner::Open | Corner::Unknown => &[],
            };
            out.extend((place as u16).to_le_bytes());
            out.push(groups.len() as u8);
            out.extend(groups);
        }
        let record = self.record.as_ref().filter(|_| !self.has_unrecorded);
        out.push(u8::from(record.is_some()));
        if let Some(record) = record {
            out.extend(record.crossed().words().iter().flat_map(|word| word.to_le_bytes()));
            let read = record.sorted_reads();
            out.extend((read.len() as u32).to_le_bytes());
            out.extend(read.into_iter().flat_map(u32::to_le_bytes));
        }
        out
    }
}

fn put(out: &mut Vec<u8>, vector: Vec3) {
    out.extend(vector.to_array().into_iter().flat_map(f32::to_le_bytes));
}

impl Unpacked {
    /// Reads a page.
    ///
    /// # Errors
    /// What is wrong with the bytes.
    pub(in crate::light::cells) fn new(packed: &[u8]) -> Result<Self, InvalidField> {
        let mut reader = Reader(packed);
        let (cells, mut next) = (reader.count()?, 0);
        let cells = (0..cells).map(|_| reader.cell(&mut next)).collect::<Result<_, _>>()?;
        let (corners, mut next) = (reader.count()?, 0);
        let corners = (0..corners).map(|_| reader.corner(&mut next)).collect::<Result<_, _>>()?;
        let record = reader.record()?;
        if !reader.0.is_empty() {
            return Err(wrong("has bytes after its end"));
        }
        Ok(Self { cells, corners, record })
    }
}

/// What is left to read.
struct Reader<'a>(&'a [u8]);

impl Reader<'_> {
    fn bytes<const N: usize>(&mut self) -> Result<[u8; N], InvalidField> {
        let (bytes, rest) = self.0.split_first_chunk().ok_or_else(|| wrong("ends too early"))?;
        self.0 = rest;
        Ok(*bytes)
    }

    fn count(&mut self) -> Result<usize, InvalidField> {
        let count = usize::from(u16::from_le_bytes(self.bytes()?));
        if count <= PAGE_CELLS { Ok(count) } else { Err(wrong("has too many cells")) }
    }

    /// A place, at or after the least one that may follow.
    fn place(&mut self, least: &mut usize) -> Result<usize, InvalidField> {
        let place = usize::from(u16::from_le_bytes(self.bytes()?));
        if !(*least..PAGE_CELLS).contains(&place) {
            return Err(wrong("has a cell out of order"));
        }
        *least = place + 1;
        Ok(place)
    }

    fn cell(&mut self, least: &mut usize) -> Result<UnpackedCell, InvalidField> {
        let place = self.place(least)?;
        let [sides, tier] = self.bytes()?.map(usize::from);
        if sides > MOST_SIDES || tier >= TIERS {
            return Err(wrong("has a cell of too many sides or rays"));
        }
        let count = sides;
        let sides: Vec<Side> = (0..count).map(|_| self.side()).collect::<Result<_, _>>()?;
        let mut sums = |tier: usize| (0..count).map(|_| self.sums(RAYS[tier])).collect::<Result<Vec<_>, _>>();
        let sides = sides.into_iter().zip(sums(0)?).collect();
        Ok(UnpackedCell { place, sides, tiers: (1..=tier).map(&mut sums).collect::<Result<_, _>>()? })
    }

    fn side(&mut self) -> Result<Side, InvalidField> {
        let (place, normal, [thin, blocked]) = (self.vector()?, self.vector()?, self.bytes()?);
        if thin > 1 || usize::from(blocked) > ORIGINS {
            return Err(wrong("has a side with wrong marks"));
        }
        Ok(Side { place, normal, is_thin: thin == 1, blocked })
    }

    fn sums(&mut self, most: usize) -> Result<Sums, InvalidField> {
        let [seen, whole, reflected] = [self.vector()?, self.vector()?, self.vector()?];
        let valid = self.number()?;
        if !(0.0..=most as f32).contains(&valid) {
            return Err(wrong("has more rays than its tier"));
        }
        Ok(Sums { seen, whole, reflected, valid })
    }

    fn corner(&mut self, least: &mut usize) -> Result<(usize, Box<[u8]>), InvalidField> {
        let place = self.place(least)?;
        let [count] = self.bytes()?;
        let groups =
            (0..count).map(|_| self.bytes().map(|[group]| group)).collect::<Result<Box<[u8]>, _>>()?;
        // A new group has a higher number than those before it, which lookups rely on.
        let mut seen = [false; MOST_GROUPS + 1];
        for group in groups.iter().map(|group| usize::from(*group)) {
            let is_new = !*seen.get(group).ok_or_else(|| wrong("has too many groups"))?;
            if is_new && group > 0 && seen[group..].contains(&true) {
                return Err(wrong("has groups out of order"));
            }
            seen[group] = true;
        }
        if groups.len() <= 8 * MOST_SIDES { Ok((place, groups)) } else { Err(wrong("has too many groups")) }
    }

    fn record(&mut self) -> Result<Option<Record>, InvalidField> {
        match self.bytes()? {
            [0] => return Ok(None),
            [1] => {}
            _ => return Err(wrong("has a record of another kind")),
        }
        let mut words = [0; BLOCK_WORDS];
        for word in &mut words {
            *word = u64::from_le_bytes(self.bytes()?);
        }
        let count = u32::from_le_bytes(self.bytes()?) as usize;
        if count > self.0.len() / size_of::<LeafRead>() {
            return Err(wrong("ends too early"));
        }
        let read = (0..count).map(|_| self.bytes().map(u32::from_le_bytes)).collect::<Result<Vec<_>, _>>()?;
        if !read.is_sorted_by(|one, next| one < next) {
            return Err(wrong("has a record out of order"));
        }
        Ok(Some(Record::new(BlockSet::from_words(words), read)))
    }

    fn vector(&mut self) -> Result<Vec3, InvalidField> {
        Ok(Vec3::new(self.number()?, self.number()?, self.number()?))
    }

    fn number(&mut self) -> Result<f32, InvalidField> {
        let number = f32::from_le_bytes(self.bytes()?);
        if number.is_finite() { Ok(number) } else { Err(wrong("has a number that is not finite")) }
    }
}

fn wrong(reason: &str) -> InvalidField {
    InvalidField::new("page", reason)
}

#[cfg(test)]
mod tests {
    use glam::IVec3;

    use super::super::super::super::lattice::CellKey;
    use super::*;

    fn filled() -> (Store, PageKey) {
        let mut store = Store::new(usize::MAX);
        let key = |x: i32| CellKey::new(5, IVec3::new(x, 2, 3)).unwrap();
        let side = |x: f32| Side { place: Vec3::splat(x), normal: Vec3::Y, is_thin: x > 0.5, blocked: 3 };
        let sums = |x: f32| Sums { seen: Vec3::X * x, whole: Vec3::ONE, reflected: Vec3::Y, valid: 7.0 };
        store.insert(key(6), &[(side(0.1), sums(0.2)), (side(0.9), sums(0.3))]);
        store.insert(key(1), &[]);
        store.refine(key(6), 1, &[sums(0.4), sums(0.5)]);
        store.set_groups(key(6), Box::new([1, 2, 0]));
        store.set_groups(key(2), Box::new([]));
        store.record(key(6), &Record::new(BlockSet::from_words([5; BLOCK_WORDS]), vec![9, 2, 2]));
        (store, key(0).in_page().0)
    }

    #[test]
    fn a_page_comes_back_with_the_same_bytes_and_completes_another() {
        let (store, page) = filled();
        let packed = store.packed(page).unwrap();
        let mut other = Store::new(usize::MAX);
        // It has one of the cells, at a lower tier.
        let key = CellKey::new(5, IVec3::new(6, 2, 3)).unwrap();
        let first = store.filled(key, 0).unwrap();
        let sides: Vec<(Side, Sums)> = first.sides.iter().copied().zip(first.sums.iter().copied()).collect();
        other.insert(key, &sides);
        other.add(page, Unpacked::new(&packed).unwrap());
        assert_eq!(other.packed(page), Some(packed));
        assert_eq!((other.cells(), other.groups(key)), (2, Some(&[1, 2, 0][..])));
        assert!(Store::new(1).packed(page).is_none());
    }

    #[test]
    fn bytes_that_are_no_page_are_refused() {
        let (store, page) = filled();
        let packed = store.packed(page).unwrap();
        for length in 0..packed.len() {
            assert!(Unpacked::new(&packed[..length]).is_err(), "{length}");
        }
        assert!(Unpacked::new(&[&packed[..], &[0]].concat()).is_err());
        // The page ends with a corner's groups 1, 2 and 0, and with a record that reads 2 and 9.
        let (rest, record) = packed.split_at(packed.len() - (1 + 8 * BLOCK_WORDS + 3 * 4));
        let out_of_order = [&rest[..rest.len() - 3], &[2, 1, 0], record].concat();
        assert!(Unpacked::new(&out_of_order).is_err());
        for read in [[9, 2], [2, 2]] {
            let record = &record[..record.len() - 8];
            let read = read.map(u32::to_le_bytes).concat();
            assert!(Unpacked::new(&[rest, record, &read].concat()).is_err());
        }
        assert!(Unpacked::new(&[rest, &[0]].concat()).is_ok());
        // No byte makes it panic.
        for at in 0..packed.len() {
            for value in [0, 1, 0x7f, 0x80, 0xff] {
                let mut other = packed.clone();
                other[at] = value;
                if let Ok(unpacked) = Unpacked::new(&other) {
                    Store::new(usize::MAX).add(page, unpacked);
                }
            }
        }
    }
}
