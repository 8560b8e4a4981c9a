//! Contact sheets: images beside one another, with captions.

use std::convert::Infallible;

use embedded_graphics::Drawable;
use embedded_graphics::draw_target::DrawTarget;
use embedded_graphics::geometry::{OriginDimensions, Point, Size};
use embedded_graphics::mono_font::MonoTextStyle;
use embedded_graphics::mono_font::ascii::FONT_9X15;
use embedded_graphics::pixelcolor::{Rgb888, RgbColor};
use embedded_graphics::text::{Baseline, Text};
use image::imageops::FilterType;
use image::{GenericImage, Rgb, RgbImage};

/// Pixels between images.
const GAP: u32 = 4;
/// Height of a line of text in pixels.
const LINE: u32 = 20;
const PAPER: Rgb<u8> = Rgb([24, 25, 28]);
const INK: Rgb888 = Rgb888::new(225, 225, 225);

/// A row of the sheet: images that belong together, and a caption.
pub(crate) struct Entry {
    /// The images; a missing one leaves its place to a note.
    pub(crate) images: [Option<RgbImage>; 4],
    /// A short caption; the part that does not fit is cut off.
    pub(crate) caption: String,
}

/// Arranges rows in columns, each under its own heading, below a title. `headings` say what the images of a row are, `missing` stands in
/// the place of an image that there is none of. Images larger than the second of the first row are scaled to its size.
pub(crate) fn draw(
    title: &str,
    headings: [&str; 4],
    missing: [&str; 2],
    columns: &[(String, Vec<Entry>)],
) -> RgbImage {
    let shown = columns.iter().flat_map(|(_, entries)| entries).find_map(|entry| entry.images[1].as_ref());
    let (width, height) = shown.map_or((1, 1), RgbImage::dimensions);
    // Words need a least width.
    let cell = width.max(18 * FONT_9X15.character_size.width);
    let (entry_width, entry_height) = (4 * (cell + GAP) + 6 * GAP, height + LINE + 3 * GAP);
    let rows = columns.iter().map(|(_, entries)| entries.len() as u32).max().unwrap_or_default();
    let top = 3 * LINE + 5 * GAP;
    let mut canvas = Canvas(RgbImage::from_pixel(
        columns.len() as u32 * entry_width + 2 * GAP,
        top + rows * entry_height + GAP,
        PAPER,
    ));
    let most = |width: u32| (width / FONT_9X15.character_size.width) as usize;
    let fitting = |text: &str, width: u32| text.chars().take(most(width)).collect::<String>();
    canvas.text(title, 2 * GAP, 2 * GAP);
    for (column, (heading, entries)) in (0..).zip(columns) {
        let left = column * entry_width + 2 * GAP;
        canvas.text(&fitting(heading, entry_width - 6 * GAP), left, LINE + 3 * GAP);
        for (i, heading) in (0..).zip(headings) {
            canvas.text(&fitting(heading, cell), left + i * (cell + GAP), 2 * LINE + 3 * GAP);
        }
        for (row, entry) in (0..).zip(entries) {
            let top = top + row * entry_height;
            for (i, image) in (0..).zip(&entry.images) {
                let left = left + i * (cell + GAP);
                match image {
                    Some(image) => canvas.image(&fit(image, width, height), left, top),
                    None => (0..).zip(missing).for_each(|(line, text)| {
                        canvas.text(text, left, top + height / 2 - LINE + line * LINE);
                    }),
                }
            }
            canvas.text(&fitting(&entry.caption, entry_width - 6 * GAP), left, top + height + 2);
        }
    }
    canvas.0
}

/// An image that is no larger than a size.
fn fit(image: &RgbImage, width: u32, height: u32) -> RgbImage {
    if image.width() <= width && image.height() <= height {
        return image.clone();
    }
    let scale =
        (f64::from(width) / f64::from(image.width())).min(f64::from(height) / f64::from(image.height()));
    let scaled = |side: u32| ((f64::from(side) * scale).round() as u32).max(1);
    image::imageops::resize(image, scaled(image.width()), scaled(image.height()), FilterType::Triangle)
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
    fn every_image_is_on_the_sheet_and_a_missing_one_leaves_its_place() {
        let fill = |r| RgbImage::from_pixel(200, 150, Rgb([r, 0, 0]));
        let entry = |i: u8| Entry {
            images: [
                (i != 3).then(|| fill(40 + i)),
                Some(fill(80 + i)),
                Some(fill(120 + i)),
                Some(fill(160 + i)),
            ],
            caption: "0.01".to_owned(),
        };
        let columns = [
            ("3 times".to_owned(), vec![entry(0), entry(1), entry(2)]),
            ("10 times".to_owned(), vec![entry(3)]),
        ];
        let sheet = draw("title", ["a", "b", "c", "d"], ["no", "source"], &columns);
        for image in
            columns.iter().flat_map(|(_, entries)| entries).flat_map(|entry| entry.images.iter().flatten())
        {
            let color = image.get_pixel(0, 0);
            assert_eq!(sheet.pixels().filter(|pixel| *pixel == color).count(), 200 * 150, "{color:?}");
        }
        assert!(!sheet.pixels().any(|pixel| pixel.0 == [43, 0, 0]));
        assert!(sheet.pixels().any(|pixel| pixel.0 == [225; 3]));
    }

    #[test]
    fn an_image_with_a_border_is_scaled_to_its_place() {
        let image = RgbImage::from_pixel(250, 188, Rgb([9, 9, 9]));
        assert_eq!(fit(&image, 200, 150).dimensions(), (199, 150));
        assert_eq!(fit(&image, 300, 200).dimensions(), (250, 188));
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
}
