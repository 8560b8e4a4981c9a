//! Environment maps from Radiance (`.hdr`) and OpenEXR (`.exr`) files.

use std::io::Cursor;
use std::path::Path;

use glam::Vec3;
use image::{DynamicImage, ImageDecoder, ImageFormat, ImageReader};

use super::LoadError;
use crate::Environment;
use crate::environment::check_size;

/// Most bytes of a decoded map: the largest size with four colours.
const MOST_BYTES: u64 = 1 << 30;
/// Largest ratio of decoded bytes to file bytes. Deflate, the densest compression here, reaches 1032, and OpenEXR's half
/// floats become twice as long. A map that claims more is truncated or malicious, and gets no memory.
const MOST_BYTES_A_BYTE: u64 = 2200;

/// Reads an environment map and returns it with the content of its file.
///
/// # Errors
/// One line that names the file and the reason: it cannot be read, is no Radiance or OpenEXR image, is damaged, or no map
/// of all directions ([`Environment::new`]).
pub fn load_environment(path: impl AsRef<Path>) -> Result<(Environment, Vec<u8>), LoadError> {
    let path = path.as_ref();
    let shown = path.display().to_string();
    let failed = |error: std::io::Error| LoadError::new(&shown, error.to_string());
    // Reading a device or a pipe might never end.
    if !std::fs::metadata(path).map_err(failed)?.is_file() {
        return Err(LoadError::new(&shown, "not a file"));
    }
    let bytes = std::fs::read(path).map_err(failed)?;
    Ok((decode_environment(&shown, &bytes)?, bytes))
}

/// Reads an environment map from the content of a file. `name` is the file's name for messages.
///
/// # Errors
/// As [`load_environment`].
pub fn decode_environment(name: &str, bytes: &[u8]) -> Result<Environment, LoadError> {
    decode(bytes).map_err(|reason| LoadError::new(name, reason))
}

fn decode(bytes: &[u8]) -> Result<Environment, String> {
    if bytes.is_empty() {
        return Err("the file is empty".to_owned());
    }
    let format = match image::guess_format(bytes) {
        Ok(format @ (ImageFormat::Hdr | ImageFormat::OpenExr)) => format,
        _ => return Err("is no environment map: a Radiance (.hdr) or OpenEXR (.exr) image".to_owned()),
    };
    let mut reader = ImageReader::with_format(Cursor::new(bytes), format);
    let mut limits = image::Limits::default();
    limits.max_alloc = Some(MOST_BYTES);
    reader.limits(limits);
    let decoder = reader.into_decoder().map_err(|error| error.to_string())?;
    let (width, height) = decoder.dimensions();
    check_size(width, height)?;
    if decoder.total_bytes() > (bytes.len() as u64).saturating_mul(MOST_BYTES_A_BYTE).saturating_add(64 << 10)
    {
        return Err(format!("{width}×{height} texels cannot be held by {} bytes", bytes.len()));
    }
    let image = DynamicImage::from_decoder(decoder).map_err(|error| error.to_string())?.into_rgb32f();
    let texels = image.as_raw().chunks_exact(3).map(Vec3::from_slice).collect();
    Environment::new(width, height, texels)
}
