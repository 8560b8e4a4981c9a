//! Outputs: the images that a frame may hold, as one table.

use std::fmt;
use std::ops::{Index, IndexMut};

use bytes::Bytes;
use serde::{Deserialize, Serialize};

use crate::InvalidField;

/// One image a frame may hold.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Output {
    /// sRGB, 8 bits.
    Color,
    /// Distance from the eye, metres, +inf without a surface.
    Range,
    /// 255 where no sample saw the pixel's surface and it is guessed, 128 where no sample saw it and it was traced, else 0.
    Mask,
    /// Sample of the pixel: 1 + its position in the plan's list; 0 for none.
    Source,
    /// Confidence of the pixel: 0 where no sample saw it; else the low seven bits are 127 × (1 − residual). The
    /// residual is the difference between the searched depth and the sample's own, as a share of the tolerance. The
    /// highest bit is set where a second sample has the same surface.
    Confidence,
    /// Linear radiance, Rec. 709 primaries, without exposure. From samples it has 11 bits, as they have.
    Radiance,
    /// Distance from the eye along the camera's axis, metres, +inf without a surface.
    Depth,
    /// Unit normal in world space on the eye's side, interpolated between vertices and without normal map; zero without a surface.
    /// Like the ids, it is that of the triangles at the pixel's centre, also in views from samples.
    Normal,
    /// Index into the scene's instances; -1 without a surface.
    Instance,
    /// Index into the scene's materials; -1 without a surface.
    Material,
    /// From the pixel's centre to where a second camera shows the same point, pixels right and down; +inf where that is not in
    /// front of it. The scene stands still meanwhile.
    Flow,
}

/// The numbers of a pixel, little-endian.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Channel {
    /// A byte.
    U8,
    /// A 32-bit float.
    F32,
    /// A 32-bit integer.
    I32,
}

impl Channel {
    /// Bytes of a number.
    pub const fn bytes(self) -> usize {
        match self {
            Self::U8 => 1,
            Self::F32 | Self::I32 => 4,
        }
    }
}

/// A row of the table of outputs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct OutputFormat {
    /// Its name on the command line.
    pub name: &'static str,
    /// Numbers of a pixel, side by side.
    pub channels: usize,
    /// What each of them is.
    pub channel: Channel,
}

impl Output {
    /// All outputs, in the order of their numbers on the wire, from 1. A frame's images have this order.
    pub const ALL: [Self; 11] = [
        Self::Color,
        Self::Range,
        Self::Mask,
        Self::Source,
        Self::Confidence,
        Self::Radiance,
        Self::Depth,
        Self::Normal,
        Self::Instance,
        Self::Material,
        Self::Flow,
    ];

    /// The row of an output.
    pub const fn format(self) -> OutputFormat {
        let (name, channels, channel) = match self {
            Self::Color => ("color", 3, Channel::U8),
            Self::Range => ("range", 1, Channel::F32),
            Self::Mask => ("mask", 1, Channel::U8),
            Self::Source => ("source", 1, Channel::U8),
            Self::Confidence => ("confidence", 1, Channel::U8),
            Self::Radiance => ("radiance", 3, Channel::F32),
            Self::Depth => ("depth", 1, Channel::F32),
            Self::Normal => ("normal", 3, Channel::F32),
            Self::Instance => ("instance", 1, Channel::I32),
            Self::Material => ("material", 1, Channel::I32),
            Self::Flow => ("flow", 2, Channel::F32),
        };
        OutputFormat { name, channels, channel }
    }

    /// Its name on the command line.
    pub const fn name(self) -> &'static str {
        self.format().name
    }

    /// Bytes of a pixel.
    pub const fn pixel_bytes(self) -> usize {
        let format = self.format();
        format.channels * format.channel.bytes()
    }
}

/// A set of [`Output`]s.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(from = "Vec<Output>", into = "Vec<Output>")]
pub struct Outputs(u32);

impl Outputs {
    /// No output.
    pub const NONE: Self = Self(0);

    /// Only colour.
    pub const COLOR: Self = Self::only(Output::Color);

    /// What the light at surfaces decides.
    pub const SHADED: Self = Self::COLOR.with(Output::Radiance);

    /// What the triangles alone decide: that of the rays through the pixels' centres.
    pub const GEOMETRY: Self = Self::only(Output::Normal).with(Output::Instance).with(Output::Material);

    /// Only the given output.
    pub const fn only(output: Output) -> Self {
        Self(1 << output as u32)
    }

    /// The set with one more output.
    #[must_use]
    pub const fn with(self, output: Output) -> Self {
        self.union(Self::only(output))
    }

    /// The set without an output.
    #[must_use]
    pub const fn without(self, output: Output) -> Self {
        Self(self.0 & !(1 << output as u32))
    }

    /// The outputs of both sets.
    #[must_use]
    pub const fn union(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// Whether an output is in the set.
    pub const fn has(self, output: Output) -> bool {
        self.0 & 1 << output as u32 != 0
    }

    /// The outputs that are also in another set.
    #[must_use]
    pub const fn within(self, of: Self) -> Self {
        Self(self.0 & of.0)
    }

    /// The outputs that are not in another set.
    #[must_use]
    pub const fn outside(self, of: Self) -> Self {
        Self(self.0 & !of.0)
    }

    /// Whether the sets share an output.
    pub const fn has_any(self, of: Self) -> bool {
        self.0 & of.0 != 0
    }

    /// Its outputs, in the order of [`Output::ALL`].
    pub fn iter(self) -> impl Iterator<Item = Output> {
        Output::ALL.into_iter().filter(move |output| self.has(*output))
    }
}

impl FromIterator<Output> for Outputs {
    fn from_iter<I: IntoIterator<Item = Output>>(outputs: I) -> Self {
        outputs.into_iter().fold(Self::NONE, Self::with)
    }
}

impl From<Vec<Output>> for Outputs {
    fn from(outputs: Vec<Output>) -> Self {
        outputs.into_iter().collect()
    }
}

impl From<Outputs> for Vec<Output> {
    fn from(outputs: Outputs) -> Self {
        outputs.iter().collect()
    }
}

/// BLAKE3 of a frame's images, one after the other in the order of [`Output::ALL`], each as its format says.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct FrameDigest(pub [u8; 32]);

impl fmt::Display for FrameDigest {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.iter().try_for_each(|byte| write!(f, "{byte:02x}"))
    }
}

impl fmt::Debug for FrameDigest {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

impl From<FrameDigest> for String {
    fn from(digest: FrameDigest) -> Self {
        digest.to_string()
    }
}

impl TryFrom<String> for FrameDigest {
    type Error = InvalidField;

    fn try_from(text: String) -> Result<Self, InvalidField> {
        let wrong = || InvalidField::new("digest", format!("must be 64 hexadecimal digits, not {text:?}"));
        let hash = blake3::Hash::from_hex(&text).map_err(|_| wrong())?;
        Ok(Self(hash.into()))
    }
}

/// The images of a frame by output. An image is tightly packed, row 0 at the top, in the output's format.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Images([Option<Bytes>; Output::ALL.len()]);

impl Images {
    /// The images that are there, in the order of [`Output::ALL`].
    pub fn iter(&self) -> impl Iterator<Item = (Output, &Bytes)> {
        Output::ALL.into_iter().filter_map(|output| Some((output, self[output].as_ref()?)))
    }

    /// The images with another one of an output, or without it.
    #[must_use]
    pub fn with(mut self, output: Output, image: impl Into<Option<Bytes>>) -> Self {
        self[output] = image.into();
        self
    }

    /// Takes over the images that others have.
    pub fn take_over(&mut self, others: Self) {
        for (image, other) in self.0.iter_mut().zip(others.0) {
            *image = other.or(image.take());
        }
    }

    /// The digest of the images.
    pub fn digest(&self) -> FrameDigest {
        let mut hasher = blake3::Hasher::new();
        for (_, image) in self.iter() {
            hasher.update(image);
        }
        FrameDigest(hasher.finalize().into())
    }

    /// Drops the images that are not in a set.
    pub fn keep_only(&mut self, outputs: Outputs) {
        for output in Output::ALL.into_iter().filter(|&output| !outputs.has(output)) {
            self[output] = None;
        }
    }
}

impl Index<Output> for Images {
    type Output = Option<Bytes>;

    fn index(&self, output: Output) -> &Option<Bytes> {
        &self.0[output as usize]
    }
}

impl IndexMut<Output> for Images {
    fn index_mut(&mut self, output: Output) -> &mut Option<Bytes> {
        &mut self.0[output as usize]
    }
}

impl FromIterator<(Output, Bytes)> for Images {
    fn from_iter<I: IntoIterator<Item = (Output, Bytes)>>(images: I) -> Self {
        let mut all = Self::default();
        images.into_iter().for_each(|(output, bytes)| all[output] = Some(bytes));
        all
    }
}

impl<const N: usize> From<[(Output, Bytes); N]> for Images {
    fn from(images: [(Output, Bytes); N]) -> Self {
        images.into_iter().collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_output_has_a_row_of_its_own() {
        for (at, output) in Output::ALL.into_iter().enumerate() {
            assert_eq!(output as usize, at, "{output:?}");
            let same = Output::ALL.iter().filter(|other| other.name() == output.name());
            assert_eq!(same.count(), 1, "{output:?}");
        }
    }

    #[test]
    fn a_set_has_what_it_was_given_and_an_image_lies_under_its_output() {
        for output in Output::ALL {
            let only = Outputs::only(output);
            assert_eq!(only.iter().collect::<Vec<_>>(), [output]);
            assert_eq!(only.without(output), Outputs::NONE);
            assert!(only.has_any(only.with(Output::Color)) && !only.has_any(Outputs::NONE));
            let mut images = Images::from([(output, Bytes::from_static(b"x"))]);
            assert_eq!(images.iter().map(|(output, _)| output).collect::<Vec<_>>(), [output]);
            images.keep_only(Outputs::NONE);
            assert_eq!(images, Images::default());
        }
        let halves = [Outputs::SHADED, Outputs::GEOMETRY];
        assert_eq!(halves[0].union(halves[1]).outside(halves[1]), halves[0]);
        assert_eq!(halves[0].within(halves[1]), Outputs::NONE);
        let all: Outputs = Output::ALL.into_iter().collect();
        assert_eq!(Vec::from(all), Output::ALL);
        assert_eq!(Outputs::from(Vec::from(all)), all);
    }

    #[test]
    fn a_digest_is_that_of_the_images_in_order_and_survives_as_text() {
        let images = Images::from([
            (Output::Range, Bytes::from_static(b"second")),
            (Output::Color, Bytes::from_static(b"first")),
        ]);
        assert_eq!(images.digest(), FrameDigest(blake3::hash(b"firstsecond").into()));
        assert_eq!(FrameDigest::try_from(images.digest().to_string()), Ok(images.digest()));
        assert_eq!(FrameDigest::try_from("0f".to_owned()).unwrap_err().field, "digest");
        let mut both = images.clone();
        both.take_over(Images::from([(Output::Color, Bytes::from_static(b"third"))]));
        assert_eq!(both, images.with(Output::Color, Bytes::from_static(b"third")));
    }
}
