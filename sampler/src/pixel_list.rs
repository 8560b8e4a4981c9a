//! Lists of pixels of a view that are traced and shaded alone.

use argus_scene::InvalidField;
use argus_scene::camera::Face;

use crate::tile::{Tile, tiles};

/// Pixels in a row of the compact image that a list is shaded in.
const ROW: u32 = 256;
/// Fewest columns of that image.
const LEAST_COLUMNS: u32 = 64;
/// Pixels on a side of the squares by which lists are sorted, so that neighbours share packets of rays.
const SQUARE: u32 = 16;

/// The pixels of a list that lie in one tile of the view.
#[derive(Debug)]
pub(crate) struct PixelList {
    /// The tile of the view, with the rays of the pixels.
    pub(crate) tile: Tile,
    /// The list as a compact image, row by row.
    pub(crate) compact: Tile,
    /// For each pixel its position in the job's list.
    pub(crate) asked: Vec<u32>,
    /// For each pixel its column and row in the tile.
    pub(crate) places: Vec<[u32; 2]>,
}

impl PixelList {
    /// Sub-samples of the pixels in the tile, pixel by pixel.
    pub(crate) fn sub_samples(&self) -> Vec<[u32; 2]> {
        let side = self.tile.side;
        let of_pixel =
            |[x, y]: [u32; 2]| (0..side * side).map(move |i| [x * side + i % side, y * side + i / side]);
        self.places.iter().copied().flat_map(of_pixel).collect()
    }

    /// Ids of [`Self::sub_samples`], arranged as the compact image; 0 beyond the last pixel.
    pub(crate) fn image(&self, found: &[[u32; 2]]) -> Vec<[u32; 2]> {
        let [width, height] = self.compact.sub_samples().map(|n| n as usize);
        let mut image = vec![[0; 2]; width * height];
        for (at, ids) in (0u32..).zip(found) {
            image[self.address(at) as usize] = *ids;
        }
        image
    }

    /// Where one of [`Self::sub_samples`] lies in the compact image.
    pub(crate) fn address(&self, at: u32) -> u32 {
        let side = self.tile.side;
        let (pixel, i) = (at / (side * side), at % (side * side));
        let (column, row) = (pixel % ROW, pixel / ROW);
        (row * side + i / side) * self.compact.sub_samples()[0] + column * side + i % side
    }

    /// The positions, packed for the device: one for each pixel of the compact image. Beyond the list is its last one.
    pub(crate) fn words(&self) -> Vec<u32> {
        let last = self.places.last().copied().unwrap_or_default();
        let count = (self.compact.size[0] * self.compact.size[1]) as usize;
        let all = self.places.iter().copied().chain(std::iter::repeat(last));
        all.take(count).map(|[x, y]| x | y << 16).collect()
    }
}

/// Sorts pixels of a view (row × width + column) by tile.
///
/// # Errors
/// A pixel lies outside the view.
pub(crate) fn pixel_lists(face: &Face, side: u32, pixels: &[u32]) -> Result<Vec<PixelList>, InvalidField> {
    let [width, height] = face.size;
    if let Some(pixel) = pixels.iter().find(|&&p| u64::from(p) >= u64::from(width) * u64::from(height)) {
        return Err(InvalidField::new("pixels", format!("the view has no pixel {pixel}")));
    }
    let mut pixel_lists = Vec::new();
    for tile in tiles(std::slice::from_ref(face), side) {
        let within = |pixel: u32| {
            let (x, y) = (pixel % width, pixel / width);
            let (x, y) = (x.checked_sub(tile.begin[0])?, y.checked_sub(tile.begin[1])?);
            (x < tile.size[0] && y < tile.size[1]).then_some([x, y])
        };
        let mut inside: Vec<(u32, [u32; 2])> =
            (0u32..).zip(pixels).filter_map(|(at, &pixel)| Some((at, within(pixel)?))).collect();
        inside.sort_by_key(|&(_, [x, y])| (y / SQUARE, x / SQUARE, y, x));
        // A list has at most the pixels of a tile.
        for part in inside.chunks((tiles_most(side) * ROW) as usize) {
            let (asked, places): (Vec<u32>, Vec<[u32; 2]>) = part.iter().copied().unzip();
            // Of few sizes, because targets are kept by size: making and clearing them takes longer than to shade a list.
            let count = places.len() as u32;
            let columns = count.next_power_of_two().clamp(LEAST_COLUMNS, ROW);
            let rows = count.div_ceil(ROW).next_power_of_two().min(tiles_most(side));
            let compact = Tile { size: [columns, rows], ..tile };
            pixel_lists.push(PixelList { tile, compact, asked, places });
        }
    }
    Ok(pixel_lists)
}

/// Most rows of a compact image.
fn tiles_most(side: u32) -> u32 {
    (crate::tile::MAX_SIDE / side).max(1)
}

#[cfg(test)]
mod tests {
    use argus_scene::{Camera, SampleCamera};
    use glam::DVec3;

    use super::*;

    #[test]
    fn every_pixel_is_listed_once_where_it_lies_whatever_the_order() {
        let camera = Camera::look_at(DVec3::ZERO, DVec3::NEG_Z);
        let face = SampleCamera::Perspective { camera, width: 1500, height: 40 }.faces()[0];
        let pixels: Vec<u32> = (0..60_000).step_by(7).rev().collect();
        let mut seen = vec![0u8; pixels.len()];
        let pixel_lists = pixel_lists(&face, 2, &pixels).unwrap();
        assert!(pixel_lists.len() > 1, "more than one tile");
        for list in &pixel_lists {
            for (&asked, &[x, y]) in list.asked.iter().zip(&list.places) {
                let [left, top] = list.tile.begin;
                assert_eq!((top + y) * 1500 + left + x, pixels[asked as usize]);
                seen[asked as usize] += 1;
            }
            let found: Vec<[u32; 2]> = (1..=list.places.len() as u32 * 4).map(|i| [i, 0]).collect();
            let image = list.image(&found);
            assert_eq!(image.iter().filter(|ids| ids[0] != 0).count(), found.len());
        }
        assert!(seen.iter().all(|&n| n == 1));
        assert_eq!(super::pixel_lists(&face, 1, &[60_000]).unwrap_err().field, "pixels");
        assert!(super::pixel_lists(&face, 1, &[]).unwrap().is_empty());
    }
}
