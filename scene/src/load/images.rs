//! Decodes image files into textures, in parallel. A bad one costs its texture and a warning.

mod decode;
mod ktx2;
mod size;

use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

use bytes::Bytes;
use rayon::prelude::*;

use super::parts::Warnings;
use crate::material::{Filter, TextureUse, Wrap};
use crate::{Material, Texture, TextureRef};
use decode::ImageFile;
pub(super) use decode::Pixels;
pub(super) use size::Size;

/// Limit in bytes of a scene's decoded textures; further ones are dropped.
const MOST_DECODED: u64 = 8 << 30;
/// Bytes that the textures of any scene may take, and how many more for a byte of their files. Photographs have 16 to 30.
/// Images that hold nothing have a thousand: without this bound a JPEG of 3 MB took 2 GiB.
const MOST_ANYWAY: u64 = 384 << 20;
const MOST_EACH: u64 = 64;
/// Limit in bytes of what a scene's images take beyond the ratio to their files that every image may have.
const MOST_EXCESS: u64 = 256 << 20;

/// The images and textures of a scene under construction.
#[derive(Default)]
pub(super) struct Textures {
    images: Vec<(String, Bytes)>,
    /// Why images without bytes cannot be had.
    lost: HashMap<usize, String>,
    /// The number of each image by its name, and the place and number of its bytes.
    numbers: HashMap<(String, usize, usize), usize>,
    wanted: Vec<Wanted>,
    known: HashMap<Wanted, u32>,
}

/// How a texture reads an image.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) struct Wanted {
    /// Number of the image.
    pub(super) image: usize,
    /// Whether colours are sRGB-encoded.
    pub(super) srgb: bool,
    pub(super) wrap: [Wrap; 2],
    pub(super) filter: Filter,
    pub(super) channels: Channels,
}

/// What a texture makes of an image's channels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) enum Channels {
    /// The same.
    Same,
    /// Green is roughness: 1 − alpha times this share of 255.
    RoughnessOfGloss(u8),
}

impl Channels {
    fn of(self, rgba: &Arc<[u8]>) -> Arc<[u8]> {
        let Self::RoughnessOfGloss(share) = self else { return Arc::clone(rgba) };
        let rough = |[_, _, _, a]: &[u8; 4]| {
            let gloss = (u32::from(*a) * u32::from(share) + 127) / 255;
            [0, 255 - gloss as u8, 0, 255]
        };
        rgba.as_chunks::<4>().0.iter().flat_map(rough).collect()
    }
}

impl Textures {
    /// Adds an image file under a name for messages; returns its number. A file that many materials name is one image, so
    /// that it is decoded, filtered and held once.
    pub(super) fn add_image(&mut self, name: String, bytes: Bytes) -> usize {
        let same_file = (name.clone(), bytes.as_ptr() as usize, bytes.len());
        self.add((name, bytes), same_file)
    }

    /// Adds an image that cannot be had, for a reason. Materials lose its textures, as those of an image that cannot be
    /// decoded.
    pub(super) fn add_lost_image(&mut self, name: String, reason: String) -> usize {
        let same_file = (name.clone(), 0, 0);
        let image = self.add((name, Bytes::new()), same_file);
        self.lost.insert(image, reason);
        image
    }

    fn add(&mut self, image: (String, Bytes), same_file: (String, usize, usize)) -> usize {
        *self.numbers.entry(same_file).or_insert_with(|| {
            self.images.push(image);
            self.images.len() - 1
        })
    }

    /// The texture that reads an image so.
    pub(super) fn texture(&mut self, wanted: Wanted) -> u32 {
        *self.known.entry(wanted).or_insert_with(|| {
            self.wanted.push(wanted);
            self.wanted.len() as u32 - 1
        })
    }

    /// Decodes the used images and assigns textures to the materials. They lose those that cannot be decoded.
    pub(super) fn decode(self, materials: &mut [Material], warnings: &mut Warnings) -> Vec<Texture> {
        let mut used = vec![false; self.images.len()];
        self.wanted.iter().for_each(|wanted| used[wanted.image] = !self.lost.contains_key(&wanted.image));
        let mut decoded = decode_used(&self.images, &used);
        for (image, reason) in &self.lost {
            decoded[*image] = Some(Err(reason.clone()));
        }
        for (image, ((name, _), result)) in self.images.iter().zip(&decoded).enumerate() {
            if let Some(Err(reason)) = result {
                let lost = |texture: TextureRef| self.wanted[texture.texture as usize].image == image;
                warnings.add(format!("texture {name}: {reason}: {}", shown_without(materials, lost)));
            }
        }
        let mut textures = Vec::new();
        let new_index: Vec<Option<u32>> = self
            .wanted
            .iter()
            .map(|&Wanted { image, srgb, wrap, filter, channels }| {
                let pixels = decoded[image].as_ref()?.as_ref().ok()?;
                textures.push(Texture {
                    name: self.images[image].0.clone(),
                    width: pixels.size.width,
                    height: pixels.size.height,
                    rgba: channels.of(&pixels.rgba),
                    srgb,
                    wrap,
                    filter,
                });
                Some(textures.len() as u32 - 1)
            })
            .collect();
        for material in materials {
            for of in TextureUse::ALL {
                let Some(reference) = material.texture_mut(of) else { continue };
                match new_index[reference.texture as usize] {
                    Some(texture) => reference.texture = texture,
                    None => material.lose(of),
                }
            }
        }
        textures
    }
}

/// Decodes the used images. Sizes are added up before any memory is taken.
pub(super) fn decode_used(images: &[(String, Bytes)], used: &[bool]) -> Vec<Option<Result<Pixels, String>>> {
    let used_images = || images.iter().zip(used);
    let mut files: Vec<_> =
        used_images().map(|((name, bytes), used)| used.then(|| ImageFile::inspect(name, bytes))).collect();
    let most = most_decoded(
        used_images().filter(|(_, used)| **used).map(|((_, bytes), _)| bytes.len() as u64).sum(),
    );
    let (mut decoded, mut excess) = (0, 0);
    for file in &mut files {
        let Some(Ok(image)) = file else { continue };
        let with_it = (decoded + image.decoded(), excess + image.excess());
        if with_it.0 > most || with_it.1 > MOST_EXCESS {
            *file = Some(Err(
                "the scene's textures would take too much memory for files of their size".to_owned()
            ));
        } else {
            (decoded, excess) = with_it;
        }
    }
    files.into_par_iter().map(|file| Some(file?.and_then(|file| file.decode()))).collect()
}

/// Limit in bytes of the decoded textures of images whose files have so many bytes.
fn most_decoded(files: u64) -> u64 {
    files.saturating_mul(MOST_EACH).saturating_add(MOST_ANYWAY).min(MOST_DECODED)
}

/// How materials are shown without those of their textures for which `lost` holds.
fn shown_without(materials: &[Material], lost: impl Fn(TextureRef) -> bool) -> String {
    let mut shown: BTreeMap<Vec<TextureUse>, Vec<String>> = BTreeMap::new();
    for (index, material) in materials.iter().enumerate() {
        let uses = TextureUse::ALL.into_iter().filter(|&of| material.texture(of).is_some_and(&lost));
        let uses: Vec<TextureUse> = uses.collect();
        if !uses.is_empty() {
            shown.entry(uses).or_default().push(label(index, material));
        }
    }
    let ways = |uses: &[TextureUse]| uses.iter().map(|of| of.lost()).collect::<Vec<_>>().join(", ");
    let lines = shown.iter().map(|(uses, labels)| format!("{} shown {}", named(labels), ways(uses)));
    lines.collect::<Vec<_>>().join("; ")
}

/// A material's name in a warning.
pub(super) fn label(index: usize, material: &Material) -> String {
    if material.name.is_empty() { format!("number {index}") } else { format!("{:?}", material.name) }
}

/// Materials by their labels in a warning, three at most, with a verb.
pub(super) fn named(labels: &[String]) -> String {
    match labels {
        [] => String::new(),
        [one] => format!("material {one} is"),
        [one, two] => format!("materials {one} and {two} are"),
        [one, two, three] => format!("materials {one}, {two} and {three} are"),
        [one, two, three, more @ ..] => {
            format!("materials {one}, {two}, {three} and {} more are", more.len())
        }
    }
}

#[cfg(test)]
pub(super) mod tests {
    use std::io::Cursor;
    use std::sync::Arc;

    use image::ImageFormat;

    use super::*;

    fn decode(name: &str, bytes: &[u8]) -> Result<Pixels, String> {
        ImageFile::inspect(name, bytes)?.decode()
    }

    /// A PNG file of one colour.
    pub(in crate::load) fn png(width: u32, height: u32, rgba: [u8; 4]) -> Bytes {
        let image = image::RgbaImage::from_pixel(width, height, image::Rgba(rgba));
        let mut bytes = Vec::new();
        image.write_to(&mut Cursor::new(&mut bytes), ImageFormat::Png).unwrap();
        Bytes::from(bytes)
    }

    #[test]
    fn an_image_that_claims_more_than_its_file_can_hold_gets_no_memory() {
        let claimed = |side: u32, bits: u8| claim(&png(4, 4, [255; 4]), side, bits);
        for (side, bits) in [(0x3fff, 8), (4200, 8), (4000, 16)] {
            let reason = decode("x.png", &claimed(side, bits)).err().unwrap();
            assert!(reason.contains("cannot be held"), "{side}, {bits} bits: {reason}");
        }
        // What may be held is refused for what it lacks.
        let reason = decode("x.png", &claimed(4000, 8)).err().unwrap();
        assert!(!reason.contains("cannot be held"), "{reason}");
    }

    /// A PNG file whose header claims another size and depth, with a checksum that fits.
    fn claim(png: &[u8], side: u32, bits: u8) -> Vec<u8> {
        let mut bytes = png.to_vec();
        bytes[16..20].copy_from_slice(&side.to_be_bytes());
        bytes[20..24].copy_from_slice(&side.to_be_bytes());
        bytes[24] = bits;
        let mut crc = u32::MAX;
        for byte in &bytes[12..29] {
            crc ^= u32::from(*byte);
            for _ in 0..8 {
                crc = (crc >> 1) ^ (0xedb8_8320 & 0u32.wrapping_sub(crc & 1));
            }
        }
        bytes[29..33].copy_from_slice(&(!crc).to_be_bytes());
        bytes
    }

    #[test]
    fn a_few_large_even_images_are_shown_and_many_in_small_files_are_not() {
        // 64 MiB each.
        let even = ("even.png".to_owned(), png(4096, 4096, [9; 4]));
        assert!(even.1.len() < 1 << 19);
        let images = vec![even; 10];
        let decoded = decode_used(&images, &[true; 10]);
        let shown = decoded.iter().filter(|image| matches!(image, Some(Ok(_)))).count();
        assert_eq!(
            shown as u64,
            most_decoded(images.iter().map(|(_, bytes)| bytes.len() as u64).sum()) >> 26
        );
        assert!((6..10).contains(&shown), "{shown}");
        assert!(most_decoded(200 << 20) == MOST_DECODED, "large files are not bounded by it");
    }

    #[test]
    fn truncated_and_foreign_images_are_refused_with_a_reason() {
        let whole = png(64, 64, [1, 2, 3, 4]);
        assert!(decode("x", &whole).is_ok());
        for length in [0, 1, 8, 20, 33, whole.len() / 2] {
            decode("x.png", &whole[..length]).err().unwrap();
        }
        let avif = b"\0\0\0\x1cftypavif\0\0\0\0";
        assert!(decode("x.png", avif).err().unwrap().contains("Avif images are not supported"));
    }

    #[test]
    fn a_file_that_many_materials_name_is_one_image() {
        let (mut textures, bytes) = (Textures::default(), png(2, 2, [9; 4]));
        let mut add = |name: &str, bytes: &Bytes| textures.add_image(name.to_owned(), bytes.clone());
        let first = add("a.png", &bytes);
        assert_eq!(add("a.png", &bytes), first);
        assert_ne!(add("b.png", &png(2, 2, [8; 4])), first);
    }

    #[test]
    fn one_image_read_in_two_ways_is_two_textures_with_the_same_bytes() {
        let mut textures = Textures::default();
        let image = textures.add_image("a.png".to_owned(), png(2, 2, [9; 4]));
        let wanted = |image, srgb| Wanted {
            image,
            srgb,
            wrap: [Wrap::Repeat; 2],
            filter: Filter::Linear,
            channels: Channels::Same,
        };
        let (color, data) = (textures.texture(wanted(image, true)), textures.texture(wanted(image, false)));
        assert_eq!(color, textures.texture(wanted(image, true)));
        let bad = textures.add_image("b.png".to_owned(), Bytes::from_static(b"nonsense"));
        let broken = textures.texture(wanted(bad, true));
        let mut materials = [Material {
            base_color_texture: Some(TextureRef::new(color)),
            metallic_roughness_texture: Some(TextureRef::new(data)),
            emissive_texture: Some(TextureRef::new(broken)),
            emissive: glam::Vec3::ONE,
            ..Material::default()
        }];
        let mut warnings = Warnings::default();
        let decoded = textures.decode(&mut materials, &mut warnings);
        assert_eq!(decoded.len(), 2);
        assert!(Arc::ptr_eq(&decoded[0].rgba, &decoded[1].rgba));
        assert_eq!((materials[0].emissive_texture, materials[0].emissive), (None, glam::Vec3::ZERO));
        let lines = warnings.into_lines();
        assert_eq!(lines.len(), 1);
        assert!(lines[0].ends_with("material number 0 is shown without glow"), "{lines:?}");
    }
}
