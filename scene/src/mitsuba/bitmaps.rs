//! Textures as linear bitmaps. Mitsuba cannot multiply textures, so factors are multiplied into them.

use std::collections::BTreeSet;
use std::io;
use std::path::{Path, PathBuf};

use glam::{DMat4, DVec4, Vec2, Vec3, Vec4};
use image::{ImageBuffer, Luma, Rgb};

use super::xml::{Xml, numbers};
use crate::material::{self, Wrap};
use crate::texture::{MipChain, mip_chains, transform_duv, transform_uv};
use crate::tone::linear_from_srgb;
use crate::{Scene, TextureRef};

/// Texels of a cut-out's opacity along one texel of its texture: alpha is interpolated first and compared after that, and
/// a bitmap of zeros and ones cannot express that at its own resolution.
const CUTOUT_DETAIL: u32 = 4;

/// The textures of a scene, and the folder for their bitmaps.
pub(super) struct Bitmaps {
    folder: PathBuf,
    chains: Vec<MipChain>,
    /// Names of the files written so far.
    pub(super) written: BTreeSet<String>,
    /// What cannot be exported exactly.
    pub(super) differences: BTreeSet<String>,
}

/// How a bitmap is looked up.
#[derive(Clone, Copy)]
pub(super) enum Filter {
    Bilinear,
    Nearest,
}

impl Bitmaps {
    pub(super) fn new(scene: &Scene, folder: &Path) -> Self {
        Self {
            folder: folder.to_owned(),
            chains: mip_chains(scene),
            written: BTreeSet::new(),
            differences: BTreeSet::new(),
        }
    }

    /// Writes the texture's colour times `factor` as a 16-bit PNG of linear values, and an element that names it.
    pub(super) fn color(
        &mut self,
        xml: &mut Xml,
        [parameter, file]: [&str; 2],
        reference: TextureRef,
        factor: Vec3,
    ) -> io::Result<()> {
        self.vector(xml, [parameter, file], reference, |texel| texel * factor.extend(1.0))
    }

    /// Writes three numbers from 0 to 1 as a 16-bit PNG, and an element that names it.
    pub(super) fn vector(
        &mut self,
        xml: &mut Xml,
        [parameter, file]: [&str; 2],
        reference: TextureRef,
        value: impl Fn(Vec4) -> Vec4,
    ) -> io::Result<()> {
        let encode = |texel: Vec4| Rgb(value(texel).truncate().to_array().map(unit16));
        self.bake(xml, [parameter, &format!("{file}.png")], reference, encode)
    }

    /// Writes a combination of the texture's channels as a grey 16-bit PNG of linear values, and an element that names it.
    pub(super) fn number(
        &mut self,
        xml: &mut Xml,
        [parameter, file]: [&str; 2],
        reference: TextureRef,
        value: impl Fn(Vec4) -> f32,
    ) -> io::Result<()> {
        self.bake(xml, [parameter, &format!("{file}.png")], reference, |texel| Luma([unit16(value(texel))]))
    }

    /// Writes emitted radiance, which may exceed 1, as OpenEXR, and an element that names it.
    pub(super) fn radiance(
        &mut self,
        xml: &mut Xml,
        [parameter, file]: [&str; 2],
        reference: TextureRef,
        factor: Vec3,
    ) -> io::Result<()> {
        let encode = |texel: Vec4| Rgb((texel.truncate() * factor).to_array());
        self.bake(xml, [parameter, &format!("{file}.exr")], reference, encode)
    }

    /// Writes 1 where alpha · `factor` reaches `cutoff` and 0 elsewhere, finer than the texture, and an element that names it.
    pub(super) fn cutout(
        &mut self,
        xml: &mut Xml,
        file: &str,
        reference: TextureRef,
        [factor, cutoff]: [f32; 2],
    ) -> io::Result<()> {
        let file = format!("{file}.png");
        let chain = self.chain(reference)?;
        let [width, height] = [chain.levels[0].width, chain.levels[0].height].map(|n| n * CUTOUT_DETAIL);
        let size = Vec2::new(width as f32, height as f32);
        let exists = |x: u32, y: u32| {
            let uv = Vec2::new(x as f32 + 0.5, y as f32 + 0.5) / size;
            Luma([if chain.alpha(uv) * factor >= cutoff { 255u8 } else { 0 }])
        };
        let bitmap = ImageBuffer::from_fn(width, height, exists);
        bitmap.save(self.folder.join(&file)).map_err(io::Error::other)?;
        self.element(xml, ["opacity", &file], reference, Filter::Nearest);
        Ok(())
    }

    fn bake<P>(
        &mut self,
        xml: &mut Xml,
        [parameter, file]: [&str; 2],
        reference: TextureRef,
        encode: impl Fn(Vec4) -> P,
    ) -> io::Result<()>
    where
        P: image::Pixel + image::PixelWithColorType,
        [P::Subpixel]: image::EncodableLayout,
    {
        let chain = self.chain(reference)?;
        let level = &chain.levels[0];
        let color = |byte: u8| {
            let value = f32::from(byte) / 255.0;
            if chain.srgb { linear_from_srgb(value) } else { value }
        };
        let table: Vec<f32> = (0..=255).map(color).collect();
        let (texels, _) = level.rgba.as_chunks::<4>();
        let texel = |x: u32, y: u32| {
            let [r, g, b, a] = texels[y as usize * level.width as usize + x as usize];
            let [r, g, b] = [r, g, b].map(|byte| table[usize::from(byte)]);
            encode(Vec4::new(r, g, b, f32::from(a) / 255.0))
        };
        let bitmap = ImageBuffer::from_fn(level.width, level.height, texel);
        bitmap.save(self.folder.join(file)).map_err(io::Error::other)?;
        let filter = match chain.filter {
            material::Filter::Linear => Filter::Bilinear,
            material::Filter::Nearest => Filter::Nearest,
        };
        self.element(xml, [parameter, file], reference, filter);
        Ok(())
    }

    fn chain(&self, reference: TextureRef) -> io::Result<&MipChain> {
        let missing = || io::Error::other(format!("the scene has no texture {}", reference.texture));
        self.chains.get(reference.texture as usize).ok_or_else(missing)
    }

    fn element(
        &mut self,
        xml: &mut Xml,
        [parameter, file]: [&str; 2],
        reference: TextureRef,
        filter: Filter,
    ) {
        self.written.insert(file.to_owned());
        xml.open("texture", &[("type", "bitmap"), ("name", parameter)]);
        xml.value("string", "filename", file);
        xml.value("boolean", "raw", "true");
        xml.value(
            "string",
            "filter_type",
            match filter {
                Filter::Bilinear => "bilinear",
                Filter::Nearest => "nearest",
            },
        );
        let wrap = self.chains[reference.texture as usize].wrap;
        if wrap[0] != wrap[1] {
            self.differences.insert(format!("{file}: v is wrapped like u"));
        }
        if reference.uv_set != 0 {
            self.differences
                .insert(format!("{file}: placed by the first texture coordinates, not the second"));
        }
        let mode = match wrap[0] {
            Wrap::Repeat => "repeat",
            Wrap::Clamp => "clamp",
            Wrap::Mirror => "mirror",
        };
        xml.value("string", "wrap_mode", mode);
        if reference != (TextureRef { uv_set: reference.uv_set, ..TextureRef::new(reference.texture) }) {
            xml.open("transform", &[("name", "to_uv")]);
            xml.leaf("matrix", &[("value", &numbers(texture_from_uv(&reference)))]);
            xml.close();
        }
        xml.close();
    }
}

/// Rows of the matrix from a mesh's texture coordinates to the texture's. Mitsuba reads a transform of the plane from one of
/// space: the offset stands in the last column.
fn texture_from_uv(reference: &TextureRef) -> [f64; 16] {
    let (x, y) = (transform_duv(reference, Vec2::X).as_dvec2(), transform_duv(reference, Vec2::Y).as_dvec2());
    let offset = transform_uv(reference, Vec2::ZERO).as_dvec2();
    DMat4::from_cols(
        x.extend(0.0).extend(0.0),
        y.extend(0.0).extend(0.0),
        DVec4::Z,
        offset.extend(0.0).extend(1.0),
    )
    .transpose()
    .to_cols_array()
}

/// 0..1 as 16 bits.
fn unit16(value: f32) -> u16 {
    (value.clamp(0.0, 1.0) * 65535.0 + 0.5) as u16
}
