//! Lossless packing of images in their stored format.
//!
//! Neighbouring texels are similar, also as integers: the bits of an IEEE float grow with its value. So each channel
//! is replaced by its difference from the previous texel, and differences are folded (zigzag) so that small ones of
//! either sign have leading zeros. Bytes of equal significance are stored together, and zstd at level 1 compresses
//! the rest. Row ends are ignored: a row's first texel is predicted by the last one of the row above, which costs one
//! larger difference per row.

use std::cell::RefCell;

use argus_scene::{Channel, Output, PlaneFormat};
use bytes::Bytes;
use zstd::bulk::{Compressor, Decompressor};

use crate::WireError;

/// The channels of a texel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Layout {
    /// One byte: mask, source, confidence.
    R8,
    /// Three bytes: sRGB colour.
    Rgb8,
    /// Four bytes.
    Rgba8,
    /// Two 16-bit channels.
    Rg16,
    /// Four 16-bit channels.
    Rgba16,
    /// One 32-bit channel.
    R32,
    /// Two 32-bit channels.
    Rg32,
    /// Three 32-bit channels.
    Rgb32,
    /// 9 + 9 + 9 bits of mantissa and 5 of exponent.
    Rgb9e5,
}

impl Layout {
    /// Bytes of one texel.
    pub fn texel_bytes(self) -> usize {
        match self {
            Self::R8 => 1,
            Self::Rgb8 => 3,
            Self::Rgba8 | Self::Rg16 | Self::R32 | Self::Rgb9e5 => 4,
            Self::Rgba16 | Self::Rg32 => 8,
            Self::Rgb32 => 12,
        }
    }
}

impl From<PlaneFormat> for Layout {
    fn from(format: PlaneFormat) -> Self {
        match format {
            PlaneFormat::Rgb9e5Ufloat => Self::Rgb9e5,
            PlaneFormat::Rgba16Float => Self::Rgba16,
            PlaneFormat::R32Float => Self::R32,
            PlaneFormat::Rg16Snorm => Self::Rg16,
            // Words consist of bytes and parts of bytes: small adjacent numbers.
            PlaneFormat::Rgba8Unorm | PlaneFormat::R32Uint => Self::Rgba8,
        }
    }
}

impl From<Output> for Layout {
    fn from(output: Output) -> Self {
        let format = output.format();
        match (format.channels, format.channel) {
            (3, Channel::U8) => Self::Rgb8,
            (_, Channel::U8) => Self::R8,
            (2, Channel::F32 | Channel::I32) => Self::Rg32,
            (3, Channel::F32 | Channel::I32) => Self::Rgb32,
            (_, Channel::F32 | Channel::I32) => Self::R32,
        }
    }
}

/// zstd's fastest regular level. Higher ones gain a tenth and cost several times as much.
const ZSTD_LEVEL: i32 = 1;

thread_local! {
    // Setting up a zstd context, of half a megabyte, takes longer than packing a small view.
    static COMPRESSOR: RefCell<Option<Compressor<'static>>> = const { RefCell::new(None) };
    static DECOMPRESSOR: RefCell<Option<Decompressor<'static>>> = const { RefCell::new(None) };
}

/// Packs the texels of an image. `None` if packing would not make it smaller.
///
/// # Errors
/// [`WireError::Corrupt`] if `raw` is not a whole number of texels, or if zstd has no memory.
pub fn pack(layout: Layout, raw: &[u8]) -> Result<Option<Bytes>, WireError> {
    if !raw.len().is_multiple_of(layout.texel_bytes()) {
        return Err(WireError::corrupt("the image", "its size is not a whole number of texels"));
    }
    if raw.is_empty() {
        return Ok(None);
    }
    let split = match layout {
        Layout::R8 => split::<1, 1>(raw),
        Layout::Rgb8 => split::<3, 1>(raw),
        Layout::Rgba8 => split::<4, 1>(raw),
        Layout::Rg16 => split::<2, 2>(raw),
        Layout::Rgba16 => split::<4, 2>(raw),
        Layout::R32 => split::<1, 4>(raw),
        Layout::Rg32 => split::<2, 4>(raw),
        Layout::Rgb32 => split::<3, 4>(raw),
        Layout::Rgb9e5 => split_rgb9e5(raw),
    };
    let packed = COMPRESSOR
        .with_borrow_mut(|slot| {
            if slot.is_none() {
                let mut compressor = Compressor::new(ZSTD_LEVEL)?;
                compressor.include_checksum(true)?;
                *slot = Some(compressor);
            }
            slot.as_mut().map(|compressor| compressor.compress(&split)).transpose()
        })
        .map_err(|error| WireError::corrupt("the image", error.to_string()))?;
    Ok(packed.filter(|packed| packed.len() < raw.len()).map(Bytes::from))
}

/// Inverse of [`pack`]. `packed` must unpack to exactly `raw_bytes`, which bounds the memory.
///
/// # Errors
/// [`WireError::Corrupt`] if it does not.
pub fn unpack(layout: Layout, packed: &[u8], raw_bytes: usize) -> Result<Bytes, WireError> {
    if !raw_bytes.is_multiple_of(layout.texel_bytes()) {
        return Err(WireError::corrupt("the image", "its size is not a whole number of texels"));
    }
    let split = DECOMPRESSOR
        .with_borrow_mut(|slot| {
            if slot.is_none() {
                *slot = Some(Decompressor::new()?);
            }
            slot.as_mut().map(|decompressor| decompressor.decompress(packed, raw_bytes)).transpose()
        })
        .map_err(|error| WireError::corrupt("the image", error.to_string()))?
        .unwrap_or_default();
    if split.len() != raw_bytes {
        let reason = format!("it unpacks to {} bytes instead of {raw_bytes}", split.len());
        return Err(WireError::corrupt("the image", reason));
    }
    Ok(Bytes::from(match layout {
        Layout::R8 => join::<1, 1>(&split),
        Layout::Rgb8 => join::<3, 1>(&split),
        Layout::Rgba8 => join::<4, 1>(&split),
        Layout::Rg16 => join::<2, 2>(&split),
        Layout::Rgba16 => join::<4, 2>(&split),
        Layout::R32 => join::<1, 4>(&split),
        Layout::Rg32 => join::<2, 4>(&split),
        Layout::Rgb32 => join::<3, 4>(&split),
        Layout::Rgb9e5 => join_rgb9e5(&split),
    }))
}

/// Differences of `CHANNELS` channels of `BYTES` bytes, folded, as `CHANNELS · BYTES` planes of bytes.
fn split<const CHANNELS: usize, const BYTES: usize>(raw: &[u8]) -> Vec<u8> {
    let texels = raw.len() / (CHANNELS * BYTES);
    let mut planes = vec![0; raw.len()];
    for channel in 0..CHANNELS {
        let planes = &mut planes[channel * BYTES * texels..][..BYTES * texels];
        let mut before = 0;
        for (i, texel) in raw.chunks_exact(CHANNELS * BYTES).enumerate() {
            let value = read::<BYTES>(&texel[channel * BYTES..]);
            let folded = fold::<BYTES>(value.wrapping_sub(before));
            before = value;
            for byte in 0..BYTES {
                planes[byte * texels + i] = (folded >> (8 * byte)) as u8;
            }
        }
    }
    planes
}

/// Inverse of [`split`].
fn join<const CHANNELS: usize, const BYTES: usize>(planes: &[u8]) -> Vec<u8> {
    let texels = planes.len() / (CHANNELS * BYTES);
    let mut raw = vec![0; planes.len()];
    for channel in 0..CHANNELS {
        let planes = &planes[channel * BYTES * texels..][..BYTES * texels];
        let mut value = 0u32;
        for (i, texel) in raw.chunks_exact_mut(CHANNELS * BYTES).enumerate() {
            let mut folded = 0;
            for byte in 0..BYTES {
                folded |= u32::from(planes[byte * texels + i]) << (8 * byte);
            }
            value = value.wrapping_add(unfold::<BYTES>(folded));
            texel[channel * BYTES..][..BYTES].copy_from_slice(&value.to_le_bytes()[..BYTES]);
        }
    }
    raw
}

fn read<const BYTES: usize>(at: &[u8]) -> u32 {
    let mut bytes = [0; 4];
    bytes[..BYTES].copy_from_slice(&at[..BYTES]);
    u32::from_le_bytes(bytes)
}

/// Zigzag on the low `BYTES` bytes: 0, −1, 1, −2 become 0, 1, 2, 3.
fn fold<const BYTES: usize>(difference: u32) -> u32 {
    let unused = 32 - 8 * BYTES as u32;
    let signed = (difference << unused) as i32 >> unused;
    ((signed << 1) ^ (signed >> 31)) as u32
}

/// Inverse of [`fold`], up to bits above the low `BYTES` bytes.
fn unfold<const BYTES: usize>(folded: u32) -> u32 {
    (folded >> 1) ^ (folded & 1).wrapping_neg()
}

/// Differences of the three mantissas and of the exponent, each modulo its own width: planes of the
/// mantissas' low bytes, and one of their ninth bits below the exponent.
fn split_rgb9e5(raw: &[u8]) -> Vec<u8> {
    let texels = raw.len() / 4;
    let mut planes = vec![0; raw.len()];
    let mut before = [0u32; 4];
    for (i, texel) in raw.chunks_exact(4).enumerate() {
        let value = fields_of_rgb9e5(read::<4>(texel));
        let d: [u32; 4] = std::array::from_fn(|f| value[f].wrapping_sub(before[f]));
        before = value;
        for (channel, difference) in d[..3].iter().enumerate() {
            planes[channel * texels + i] = *difference as u8;
        }
        let ninth = |f: usize| (d[f] >> 8 & 1) << f;
        planes[3 * texels + i] = (ninth(0) | ninth(1) | ninth(2) | (d[3] & 31) << 3) as u8;
    }
    planes
}

/// Inverse of [`split_rgb9e5`].
fn join_rgb9e5(planes: &[u8]) -> Vec<u8> {
    let texels = planes.len() / 4;
    let mut raw = vec![0; planes.len()];
    let mut value = [0u32; 4];
    for (i, texel) in raw.chunks_exact_mut(4).enumerate() {
        let last = u32::from(planes[3 * texels + i]);
        for f in 0..3 {
            let difference = u32::from(planes[f * texels + i]) | (last >> f & 1) << 8;
            value[f] = value[f].wrapping_add(difference) & 511;
        }
        value[3] = value[3].wrapping_add(last >> 3) & 31;
        let bits = value[0] | value[1] << 9 | value[2] << 18 | value[3] << 27;
        texel.copy_from_slice(&bits.to_le_bytes());
    }
    raw
}

fn fields_of_rgb9e5(bits: u32) -> [u32; 4] {
    [bits & 511, bits >> 9 & 511, bits >> 18 & 511, bits >> 27]
}

#[cfg(test)]
mod tests;
