//! Contact sheets: images beside one another, with captions.

use std::convert::Infallible;

use embedded_graphics::Drawable;
use embedded_graphics::draw_target::DrawTarget;
use embedded_graphics::geometry::{OriginDimensions, Point, Size};
use embedded_graphics::mono_font::MonoTextStyle;
use embedded_graphics::mono_font::ascii::FONT_9X15;
use embedded_graphics::pixelcolor::{Rgb888, RgbColor};
use embedded_graphics::text::{Baseline, Text};
use image::{GenericImage, Rgb, RgbImage};

/// Pixels between images.
const GAP: u32 = 4;
/// Height of a line of text in pixels.
const LINE: u32 = 20;
const PAPER: Rgb<u8> = Rgb([24, 25, 28]);
const INK: Rgb888 = Rgb888::new(225, 225, 225);

/// One viewer's row: three images of the same size and a caption.
pub(crate) struct Entry<'a> {
    /// The view that is judged.
    pub(crate) shown: &'a RgbImage,
    /// Its reference.
    pub(crate) reference: &'a RgbImage,
    /// Their FLIP map.
    pub(crate) difference: &'a RgbImage,
    /// A short caption; the part that does not fit is cut off.
    pub(crate) caption: String,
}

/// Arranges entries of equal image size under a title, in a nearly square sheet.
pub(crate) fn draw(title: &str, entries: &[Entry<'_>]) -> RgbImage {
    let (width, height) = entries
        .iter()
        .fold((1, 1), |(w, h), entry| (entry.shown.width().max(w), entry.shown.height().max(h)));
    let (entry_width, entry_height) = (3 * (width + GAP) + 3 * GAP, height + LINE + 2 * GAP);
    let columns = columns(entries.len() as u32, entry_width, entry_height);
    let rows = (entries.len() as u32).div_ceil(columns);
    let mut canvas = Canvas(RgbImage::from_pixel(
        columns * entry_width + 2 * GAP,
        rows * entry_height + 2 * LINE + 4 * GAP,
        PAPER,
    ));
    canvas.text(title, 2 * GAP, 2 * GAP);
    for column in 0..columns {
        for (i, heading) in ["by default", "reference", "FLIP error"].into_iter().enumerate() {
            canvas.text(heading, column * entry_width + 2 * GAP + i as u32 * (width + GAP), LINE + 2 * GAP);
        }
    }
    for (i, entry) in (0..).zip(entries) {
        let left = (i % columns) * entry_width + 2 * GAP;
        let top = (i / columns) * entry_height + 2 * LINE + 2 * GAP;
        for (j, image) in (0..).zip([entry.shown, entry.reference, entry.difference]) {
            canvas.image(image, left + j * (width + GAP), top);
        }
        canvas.text(&entry.caption, left, top + height + 2);
    }
    canvas.0
}

/// Arranges images under their captions, in rows of `columns`. A caption that does not fit is cut off.
pub fn tiles(tiles: &[(String, RgbImage)], columns: u32) -> RgbImage {
    let sides = tiles.iter().map(|(_, image)| image.dimensions());
    let (width, height) = sides.fold((1, 1), |(w, h), (x, y)| (x.max(w), y.max(h)));
    let (tile_width, tile_height) = (width + GAP, height + LINE + GAP);
    let rows = (tiles.len() as u32).div_ceil(columns);
    let size = [columns * tile_width + GAP, rows * tile_height + GAP];
    let mut canvas = Canvas(RgbImage::from_pixel(size[0], size[1], PAPER));
    for (i, (caption, image)) in (0..).zip(tiles) {
        let [left, top] = [(i % columns) * tile_width + GAP, (i / columns) * tile_height + GAP];
        let fitting: String =
            caption.chars().take((width / FONT_9X15.character_size.width) as usize).collect();
        canvas.text(&fitting, left, top);
        canvas.image(image, left, top + LINE);
    }
    canvas.0
}

/// The number of columns that makes the sheet closest to a square.
fn columns(entries: u32, width: u32, height: u32) -> u32 {
    let stretch = |columns: u32| {
        let rows = entries.max(1).div_ceil(columns);
        (f64::from(columns * width) / f64::from(rows * height)).ln().abs()
    };
    (1..=entries.max(1)).min_by(|&a, &b| stretch(a).total_cmp(&stretch(b))).unwrap_or(1)
}

/// An image for drawing text.
struct Canvas(RgbImage);

impl Canvas {
    fn text(&mut self, text: &str, left: u32, top: u32) {
        let style = MonoTextStyle::new(&FONT_9X15, INK);
        let at = Point::new(left as i32, top as i32);
        let Ok(_) = Text::with_baseline(text, at, style, Baseline::Top).draw(self);
    }

    fn image(&mut self, image: &RgbImage, left: u32, top: u32) {
        // The sheet was sized to hold every image, so this cannot fail.
        let placed = self.0.copy_from(image, left, top);
        debug_assert!(placed.is_ok());
    }
}

impl OriginDimensions for Canvas {
    fn size(&self) -> Size {
        Size::new(self.0.width(), self.0.height())
    }
}

impl DrawTarget for Canvas {
    type Color = Rgb888;
    type Error = Infallible;

    fn draw_iter<I>(&mut self, pixels: I) -> Result<(), Infallible>
    where
        I: IntoIterator<Item = embedded_graphics::Pixel<Rgb888>>,
    {
        for embedded_graphics::Pixel(at, color) in pixels {
            if let (Ok(x), Ok(y)) = (u32::try_from(at.x), u32::try_from(at.y))
                && let Some(pixel) = self.0.get_pixel_mut_checked(x, y)
            {
                *pixel = Rgb([color.r(), color.g(), color.b()]);
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_image_and_caption_is_on_the_sheet() {
        let fill = |r| RgbImage::from_pixel(20, 15, Rgb([r, 0, 0]));
        let images: Vec<[RgbImage; 3]> =
            (0..5).map(|i| [fill(50 + i), fill(100 + i), fill(150 + i)]).collect();
        let entries: Vec<Entry<'_>> = images
            .iter()
            .map(|[shown, reference, difference]| Entry {
                shown,
                reference,
                difference,
                caption: "0.01".into(),
            })
            .collect();
        let sheet = draw("title", &entries);
        for image in images.iter().flatten() {
            let color = image.get_pixel(0, 0);
            assert_eq!(sheet.pixels().filter(|pixel| *pixel == color).count(), 20 * 15, "{color:?}");
        }
        assert!(sheet.pixels().any(|pixel| pixel.0 == [225; 3]));
    }

    #[test]
    fn tiles_of_different_sizes_all_fit() {
        let images = (0..7u8).map(|i| {
            let sides = (20 + u32::from(i), 30 - u32::from(i));
            (format!("scene {i}"), RgbImage::from_pixel(sides.0, sides.1, Rgb([50 + i, 0, 0])))
        });
        let images: Vec<(String, RgbImage)> = images.collect();
        let sheet = tiles(&images, 3);
        for (_, image) in &images {
            let shown = sheet.pixels().filter(|pixel| *pixel == image.get_pixel(0, 0)).count();
            assert_eq!(shown, image.pixels().len());
        }
    }

    #[test]
    fn sixteen_views_make_a_nearly_square_sheet() {
        assert_eq!(columns(16, 620, 180), 2);
        assert_eq!(columns(1, 620, 180), 1);
        assert_eq!(columns(0, 620, 180), 1);
    }
}
