//! Sheets of pictures side by side: the paper's figures 7, 8 and 10.

use anyhow::{Context as _, Result};
use argus_scene::metrics::flip_map;
use image::RgbImage;
use image::imageops::{FilterType, crop_imm, replace, resize};

use super::options::Options;
use super::stage::{Pose, Seen};

/// Pixels between pictures.
const GAP: u32 = 4;
/// Least height of an enlarged reflector, pixels.
const ENLARGED: u32 = 256;

/// Pictures of a number of reflectors.
pub(super) struct Pictures<'a> {
    options: &'a Options,
    reflectors: u32,
    all: Vec<(Pose, String, RgbImage)>,
}

impl<'a> Pictures<'a> {
    pub(super) fn new(options: &'a Options, reflectors: u32) -> Self {
        Self { options, reflectors, all: Vec::new() }
    }

    /// Keeps a picture of a way, if images are wanted.
    pub(super) fn keep(&mut self, pose: Pose, way: &str, image: &RgbImage) {
        if self.options.images.is_some() {
            self.all.push((pose, way.to_owned(), image.clone()));
        }
    }

    fn of(&self, pose: Pose, ways: &[&str]) -> Option<&RgbImage> {
        let find = |way: &&str| self.all.iter().find(|(at, name, _)| *at == pose && name == *way);
        ways.iter().find_map(find).map(|(.., image)| image)
    }

    /// Multi-view rendering, points and iVIR from a pose, of those that have been kept.
    fn compared(&self, pose: Pose) -> Vec<&RgbImage> {
        let ways: [&[&str]; 3] = [&["MVR, 512²", "MVR, adaptive"], &["points"], &["iVIR"]];
        ways.iter().filter_map(|ways| self.of(pose, ways)).collect()
    }

    /// Figure 7: a column for each pose, with multi-view rendering, points and iVIR from top to bottom.
    pub(super) fn figure_7(&self) -> Result<()> {
        let columns: Vec<Vec<&RgbImage>> =
            self.options.poses.iter().map(|&pose| self.compared(pose)).collect();
        let rows: Vec<Vec<&RgbImage>> = (0..3)
            .map(|row| columns.iter().filter_map(|column| column.get(row).copied()).collect())
            .collect();
        match grid(&rows) {
            Some(sheet) => save(self.options, &format!("figure-7-{}", self.reflectors), &sheet),
            None => Ok(()),
        }
    }

    /// Figure 8: the reflector with the most pixels, enlarged. A row for each reference (reflected rays, then multi-view
    /// rendering at a multiple of the resolution): the reference, and then each way with its FLIP map.
    pub(super) fn figure_8(&self, pose: Pose, seen: &Seen, references: &[&RgbImage]) -> Result<()> {
        let ways = self.compared(pose);
        if ways.is_empty() {
            return Ok(());
        }
        let part = largest(seen);
        let mut rows = Vec::new();
        for reference in references {
            let mut row = vec![enlarged(reference, part)];
            for way in &ways {
                row.push(enlarged(way, part));
                row.push(enlarged(&flip_map(reference, way)?, part));
            }
            rows.push(row);
        }
        let rows: Vec<Vec<&RgbImage>> = rows.iter().map(|row| row.iter().collect()).collect();
        match grid(&rows) {
            Some(sheet) => save(self.options, &format!("figure-8-{}-{pose}", self.reflectors), &sheet),
            None => Ok(()),
        }
    }
}

/// The bounds of the reflector with the most pixels: left, top, width and height, with a margin of an eighth.
fn largest(seen: &Seen) -> [u32; 4] {
    let mut counts = vec![0u32; seen.reflectors.len()];
    seen.pixels.iter().for_each(|pixel| counts[pixel.reflector as usize] += 1);
    let most = (0u32..).zip(&counts).max_by_key(|(_, count)| **count).map(|(number, _)| number);
    let [width, height] = seen.size;
    let (mut low, mut high) = ([u32::MAX; 2], [0u32; 2]);
    let own = seen.pixels.iter().zip(&seen.surfaces).filter(|(pixel, _)| Some(pixel.reflector) == most);
    for (_, (index, ..)) in own {
        let at = [*index as u32 % width, *index as u32 / width];
        low = std::array::from_fn(|axis| low[axis].min(at[axis]));
        high = std::array::from_fn(|axis| high[axis].max(at[axis]));
    }
    let span = |axis: usize, most: u32| {
        let margin = high[axis].saturating_sub(low[axis]) / 8;
        let first = low[axis].saturating_sub(margin).min(most - 1);
        (first, (high[axis] + margin + 1).clamp(first + 1, most) - first)
    };
    let ((left, columns), (top, rows)) = (span(0, width), span(1, height));
    [left, top, columns, rows]
}

/// A part of an image, enlarged by a whole factor where it is small.
fn enlarged(image: &RgbImage, [left, top, width, height]: [u32; 4]) -> RgbImage {
    let part = crop_imm(image, left, top, width, height).to_image();
    let factor = ENLARGED.div_ceil(height.max(1));
    resize(&part, width * factor, height * factor, FilterType::Nearest)
}

/// Pictures in rows and columns, each cell as large as the largest picture; `None` without pictures.
pub(super) fn grid(rows: &[Vec<&RgbImage>]) -> Option<RgbImage> {
    let all = || rows.iter().flatten();
    let (width, height) = (all().map(|i| i.width()).max()?, all().map(|i| i.height()).max()?);
    let rows: Vec<_> = rows.iter().filter(|row| !row.is_empty()).collect();
    let columns = rows.iter().map(|row| row.len()).max()? as u32;
    let extent = |count: u32, size: u32| count * (size + GAP) - GAP;
    let (wide, high) = (extent(columns, width), extent(rows.len() as u32, height));
    let mut sheet = RgbImage::from_pixel(wide, high, image::Rgb([255; 3]));
    for (y, row) in (0u32..).zip(rows) {
        for (x, picture) in (0u32..).zip(row) {
            replace(&mut sheet, *picture, i64::from(x * (width + GAP)), i64::from(y * (height + GAP)));
        }
    }
    Some(sheet)
}

/// Writes an image, if images are wanted.
pub(super) fn save(options: &Options, name: &str, image: &image::RgbImage) -> Result<()> {
    let Some(folder) = &options.images else { return Ok(()) };
    let path = folder.join(format!("eye-points-{}.png", slug(name)));
    image.save(&path).with_context(|| format!("cannot write {}", path.display()))
}

/// A name without spaces or signs, for arguments and files.
pub(super) fn slug(name: &str) -> String {
    let name = name.to_lowercase().replace('²', "");
    let words = name.split(|c: char| !(c.is_alphanumeric() || c == '.')).filter(|word| !word.is_empty());
    words.collect::<Vec<_>>().join("-")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plain(size: [u32; 2], value: u8) -> RgbImage {
        RgbImage::from_pixel(size[0], size[1], image::Rgb([value; 3]))
    }

    #[test]
    fn a_grid_has_a_cell_for_every_picture_and_white_between() {
        let (a, b, c) = (plain([6, 4], 10), plain([6, 4], 20), plain([5, 4], 30));
        let sheet = grid(&[vec![&a, &b], vec![], vec![&c]]).unwrap();
        assert_eq!(sheet.dimensions(), (6 + GAP + 6, 4 + GAP + 4));
        let at = |x: u32, y: u32| sheet.get_pixel(x, y)[0];
        assert_eq!([at(0, 0), at(6 + GAP, 3), at(4, 4 + GAP)], [10, 20, 30]);
        assert_eq!([at(6, 0), at(0, 4), at(5, 4 + GAP)], [255; 3]);
        assert!(grid(&[vec![], vec![]]).is_none() && grid(&[]).is_none());
    }

    #[test]
    fn a_small_part_is_enlarged_by_a_whole_factor() {
        let mut image = plain([40, 30], 0);
        image.put_pixel(12, 9, image::Rgb([200; 3]));
        let part = enlarged(&image, [10, 8, 5, 4]);
        assert_eq!(part.dimensions(), (320, 256));
        assert_eq!([part.get_pixel(2 * 64, 64)[0], part.get_pixel(2 * 64 - 1, 64)[0]], [200, 0]);
    }
}
