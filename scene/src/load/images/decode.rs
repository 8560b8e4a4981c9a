//! One image file: its size first, then its texels.

use std::io::Cursor;
use std::sync::Arc;

use image::{DynamicImage, ImageDecoder, ImageFormat, ImageReader};

use super::ktx2::{self, Ktx2};
use super::size::Size;

/// Largest side of an image in texels.
const MOST_TEXELS: u32 = 16384;
/// Ratio of decoded bytes to file bytes that every image may have. Deflate reaches 1032 of its own bytes.
const MOST_BYTES_A_BYTE: u64 = 1100;
/// Decoded bytes beyond that ratio that an image may have. Even colours take next to nothing in WebP, Zstandard and
/// BasisLZ, and one bit a texel in PNG: 4096² texels of RGBA.
const MOST_EXCESS: u64 = 64 << 20;
/// Formats that are read, for messages.
const KNOWN: &str = "PNG, JPEG, WebP, KTX2, BMP, TGA, GIF, DDS";

/// An image in RGBA.
#[derive(Clone)]
pub(in crate::load) struct Pixels {
    pub(in crate::load) size: Size,
    pub(in crate::load) rgba: Arc<[u8]>,
}

/// An image file of a known format and size.
pub(super) struct ImageFile<'a> {
    bytes: &'a [u8],
    kind: Kind<'a>,
    size: Size,
}

enum Kind<'a> {
    Image(ImageFormat),
    Ktx2(Box<Ktx2<'a>>),
}

impl<'a> ImageFile<'a> {
    /// Detects the format and reads the size; `name` tells formats without a signature.
    ///
    /// # Errors
    /// The format is not supported, the header is broken, or the size is more than a file of this length can have.
    pub(super) fn inspect(name: &str, bytes: &'a [u8]) -> Result<Self, String> {
        let (kind, size) = if bytes.starts_with(&ktx2::SIGNATURE) {
            let file = Ktx2::parse(bytes)?;
            let size = file.size;
            (Kind::Ktx2(Box::new(file)), size)
        } else {
            let format = format(name, bytes)?;
            let reader = ImageReader::with_format(Cursor::new(bytes), format);
            let dimensions = guarded(|| reader.into_dimensions().map_err(|error| error.to_string()));
            let (width, height) = dimensions?;
            (Kind::Image(format), Size { width, height })
        };
        let Size { width, height } = size;
        if width == 0 || height == 0 || width > MOST_TEXELS || height > MOST_TEXELS {
            return Err(format!("{width}×{height} texels; 1 to {MOST_TEXELS} a side are supported"));
        }
        let file = Self { bytes, kind, size };
        if file.excess() > MOST_EXCESS {
            return Err(format!("{width}×{height} texels cannot be held by {} bytes", bytes.len()));
        }
        Ok(file)
    }

    /// Bytes of RGBA.
    pub(super) fn decoded(&self) -> u64 {
        self.size.texels() * 4
    }

    /// Bytes of RGBA beyond what every file of this length may have.
    pub(super) fn excess(&self) -> u64 {
        self.beyond(self.decoded())
    }

    /// What is left of some decoded bytes beyond what every file of this length may have.
    fn beyond(&self, decoded: u64) -> u64 {
        decoded.saturating_sub((self.bytes.len() as u64).saturating_mul(MOST_BYTES_A_BYTE))
    }

    /// Decodes the first image of the file.
    ///
    /// # Errors
    /// The decoder's reason.
    pub(super) fn decode(&self) -> Result<Pixels, String> {
        let rgba = guarded(|| match &self.kind {
            Kind::Ktx2(file) => file.decode(),
            Kind::Image(format) => self.image(*format),
        })?;
        Ok(Pixels { size: self.size, rgba: Arc::from(rgba) })
    }

    fn image(&self, format: ImageFormat) -> Result<Vec<u8>, String> {
        let mut reader = ImageReader::with_format(Cursor::new(self.bytes), format);
        // Four channels of 16 bits, and as much again for the decoder.
        let most = self.decoded().saturating_mul(2).saturating_add(64 << 10);
        let mut limits = image::Limits::default();
        limits.max_image_width = Some(MOST_TEXELS);
        limits.max_image_height = Some(MOST_TEXELS);
        limits.max_alloc = Some(most.saturating_mul(2));
        reader.limits(limits);
        let decoder = reader.into_decoder().map_err(|error| error.to_string())?;
        let (width, height) = decoder.dimensions();
        // Texels of 16 bits are twice what `inspect` counted.
        let claimed = decoder.total_bytes();
        if (Size { width, height }) != self.size || claimed > most || self.beyond(claimed) > MOST_EXCESS {
            return Err(format!("{width}×{height} texels cannot be held by {} bytes", self.bytes.len()));
        }
        let image = DynamicImage::from_decoder(decoder).map_err(|error| error.to_string())?;
        Ok(image.into_rgba8().into_raw())
    }
}

/// Runs a decoder of another crate. They index by what they read: `png` 0.18.1 panics at a palette of one byte.
fn guarded<T>(decode: impl FnOnce() -> Result<T, String>) -> Result<T, String> {
    let caught = std::panic::catch_unwind(std::panic::AssertUnwindSafe(decode));
    caught.unwrap_or_else(|_| Err("is broken in a way that its decoder does not check".to_owned()))
}

/// The format by the first bytes. A TGA file has no signature.
fn format(name: &str, bytes: &[u8]) -> Result<ImageFormat, String> {
    use ImageFormat::{Bmp, Dds, Gif, Jpeg, Png, Tga, WebP};
    match image::guess_format(bytes) {
        Ok(format @ (Png | Jpeg | WebP | Bmp | Gif | Dds)) => Ok(format),
        Ok(format) => Err(format!("{format:?} images are not supported ({KNOWN} are)")),
        Err(_) if matches!(ImageFormat::from_path(name), Ok(Tga)) => Ok(Tga),
        Err(_) => Err(format!("is no image format known here ({KNOWN})")),
    }
}
