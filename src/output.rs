//! Output: one JSON object on standard output, and image files.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;
use std::time::Duration;

use anyhow::Context;
use argus_scene::{Frame, Output};
use exr::image::{AnyChannel, AnyChannels, FlatSamples, Image as ExrImage};
use exr::prelude::WritableImage;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ColorType, ExtendedColorType, ImageEncoder, RgbImage};
use indicatif::{ProgressBar, ProgressStyle};
use serde::Serialize;

/// Prints the JSON object of a run.
pub fn json(value: &impl Serialize) -> anyhow::Result<()> {
    let mut out = std::io::stdout().lock();
    serde_json::to_writer_pretty(&mut out, value)?;
    writeln!(out)?;
    out.flush().context("cannot write to standard output")
}

/// The colour of a frame as an image.
///
/// # Errors
/// The frame has no colour.
pub(crate) fn image_of(frame: &Frame) -> anyhow::Result<RgbImage> {
    let pixels = frame.images[Output::Color].as_ref().context("the frame has no colour")?;
    RgbImage::from_raw(frame.width, frame.height, pixels.to_vec()).context("the frame's colour is short")
}

/// Writes an sRGB image, 3 bytes a pixel, as PNG.
///
/// Uses fast compression: the default takes longer than rendering the view.
pub(crate) fn write_rgb_png(path: &Path, width: u32, height: u32, rgb: &[u8]) -> anyhow::Result<()> {
    write_png(path, width, height, rgb, ColorType::Rgb8)
}

/// Bits of each channel that a small picture keeps.
const KEPT_BITS: u32 = 6;

/// Writes a picture for documents as a PNG of few bytes: its lowest bits are rounded away, which cannot be seen.
pub fn write_small_png(path: &Path, image: &RgbImage) -> anyhow::Result<()> {
    let (lost, most) = (8 - KEPT_BITS, (1u32 << KEPT_BITS) - 1);
    let rounded = |byte: u8| {
        let kept = (u32::from(byte) * most + 127) / 255;
        (kept << lost | kept >> (KEPT_BITS - lost)) as u8
    };
    let bytes: Vec<u8> = image.as_raw().iter().map(|byte| rounded(*byte)).collect();
    let mut file = create(path)?;
    PngEncoder::new_with_quality(&mut file, CompressionType::Best, FilterType::Adaptive)
        .write_image(&bytes, image.width(), image.height(), ExtendedColorType::Rgb8)
        .and_then(|()| Ok(file.flush()?))
        .with_context(|| format!("cannot write {}", path.display()))
}

/// Writes one byte per pixel as a grey PNG.
pub(crate) fn write_gray_png(path: &Path, width: u32, height: u32, gray: &[u8]) -> anyhow::Result<()> {
    write_png(path, width, height, gray, ColorType::L8)
}

/// Writes a number of 16 bits per pixel as a grey PNG.
pub(crate) fn write_gray16_png(path: &Path, width: u32, height: u32, gray: &[u16]) -> anyhow::Result<()> {
    // The encoder takes the machine's order of bytes.
    let bytes: Vec<u8> = gray.iter().flat_map(|number| number.to_ne_bytes()).collect();
    write_png(path, width, height, &bytes, ColorType::L16)
}

fn write_png(path: &Path, width: u32, height: u32, bytes: &[u8], color: ColorType) -> anyhow::Result<()> {
    let mut file = create(path)?;
    PngEncoder::new_with_quality(&mut file, CompressionType::Fast, FilterType::Adaptive)
        .write_image(bytes, width, height, ExtendedColorType::from(color))
        .and_then(|()| Ok(file.flush()?))
        .with_context(|| format!("cannot write {}", path.display()))
}

/// Writes channels of 32-bit floats as one OpenEXR file. By convention, `R`, `G` and `B` are linear radiance, `Z` a distance along the
/// camera's axis, and a layer's name stands before a dot: `albedo.R`.
pub(crate) fn write_channels_exr(
    path: &Path,
    width: u32,
    height: u32,
    channels: Vec<(&str, Vec<f32>)>,
) -> anyhow::Result<()> {
    let channels = channels.into_iter().map(|(name, values)| (name, FlatSamples::F32(values))).collect();
    write_samples_exr(path, width, height, channels)
}

/// Writes channels of numbers as one OpenEXR file. Equal images make equal files: blocks compressed in parallel would be written in
/// the order in which they are done.
pub(crate) fn write_samples_exr(
    path: &Path,
    width: u32,
    height: u32,
    channels: Vec<(&str, FlatSamples)>,
) -> anyhow::Result<()> {
    let channels = channels.into_iter().map(|(name, values)| AnyChannel::new(name, values));
    let image =
        ExrImage::from_channels((width as usize, height as usize), AnyChannels::sort(channels.collect()));
    // The encoder seeks, so it gets the file itself.
    let written = image.write().non_parallel().to_buffered(create(path)?);
    written.with_context(|| format!("cannot write {}", path.display()))
}

/// A progress bar on standard error, if that is a terminal.
pub(crate) fn progress() -> ProgressBar {
    let bar = ProgressBar::no_length();
    if let Ok(style) = ProgressStyle::with_template("{bar:30} {pos:>4}/{len} {msg} ({elapsed})") {
        bar.set_style(style);
    }
    bar.enable_steady_tick(Duration::from_millis(100));
    bar
}

/// Reads an image file as 8-bit RGB.
pub(crate) fn read_rgb(path: &Path) -> anyhow::Result<RgbImage> {
    let image = image::ImageReader::open(path)
        .and_then(|reader| reader.with_guessed_format())
        .with_context(|| format!("cannot open {}", path.display()))?
        .decode()
        .with_context(|| format!("cannot read {} as an image", path.display()))?;
    Ok(image.into_rgb8())
}

fn create(path: &Path) -> anyhow::Result<BufWriter<File>> {
    if let Some(folder) = path.parent().filter(|folder| !folder.as_os_str().is_empty()) {
        std::fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
    }
    let file = File::create(path).with_context(|| format!("cannot write {}", path.display()))?;
    Ok(BufWriter::new(file))
}
