//! A view that is computed on the processor: its inputs, its pixels and the rows that they are stored in.

use argus_scene::{Lighting, Outputs};
use argus_shaders::layout::compositor::{Fill, ViewSample, ViewUniform};
use glam::Vec3;

use super::source::{HostFrame, encoded};
use crate::draw_batch::SplatCall;

/// Source of a pixel that no frame saw.
pub(super) const UNRESOLVED: u32 = 255;
/// Added to the source of a pixel whose colour and depth come from different frames.
pub(super) const OTHER_SAMPLE: u32 = 64;
/// Confidence without residual and with a second frame in agreement.
pub(super) const CERTAIN: u32 = 255;

/// A frame, and how a view reads it.
#[derive(Debug)]
pub(crate) struct HostSource<'a> {
    pub(crate) sample: ViewSample,
    pub(crate) frame: &'a HostFrame,
    /// Texels along the edge of a pixel, at equal distance from both cameras.
    pub(crate) footprint: f32,
    /// Coarsest level whose texels are no larger than most pixels.
    pub(crate) level: usize,
    /// Whether colours are interpolated between that level and the next coarser one.
    pub(crate) between: bool,
}

/// What a view is computed from.
#[derive(Debug)]
pub(crate) struct HostInputs<'a> {
    /// The whole view as one piece whose target is its own image.
    pub(crate) view: ViewUniform,
    pub(crate) sources: Vec<HostSource<'a>>,
    pub(crate) splats: Vec<SplatCall>,
    pub(crate) blocks: Vec<u32>,
    pub(crate) fill: Fill,
    pub(crate) lighting: &'a Lighting,
    /// Sub-pixels along the edge of a pixel.
    pub(crate) side: u32,
    /// Whether sub-pixels are linear radiance, which is averaged.
    pub(crate) linear: bool,
    pub(crate) outputs: Outputs,
}

/// A view while its pixels are computed.
pub(super) struct View<'a> {
    pub(super) of: &'a ViewUniform,
    pub(super) sources: &'a [HostSource<'a>],
    /// Columns of cells.
    pub(super) columns: usize,
    pub(super) linear: bool,
    pub(super) confident: bool,
    /// Whether range is asked for.
    pub(super) ranged: bool,
    pub(super) lighting: &'a Lighting,
    /// Linear radiance of each value of a channel.
    pub(super) radiance: [f32; 256],
}

/// A pixel or sub-pixel.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pixel {
    /// sRGB 0 to 255, or linear radiance.
    pub(super) color: [f32; 3],
    /// 1 + position in the plan's list; 0 for sky.
    pub(super) source: u32,
    pub(super) confidence: u32,
    /// Metres; 0 without a surface.
    pub(super) range: f32,
}

impl View<'_> {
    /// Direction of a position in the view, at depth 1.
    #[inline(always)]
    pub(super) fn direction_of(&self, [x, y]: [f32; 2]) -> [f32; 3] {
        let ViewUniform { corner, right, down, .. } = self.of;
        [
            corner[0] + right[0] * x + down[0] * y,
            corner[1] + right[1] * x + down[1] * y,
            corner[2] + right[2] * x + down[2] * y,
        ]
    }

    /// A pixel of the sky.
    pub(super) fn sky(&self, d: [f32; 3]) -> Pixel {
        let d = Vec3::from(d).normalize_or_zero();
        let sky = &self.lighting.sky;
        let radiance = match &sky.map {
            Some(map) => map.radiance(d),
            None if d.y >= 0.0 => sky.horizon.lerp(sky.zenith, d.y.min(1.0)),
            None => sky.horizon.lerp(sky.ground, (-4.0 * d.y).min(1.0)),
        };
        let color = match self.linear {
            true => radiance.to_array(),
            false => radiance.to_array().map(|channel| encoded(channel * self.of.lighting.exposure) * 255.0),
        };
        Pixel { color, source: 0, confidence: CERTAIN, range: 0.0 }
    }

    /// A pixel whose ray the frames see past: some frame sees past each of its points, two may not.
    pub(super) fn seen_sky(&self, d: [f32; 3]) -> Pixel {
        Pixel { confidence: CERTAIN >> 1, ..self.sky(d) }
    }
}

/// Some rows of the images.
pub(super) struct Rows<'a> {
    pub(super) srgb: &'a mut [u32],
    pub(super) linear: &'a mut [[f32; 3]],
    pub(super) range: &'a mut [f32],
    pub(super) confidence: &'a mut [u32],
}

impl Rows<'_> {
    /// Stores a pixel. Images that no output needs are empty.
    #[inline(always)]
    pub(super) fn store(&mut self, at: usize, pixel: &Pixel) {
        let Pixel { color, source, confidence, range } = *pixel;
        let [r, g, b] = color;
        if let Some(linear) = self.linear.get_mut(at) {
            *linear = [r.clamp(0.0, 65504.0), g.clamp(0.0, 65504.0), b.clamp(0.0, 65504.0)];
            self.srgb[at] = source << 24;
        } else {
            let (r, g, b) = ((r + 0.5) as u32, (g + 0.5) as u32, (b + 0.5) as u32);
            self.srgb[at] = r | g << 8 | b << 16 | source << 24;
        }
        if let Some(stored) = self.range.get_mut(at) {
            *stored = range;
        }
        if let Some(stored) = self.confidence.get_mut(at) {
            *stored = confidence;
        }
    }
}
