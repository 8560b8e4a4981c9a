//! KTX2 files: uncompressed texels, Basis Universal (ETC1S, UASTC) and ASTC. The first image of the base level is read.
//!
//! Basis Universal is decoded by `basisu`. It trusts the offsets of its container, so it gets one that is written here,
//! with the base level alone and with every offset checked.

use basisu::{DecodeFlags, TargetFormat, Transcoder};

use super::size::Size;

/// The first bytes of each file.
pub(super) const SIGNATURE: [u8; 12] = *b"\xabKTX 20\xbb\r\n\x1a\n";

/// Bytes before the level index, and bytes of an entry of it.
const HEADER: usize = 80;
const LEVEL: usize = 24;

/// How a level is packed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Packing {
    None,
    BasisLz,
    Zstandard,
    Zlib,
}

/// What is stored of a texel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Texels {
    /// Bytes of a channel, and the channel that each stored one is.
    Plain(usize, &'static [usize]),
    /// Blocks that `basisu` decodes.
    Blocks,
}

/// A parsed header.
pub(super) struct Ktx2<'a> {
    bytes: &'a [u8],
    pub(super) size: Size,
    format: u32,
    texels: Texels,
    packing: Packing,
    /// The base level as stored.
    level: &'a [u8],
    /// Its bytes when unpacked, as the file claims.
    unpacked: u64,
    /// The description of the format.
    descriptor: &'a [u8],
    /// Channels that are shown as red, green, blue and alpha; `0` and `1` are constants.
    swizzle: Option<[u8; 4]>,
}

impl<'a> Ktx2<'a> {
    /// Parses the header.
    ///
    /// # Errors
    /// The file is cut short, is not a single image, or its format is not supported.
    pub(super) fn parse(bytes: &'a [u8]) -> Result<Self, String> {
        let [format, _, width, height, depth, layers, faces, _, scheme] = words(bytes, 12)?;
        let [descriptor, descriptor_length, pairs, pairs_length] = words(bytes, 48)?;
        if depth > 1 || layers > 1 || faces > 1 {
            return Err("a volume, an array or a cube map is not supported".to_owned());
        }
        let packing = match scheme {
            0 => Packing::None,
            1 => Packing::BasisLz,
            2 => Packing::Zstandard,
            3 => Packing::Zlib,
            _ => return Err(format!("KTX2 supercompression {scheme} is not supported")),
        };
        let texels = match format {
            // Red to four channels of 8 bits, as numbers and as sRGB; then of 16 bits.
            9 | 15 => Texels::Plain(1, &[0]),
            16 | 22 => Texels::Plain(1, &[0, 1]),
            23 | 29 => Texels::Plain(1, &[0, 1, 2]),
            30 | 36 => Texels::Plain(1, &[2, 1, 0]),
            37 | 43 | 51 | 57 => Texels::Plain(1, &[0, 1, 2, 3]),
            44 | 50 => Texels::Plain(1, &[2, 1, 0, 3]),
            70 => Texels::Plain(2, &[0]),
            77 => Texels::Plain(2, &[0, 1]),
            84 => Texels::Plain(2, &[0, 1, 2]),
            91 => Texels::Plain(2, &[0, 1, 2, 3]),
            0 | 157..=184 => Texels::Blocks,
            _ => return Err(format!("KTX2 with Vulkan format {format} is not supported")),
        };
        let [offset, length, unpacked] = longs(bytes, HEADER)?;
        let pairs = part(bytes, pairs.into(), pairs_length.into())?;
        Ok(Self {
            bytes,
            size: Size { width, height },
            format,
            texels,
            packing,
            level: part(bytes, offset, length)?,
            unpacked,
            descriptor: part(bytes, descriptor.into(), descriptor_length.into())?,
            swizzle: swizzle(pairs),
        })
    }

    /// Decodes to RGBA. Memory is a small multiple of the size in texels, which the caller has checked, and of the file.
    ///
    /// # Errors
    /// The level does not have its texels.
    pub(super) fn decode(&self) -> Result<Vec<u8>, String> {
        let texels = self.size.texels() as usize;
        let mut rgba = match self.texels {
            Texels::Plain(bytes, channels) => {
                let level = self.unpacked_level(texels * bytes * channels.len())?;
                rgba_of(&level, bytes, channels)
            }
            Texels::Blocks => self.basis()?,
        };
        if rgba.len() != texels * 4 {
            return Err(format!("{} bytes of {} texels", rgba.len(), texels));
        }
        if let Some(swizzle) = self.swizzle {
            for texel in rgba.chunks_exact_mut(4) {
                let old = [texel[0], texel[1], texel[2], texel[3]];
                for (shown, name) in texel.iter_mut().zip(swizzle) {
                    *shown = match name {
                        b'r' => old[0],
                        b'g' => old[1],
                        b'b' => old[2],
                        b'a' => old[3],
                        b'1' => 255,
                        _ => 0,
                    };
                }
            }
        }
        Ok(rgba)
    }

    /// The base level's first `length` bytes, unpacked.
    fn unpacked_level(&self, length: usize) -> Result<std::borrow::Cow<'a, [u8]>, String> {
        let short = || format!("its base level does not have {length} bytes");
        match self.packing {
            Packing::None => Ok(self.level.get(..length).ok_or_else(short)?.into()),
            Packing::Zstandard => {
                let mut bytes = vec![0; length];
                // In one piece, so that the frame's own claim of a window allocates nothing.
                let read = zstd::bulk::decompress_to_buffer(self.level, &mut bytes[..]);
                let read = read.map_err(|error| format!("its base level cannot be unpacked: {error}"))?;
                if read == length { Ok(bytes.into()) } else { Err(short()) }
            }
            Packing::Zlib => {
                let mut bytes = vec![0; length];
                let mut level = flate2::read::ZlibDecoder::new(self.level);
                std::io::Read::read_exact(&mut level, &mut bytes).map_err(|_| short())?;
                Ok(bytes.into())
            }
            Packing::BasisLz => Err("BasisLZ packs no texels of this format".to_owned()),
        }
    }

    /// Decodes blocks, from a container with the base level alone.
    fn basis(&self) -> Result<Vec<u8>, String> {
        let (scheme, level, global) = match self.packing {
            Packing::BasisLz => (1, self.level.into(), self.global_data()?),
            _ => {
                // A block has 16 bytes in each of these formats, and its sides stand in the descriptor.
                let [sides] = words(self.descriptor, 16)?;
                let [across, down] = [sides & 0xff, (sides >> 8) & 0xff].map(|side| side + 1);
                let blocks =
                    self.size.width.div_ceil(across) as usize * self.size.height.div_ceil(down) as usize;
                if self.packing == Packing::None && self.unpacked < blocks as u64 * 16 {
                    return Err("its base level is cut short".to_owned());
                }
                (0, self.unpacked_level(blocks * 16)?, Vec::new())
            }
        };
        let global_at = HEADER + LEVEL + self.descriptor.len();
        let level_at = (global_at + global.len()).next_multiple_of(16);
        let mut file = Vec::with_capacity(level_at + level.len());
        file.extend(SIGNATURE);
        let Size { width, height } = self.size;
        // Images: one layer, one face, one level.
        let header = [self.format, 1, width, height, 0, 0, 1, 1, scheme];
        let places = [(HEADER + LEVEL) as u32, self.descriptor.len() as u32, 0, 0];
        file.extend(header.into_iter().chain(places).flat_map(u32::to_le_bytes));
        let unpacked = if scheme == 1 { 0 } else { level.len() };
        let global_at = if global.is_empty() { 0 } else { global_at };
        let longs = [global_at, global.len(), level_at, level.len(), unpacked];
        file.extend(longs.into_iter().flat_map(|long| (long as u64).to_le_bytes()));
        file.extend(self.descriptor);
        file.extend(global);
        file.resize(level_at, 0);
        file.extend(&*level);
        let unknown = |error: basisu::Error| format!("KTX2: {error:?}");
        let texture = Transcoder::new(&file).map_err(unknown)?;
        texture.transcode(0, TargetFormat::Rgba32, DecodeFlags::NONE).map_err(unknown)
    }

    /// The codebooks of BasisLZ, with the description of the first image alone.
    fn global_data(&self) -> Result<Vec<u8>, String> {
        let [offset, length] = longs(self.bytes, 64)?;
        let global = part(self.bytes, offset, length)?;
        let [_, endpoints, selectors, tables] = words(global, 0)?;
        let [levels] = words(self.bytes, 40)?;
        let image = part(global, 20, 20)?;
        for (at, length) in [(4, 8), (12, 16)] {
            let ([at], [length]) = (words(image, at)?, words(image, length)?);
            part(self.level, at.into(), length.into())?;
        }
        let books = 20 + 20 * u64::from(levels.max(1));
        let bytes = u64::from(endpoints) + u64::from(selectors) + u64::from(tables);
        Ok([&global[..20], image, part(global, books, bytes)?].concat())
    }
}

/// Little-endian numbers from a place on.
fn words<const N: usize>(bytes: &[u8], at: usize) -> Result<[u32; N], String> {
    let words = part(bytes, at as u64, N as u64 * 4)?.as_chunks::<4>().0;
    Ok(std::array::from_fn(|i| u32::from_le_bytes(words[i])))
}

fn longs<const N: usize>(bytes: &[u8], at: usize) -> Result<[u64; N], String> {
    let words = part(bytes, at as u64, N as u64 * 8)?.as_chunks::<8>().0;
    Ok(std::array::from_fn(|i| u64::from_le_bytes(words[i])))
}

/// A part of a file.
fn part(bytes: &[u8], at: u64, length: u64) -> Result<&[u8], String> {
    let end = at.checked_add(length).filter(|&end| end <= bytes.len() as u64);
    let end = end.ok_or("the KTX2 file is cut short")?;
    Ok(&bytes[at as usize..end as usize])
}

/// Stored channels as RGBA: missing colours are 0, missing alpha is 1. Of 16 bits the high ones are kept.
fn rgba_of(level: &[u8], bytes: usize, channels: &[usize]) -> Vec<u8> {
    let mut rgba = Vec::with_capacity(level.len() / (bytes * channels.len()) * 4);
    for texel in level.chunks_exact(bytes * channels.len()) {
        let mut shown = [0, 0, 0, 255];
        for (stored, &channel) in texel.chunks_exact(bytes).zip(channels) {
            shown[channel] = match *stored {
                // Rounded as 8 bits of 16 are elsewhere: 65535 / 257 is 255.
                [low, high] => ((u32::from(u16::from_le_bytes([low, high])) + 128) / 257) as u8,
                _ => stored[0],
            };
        }
        rgba.extend(shown);
    }
    rgba
}

/// The value of `KTXswizzle` among the key-value pairs; `None` without it or if it changes nothing.
fn swizzle(mut pairs: &[u8]) -> Option<[u8; 4]> {
    while let Some((length, rest)) = pairs.split_first_chunk::<4>() {
        let length = u32::from_le_bytes(*length) as usize;
        let pair = rest.get(..length)?;
        if let Some(value) = pair.strip_prefix(b"KTXswizzle\0") {
            let value = *value.first_chunk::<4>()?;
            return (value != *b"rgba").then_some(value);
        }
        pairs = rest.get(length.next_multiple_of(4)..)?;
    }
    None
}
