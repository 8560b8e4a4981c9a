//! Environment maps from Radiance (`.hdr`) and OpenEXR (`.exr`) files.

use std::io::Cursor;
use std::path::Path;

use exr::prelude::{ReadChannels, ReadLayers, ReadSpecificChannel};
use glam::Vec3;
use image::codecs::hdr::HdrDecoder;
use image::{DynamicImage, ImageDecoder, ImageFormat};

use super::LoadError;
use crate::Environment;
use crate::environment::check_size;

/// Radiance in place of infinity: the largest half float.
const MOST_RADIANCE: f32 = 65504.0;
/// Largest ratio of decoded bytes to file bytes. Deflate, the densest compression here, reaches 1032, and OpenEXR's half
/// floats become twice as long. A map that claims more is truncated or malicious, and gets no memory.
const MOST_BYTES_A_BYTE: u64 = 2200;
/// Bytes of an OpenEXR block beyond that ratio that a file may ask for: programs write small images in large tiles.
const SMALL_BLOCK: u64 = 16 << 20;

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

/// A decoded image.
struct Decoded {
    size: [u32; 2],
    texels: Vec<Vec3>,
    /// What the picture lacks of it.
    warnings: Vec<String>,
}

fn decode(bytes: &[u8]) -> Result<Environment, String> {
    if bytes.is_empty() {
        return Err("the file is empty".to_owned());
    }
    let Decoded { size: [width, height], mut texels, mut warnings } = match image::guess_format(bytes) {
        Ok(ImageFormat::Hdr) => decode_hdr(bytes)?,
        Ok(ImageFormat::OpenExr) => decode_exr(bytes)?,
        _ if bytes.starts_with(b"#?RGBE") => decode_hdr(bytes)?,
        _ => return Err("is no environment map: a Radiance (.hdr) or OpenEXR (.exr) image".to_owned()),
    };
    warnings.extend(clamp(&mut texels));
    let environment = Environment::new(width, height, texels)?;
    Ok(Environment { warnings, ..environment })
}

/// Checks a map's size before it gets memory.
fn check(width: u32, height: u32, file: usize) -> Result<(), String> {
    check_size(width, height)?;
    let decoded = u64::from(width) * u64::from(height) * size_of::<Vec3>() as u64;
    if decoded > (file as u64).saturating_mul(MOST_BYTES_A_BYTE).saturating_add(64 << 10) {
        return Err(format!("{width}×{height} texels cannot be held by {file} bytes"));
    }
    Ok(())
}

/// Makes radiance finite and not negative, and says how many texels were not: filters of other programs overshoot, and half
/// floats overflow.
fn clamp(texels: &mut [Vec3]) -> Option<String> {
    let count = texels.len();
    let mut changed = 0usize;
    for texel in texels {
        let fits = |x: f32| {
            if x > 0.0 { x.min(MOST_RADIANCE.max(if x.is_finite() { x } else { 0.0 })) } else { 0.0 }
        };
        let sound = Vec3::from(texel.to_array().map(fits));
        // A NaN differs from everything, and −0 from nothing.
        changed += usize::from(!(sound == *texel));
        *texel = sound;
    }
    (changed > 0).then(|| {
        format!(
            "{changed} of {count} texels are negative, NaN or infinite: shown as 0, 0 and {MOST_RADIANCE}"
        )
    })
}

/// Whether numbers are the chromaticities of red, green, blue and white of Rec. 709.
fn is_rec709(numbers: &[f32]) -> bool {
    const REC709: [f32; 8] = [0.64, 0.33, 0.3, 0.6, 0.15, 0.06, 0.3127, 0.329];
    numbers.len() == 8 && numbers.iter().zip(REC709).all(|(a, b)| (a - b).abs() < 0.005)
}

fn warn_of_primaries(warnings: &mut Vec<String>) {
    warnings.push("its primaries are not those of Rec. 709, as which its colours are shown".to_owned());
}

/// Reads a Radiance image. Its header may say by what its values were multiplied.
fn decode_hdr(bytes: &[u8]) -> Result<Decoded, String> {
    let decoder = HdrDecoder::new_nonstrict(Cursor::new(bytes)).map_err(|error| error.to_string())?;
    let (width, height) = decoder.dimensions();
    check(width, height, bytes.len())?;
    let mut warnings = Vec::new();
    let mut factor = Vec3::ONE;
    for (key, value) in decoder.metadata().custom_attributes {
        let numbers: Vec<f32> = value.split_whitespace().filter_map(|word| word.parse().ok()).collect();
        match (key.as_str(), &numbers[..]) {
            ("EXPOSURE", &[x]) if x.is_finite() && x > 0.0 => factor *= x,
            ("COLORCORR", &[r, g, b]) if r.min(g).min(b) > 0.0 && (r + g + b).is_finite() => {
                factor *= Vec3::new(r, g, b);
            }
            ("EXPOSURE" | "COLORCORR", _) => warnings.push(format!("{key}={value} is no factor: left out")),
            ("PRIMARIES", numbers) if !is_rec709(numbers) => warn_of_primaries(&mut warnings),
            ("GAMMA", numbers) if numbers != [1.0] => {
                warnings.push(format!("GAMMA={value}: its values are shown as linear"));
            }
            ("PIXASPECT", numbers) if numbers != [1.0] => {
                warnings.push(format!("PIXASPECT={value}: its texels are shown as squares"));
            }
            _ => {}
        }
    }
    if !(factor.is_finite() && factor.recip().is_finite()) {
        warnings.push("the product of its EXPOSURE and COLORCORR is no factor: left out".to_owned());
        factor = Vec3::ONE;
    }
    let image = DynamicImage::from_decoder(decoder).map_err(|error| error.to_string())?.into_rgb32f();
    let texels = image.as_raw().chunks_exact(3).map(|rgb| Vec3::from_slice(rgb) / factor).collect();
    Ok(Decoded { size: [width, height], texels, warnings })
}

/// Reads the first layer of an OpenEXR image that has red, green and blue, or else one channel of brightness.
fn decode_exr(bytes: &[u8]) -> Result<Decoded, String> {
    let failed = |error: exr::error::Error| error.to_string();
    let reader = exr::block::read(Cursor::new(bytes), false).map_err(failed)?;
    check_blocks(reader.headers(), bytes.len())?;
    let layers = reader.headers().iter().filter(|header| !header.deep);
    let (header, channels) = layers
        .filter_map(|header| Some((header, channels(header)?)))
        .min_by_key(|(_, channels)| channels.len() == 1)
        .ok_or("it has neither red, green and blue nor one channel of brightness (Y)")?;
    let window = header.shared_attributes.display_window;
    let size =
        [window.size.width(), window.size.height()].map(|side| u32::try_from(side).unwrap_or(u32::MAX));
    let [width, height] = size;
    check(width, height, bytes.len())?;
    if header.own_attributes.environment_map == Some(exr::meta::attribute::EnvironmentMap::Cube) {
        return Err("it is a cube map; a map of all directions is twice as wide as high".to_owned());
    }
    if header.channels.list.iter().any(|channel| channel.sampling != exr::math::Vec2(1, 1)) {
        return Err("its channels have fewer texels than the image, which is not supported".to_owned());
    }
    let mut warnings = Vec::new();
    if let Some(of) = &header.shared_attributes.chromaticities {
        let pairs = [of.red, of.green, of.blue, of.white].map(|pair| [pair.x(), pair.y()]);
        if !is_rec709(pairs.as_flattened()) {
            warn_of_primaries(&mut warnings);
        }
    }
    let offset = header.own_attributes.layer_position - window.position;
    let empty = move || vec![Vec3::ZERO; width as usize * height as usize];
    // Texels outside of the display window are not shown.
    let set = move |texels: &mut Vec<Vec3>, at: exr::math::Vec2<usize>, color: Vec3| {
        let [x, y] =
            [(at.x(), offset.x()), (at.y(), offset.y())].map(|(at, offset)| at as i64 + i64::from(offset));
        if (0..i64::from(width)).contains(&x) && (0..i64::from(height)).contains(&y) {
            texels[(y * i64::from(width) + x) as usize] = color;
        }
    };
    let read = exr::prelude::read().no_deep_data().largest_resolution_level().specific_channels();
    let texels = match &channels[..] {
        [r, g, b] => {
            let pixels = read.required(r.as_str()).required(g.as_str()).required(b.as_str()).collect_pixels(
                move |_, _: &(_, _, _)| empty(),
                move |texels: &mut Vec<Vec3>, at, (r, g, b): (f32, f32, f32)| {
                    set(texels, at, Vec3::new(r, g, b))
                },
            );
            let image = pixels.first_valid_layer().all_attributes().from_chunks(reader).map_err(failed)?;
            image.layer_data.channel_data.pixels
        }
        one => {
            let pixels = read.required(one[0].as_str()).collect_pixels(
                move |_, _: &(_,)| empty(),
                move |texels: &mut Vec<Vec3>, at, (y,): (f32,)| set(texels, at, Vec3::splat(y)),
            );
            let image = pixels.first_valid_layer().all_attributes().from_chunks(reader).map_err(failed)?;
            image.layer_data.channel_data.pixels
        }
    };
    Ok(Decoded { size, texels, warnings })
}

/// Checks the size of blocks, which get memory before they are read: a layer's data window and its tiles may be of any
/// size, whatever the window that is shown. Layers that are not shown are read over, too.
fn check_blocks(headers: &[exr::meta::header::Header], file: usize) -> Result<(), String> {
    for header in headers {
        let block = header.max_block_pixel_size();
        let texel = header.channels.bytes_per_pixel as u64;
        let bytes = (block.width() as u64).saturating_mul(block.height() as u64).saturating_mul(texel);
        if bytes > (file as u64).saturating_mul(MOST_BYTES_A_BYTE).saturating_add(SMALL_BLOCK) {
            let [width, height] = [block.width(), block.height()];
            return Err(format!("blocks of {width}×{height} texels cannot be held by {file} bytes"));
        }
    }
    Ok(())
}

/// The names of a layer's red, green and blue, or of its one channel of brightness. Programs put the layer's name before
/// them.
fn channels(header: &exr::meta::header::Header) -> Option<Vec<String>> {
    let names: Vec<String> = header.channels.list.iter().map(|channel| channel.name.to_string()).collect();
    let of_color = names.iter().filter_map(|name| name.strip_suffix('R')).find_map(|layer| {
        let rgb = ["R", "G", "B"].map(|color| format!("{layer}{color}"));
        rgb.iter().all(|name| names.contains(name)).then(|| rgb.to_vec())
    });
    let is_bright = |name: &&String| name.as_str() == "Y" || name.ends_with(".Y");
    let bright = || names.iter().find(is_bright).or(names.first().filter(|_| names.len() == 1));
    of_color.or_else(|| bright().map(|name| vec![name.clone()]))
}
