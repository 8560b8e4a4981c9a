//! Draws plots into images. Text is in fonts of two sizes that are compiled in, so no font files are needed.

use std::convert::Infallible;

use embedded_graphics::mono_font::iso_8859_1::{FONT_7X14, FONT_10X20};
use embedded_graphics::mono_font::{MonoFont, MonoTextStyle};
use embedded_graphics::pixelcolor::BinaryColor;
use embedded_graphics::prelude::{DrawTarget, Drawable, OriginDimensions, Point, Size};
use embedded_graphics::text::{Baseline, Text};
use image::RgbImage;
use plotters_backend::text_anchor::{HPos, VPos};
use plotters_backend::{BackendColor, BackendCoord, BackendTextStyle, DrawingBackend, DrawingErrorKind};

/// Smallest text size in pixels for which the larger font is used.
const LARGE: f64 = 18.0;

/// A drawing backend of `plotters` that draws into an image.
pub(super) struct Raster<'a>(pub(super) &'a mut RgbImage);

type Drawn<T = ()> = Result<T, DrawingErrorKind<Infallible>>;

impl DrawingBackend for Raster<'_> {
    type ErrorType = Infallible;

    fn get_size(&self) -> (u32, u32) {
        self.0.dimensions()
    }

    fn ensure_prepared(&mut self) -> Drawn {
        Ok(())
    }

    fn present(&mut self) -> Drawn {
        Ok(())
    }

    fn draw_pixel(&mut self, (x, y): BackendCoord, color: BackendColor) -> Drawn {
        if let (Ok(x), Ok(y)) = (u32::try_from(x), u32::try_from(y))
            && let Some(pixel) = self.0.get_pixel_mut_checked(x, y)
        {
            let (r, g, b) = color.rgb;
            for (below, above) in pixel.0.iter_mut().zip([r, g, b]) {
                *below =
                    (f64::from(*below) * (1.0 - color.alpha) + f64::from(above) * color.alpha).round() as u8;
            }
        }
        Ok(())
    }

    fn draw_text<S: BackendTextStyle>(&mut self, text: &str, style: &S, at: BackendCoord) -> Drawn {
        let (width, height) = extent(text, style.size());
        let left = match style.anchor().h_pos {
            HPos::Left => 0,
            HPos::Center => -width / 2,
            HPos::Right => -width,
        };
        let top = match style.anchor().v_pos {
            VPos::Top => 0,
            VPos::Center => -height / 2,
            VPos::Bottom => -height,
        };
        let mut inked = Inked(Vec::new());
        let font = MonoTextStyle::new(font(style.size()), BinaryColor::On);
        let Ok(_) = Text::with_baseline(text, Point::new(left, top), font, Baseline::Top).draw(&mut inked);
        for Point { x, y } in inked.0 {
            let (x, y) = style.transform().transform(x, y);
            self.draw_pixel((at.0 + x, at.1 + y), style.color())?;
        }
        Ok(())
    }

    fn estimate_text_size<S: BackendTextStyle>(&self, text: &str, style: &S) -> Drawn<(u32, u32)> {
        let (width, height) = extent(text, style.size());
        Ok((width.unsigned_abs(), height.unsigned_abs()))
    }
}

fn font(size: f64) -> &'static MonoFont<'static> {
    if size < LARGE { &FONT_7X14 } else { &FONT_10X20 }
}

/// Width and height of a line of text, in pixels.
fn extent(text: &str, size: f64) -> (i32, i32) {
    let Size { width, height } = font(size).character_size;
    (text.chars().count() as i32 * width as i32, height as i32)
}

/// Collects the pixels of letters, which may lie anywhere.
struct Inked(Vec<Point>);

impl OriginDimensions for Inked {
    fn size(&self) -> Size {
        Size::new_equal(u32::MAX)
    }
}

impl DrawTarget for Inked {
    type Color = BinaryColor;
    type Error = Infallible;

    fn draw_iter<I>(&mut self, pixels: I) -> Result<(), Infallible>
    where
        I: IntoIterator<Item = embedded_graphics::Pixel<BinaryColor>>,
    {
        self.0.extend(pixels.into_iter().filter(|pixel| pixel.1.is_on()).map(|pixel| pixel.0));
        Ok(())
    }
}
