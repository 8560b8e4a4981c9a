//! The surfaces of a tile's texels, as rays to lights see them.

use argus_scene::Bounds;
use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::pattern::{self, SLOTS, slot};
use crate::frame::{Footprint, Neighbours};
use crate::light_rays::LightRaysAbout;

/// A visible surface. Positions are metres about the eye.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct ShadingPoint {
    pub(crate) exists: bool,
    pub(crate) position: Vec3,
    /// Unit shading normal.
    pub(crate) normal: Vec3,
    /// Unit normal of the triangle, on the visible side.
    pub(crate) side: Vec3,
    /// Where rays begin.
    pub(crate) start: Vec3,
    /// Whether `start` is so high above the triangle that rays may go below its plane.
    pub(crate) is_lifted: bool,
    /// Mean side of the area that it stands for, metres; 0 if that is what a pixel shows from the eye.
    pub(crate) across: f32,
}

/// Which rays of the pattern a texel casts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Effort {
    /// Those of its slot: others complete them.
    Shared,
    /// So many to the sky, and to emitters.
    Whole { rays: usize },
}

/// The texels of a tile, row by row; or points of leaf sides, a leaf side in each row.
pub(super) struct ShadingPoints {
    /// Columns, rows.
    pub(super) size: [usize; 2],
    /// Coordinates of the first in its image; `None` if texels have no neighbours.
    pub(super) first: Option<[u32; 2]>,
    pub(super) effort: Effort,
    /// Numbers of leaf sides, by which they cast different rays: the same ones whatever other leaf sides there are. Empty for texels.
    pub(super) numbers: Vec<u32>,
    pub(super) all: Vec<ShadingPoint>,
    /// Box around those that exist, about the eye.
    pub(super) bounds: Bounds,
}

impl ShadingPoints {
    /// Reads a G-buffer: `shaders/shared/g_buffer.wgsl`.
    pub(super) fn new(
        surfaces: &[u8],
        materials: &[u8],
        size: [u32; 2],
        neighbours: Neighbours,
        about: &LightRaysAbout<'_>,
    ) -> Self {
        let words = |bytes: &[u8; 16]| bytemuck::pod_read_unaligned::<[u32; 4]>(bytes);
        let g_buffer = surfaces.as_chunks::<16>().0.par_iter().zip(materials.as_chunks::<16>().0);
        let offset = |position: Vec3| about.offset(position, position.length());
        let all: Vec<ShadingPoint> = g_buffer
            .map(|(surface, material)| of_g_buffer(words(surface), words(material), offset))
            .collect();
        let none = || [Vec3::INFINITY, Vec3::NEG_INFINITY];
        let [low, high] = all
            .par_iter()
            .filter(|texel| texel.exists)
            .fold(none, |[low, high], texel| [low.min(texel.position), high.max(texel.position)])
            .reduce(none, |[low, high], [other_low, other_high]| [low.min(other_low), high.max(other_high)]);
        let bounds = Bounds { min: low.as_dvec3(), max: high.as_dvec3() };
        let (first, effort) = match neighbours {
            Neighbours::Image(first) => (Some(first), Effort::Shared),
            Neighbours::None { rays } => (None, Effort::Whole { rays }),
        };
        Self { size: size.map(|n| n as usize), first, effort, numbers: Vec::new(), all, bounds }
    }

    /// Says what the texels stand for.
    pub(super) fn stand_for(&mut self, footprint: &Footprint) {
        match footprint {
            Footprint::Pixels => {}
            Footprint::Equal(side) => self.all.iter_mut().for_each(|point| point.across = *side),
            Footprint::Areas(sides) => {
                self.all.iter_mut().zip(sides).for_each(|(point, side)| point.across = *side);
            }
        }
    }

    /// Coordinates of a texel in its image; for texels without neighbours, their number.
    pub(super) fn place(&self, index: usize) -> [u32; 2] {
        let [width, _] = self.size;
        match self.first {
            Some([x, y]) => [x + (index % width) as u32, y + (index / width) as u32],
            None => [index as u32, 0],
        }
    }

    /// The slot of a texel. The points of a leaf side have slots that are evenly apart; points of a longer list have them as in
    /// an image, so that those in a row differ.
    pub(super) fn slot(&self, index: usize) -> usize {
        let [points, _] = self.size;
        match self.first {
            Some(_) => slot(self.place(index)),
            None if points > SLOTS => slot([(index % points) as u32, (index / points) as u32]),
            None => {
                let row = self.numbers.get(index / points).map_or(index / points, |number| *number as usize);
                (index % points * SLOTS / points + pattern::shuffled(row)) % SLOTS
            }
        }
    }

    /// Rays of a texel, where one of an image casts `of_image`.
    pub(super) fn rays(&self, of_image: usize) -> usize {
        match self.effort {
            Effort::Whole { rays } => rays,
            Effort::Shared => of_image,
        }
    }
}

impl ShadingPoint {
    /// The share of light that arrives along a ray, up to `most` times its direction.
    #[inline]
    pub(super) fn sees(&self, about: &LightRaysAbout<'_>, direction: Vec3, most: f32) -> f32 {
        match self.is_lifted || direction.dot(self.side) > 0.0 {
            true => about.passed(self.start, direction, most),
            false => 0.0,
        }
    }

    /// Whether another texel shows the same surface, so that the two see the same light.
    #[inline]
    pub(super) fn agrees(&self, other: &Self) -> bool {
        // A share of the range, and the cosine of 18°.
        const PLANE: f32 = 0.01;
        const FACING: f32 = 0.95;
        let off = self.side.dot(other.position - self.position).abs();
        other.exists && self.side.dot(other.side) > FACING && off < PLANE * self.position.length()
    }
}

/// The surface of a texel of the G-buffer. `offset` is how far off a surface rays begin, metres.
pub(crate) fn of_g_buffer(
    surface: [u32; 4],
    material: [u32; 4],
    offset: impl Fn(Vec3) -> f32,
) -> ShadingPoint {
    let position =
        Vec3::new(f32::from_bits(surface[0]), f32::from_bits(surface[1]), f32::from_bits(surface[2]));
    if position == Vec3::ZERO || !position.is_finite() {
        return ShadingPoint::default();
    }
    let normal = unit_from_octahedral(surface[3]);
    let side = unit_from_octahedral(material[1]);
    // The sign says whether a reflection probe is looked up.
    let lift = f32::from_bits(material[2] & 0x7fff_ffff);
    let off = offset(position);
    ShadingPoint {
        exists: true,
        position,
        normal,
        side,
        start: position + side * off.max(lift),
        is_lifted: lift > 4.0 * off,
        across: 0.0,
    }
}

/// As in `shaders/shared/encode.wgsl`.
fn unit_from_octahedral(word: u32) -> Vec3 {
    let half = |bits: u32| (f32::from(bits as u16 as i16) / 32767.0).max(-1.0);
    let e = Vec2::new(half(word), half(word >> 16));
    let mut v = Vec3::new(e.x, e.y, 1.0 - e.x.abs() - e.y.abs());
    if v.z < 0.0 {
        let folded =
            (Vec2::ONE - Vec2::new(e.y.abs(), e.x.abs())) * Vec2::new(1f32.copysign(e.x), 1f32.copysign(e.y));
        (v.x, v.y) = (folded.x, folded.y);
    }
    v.normalize_or(Vec3::Y)
}
