//! Shades lists of points on surfaces, without what depends on the viewer: for reflection probes, and for what direct views
//! reflect.

use std::sync::Arc;
use std::time::Instant;

use argus_gpu::{Gpu, wgpu};
use argus_scene::{Cancel, RenderError, Stage};
use argus_shaders::layout::sampler::{LEAF_BLOCK, LeafChunk, ProbePoint};
use bytemuck::Zeroable;
use glam::Vec3;

use crate::eye::Eye;
use crate::indirect::{IndirectLight, LightSharing};
use crate::light::DirectLight;
use crate::lit_octree::{CHUNK_SIDE, image_of};
use crate::passes::{ShadePoints, TileContext};
use crate::resident::{Resident, upload};
use crate::sampler::{add_light, check_wanted};
use crate::scratch::{Extras, Scratch};
use crate::tile::Tile;
use crate::timing;

/// What shades points. Their positions are relative to the eye.
pub(crate) struct PointShading<'a> {
    pub(crate) gpu: &'a Arc<Gpu>,
    pub(crate) resident: &'a Resident,
    pub(crate) eye: &'a Eye,
    pub(crate) lights: (&'a Option<DirectLight>, &'a mut Option<IndirectLight>),
    /// How light is found: of probes once, of views each time.
    pub(crate) sharing: LightSharing,
    pub(crate) programs: &'a ShadePoints,
    pub(crate) scratch: &'a mut Scratch,
    pub(crate) cancel: &'a Cancel,
}

/// Points that are shaded in one submission.
struct PointChunk {
    /// The image that they are shaded in, as a tile.
    tile: Tile,
    /// Uniform.
    chunk: wgpu::Buffer,
}

impl PointShading<'_> {
    /// Radiance of points: a word of rgb9e5 each, on the device.
    ///
    /// # Errors
    /// [`RenderError::Cancelled`], or the errors of the device.
    pub(crate) fn shade_to_device(
        &mut self,
        points: &[ProbePoint],
        stages: &mut Vec<Stage>,
    ) -> Result<wgpu::Buffer, RenderError> {
        let begin = Instant::now();
        let gpu = self.gpu;
        let count = points.len() as u32;
        let storage = wgpu::BufferUsages::STORAGE;
        let radiance = gpu.buffer(
            "radiance of points",
            u64::from(count.max(1)) * 4,
            storage | wgpu::BufferUsages::COPY_SRC,
        );
        let none = [ProbePoint::zeroed()];
        let points = upload(gpu, "points", if points.is_empty() { &none } else { points }, storage)?;
        let (direct, indirect) = &mut self.lights;
        let guides = direct.is_some() || indirect.is_some();
        let extras = Extras { guides, ..Extras::default() };
        let mut of_light = Vec::new();
        for PointChunk { tile, chunk } in chunks(gpu, count) {
            check_wanted(self.cancel)?;
            let mut commands = gpu.commands("shade points");
            let context = TileContext::new(gpu, self.resident, self.eye, &tile, self.scratch, extras);
            self.programs.record(&mut commands, &context, (&chunk, &points));
            let lights = (*direct, &mut **indirect);
            let (mut commands, _) =
                add_light(lights, commands, &context, (self.sharing, false), &mut of_light)?;
            self.programs.keep(&mut commands, &context, (&chunk, &radiance));
            commands.submit().wait()?;
        }
        let lit: f64 = of_light.iter().map(|stage| stage.ms).sum();
        let all = begin.elapsed().as_secs_f64() * 1e3;
        timing::add(stages, vec![Stage::new("shade points", (all - lit).max(0.0))]);
        timing::add(stages, of_light);
        Ok(radiance)
    }

    /// Radiance of points.
    ///
    /// # Errors
    /// The errors of [`Self::shade_to_device`].
    pub(crate) fn shade(
        &mut self,
        points: &[ProbePoint],
        stages: &mut Vec<Stage>,
    ) -> Result<Vec<Vec3>, RenderError> {
        if points.is_empty() {
            return Ok(Vec::new());
        }
        let radiance = self.shade_to_device(points, stages)?;
        let mut commands = self.gpu.commands("read radiance of points");
        let pending = commands.read_buffer(&radiance, 0..radiance.size());
        let bytes = commands.submit().wait()?.take(pending);
        Ok(bytes.as_chunks::<4>().0.iter().map(|word| from_rgb9e5(u32::from_le_bytes(*word))).collect())
    }
}

/// Points in chunks. Consecutive points are neighbours in space, and in a square of the image.
fn chunks(gpu: &Gpu, count: u32) -> impl Iterator<Item = PointChunk> {
    let most = CHUNK_SIDE * CHUNK_SIDE;
    (0..count).step_by(most as usize).map(move |first| {
        let rows = most.min(count - first).div_ceil(CHUNK_SIDE);
        let size = [CHUNK_SIDE, rows.next_multiple_of(LEAF_BLOCK)];
        let params = LeafChunk { size, first, leaves: count, ..LeafChunk::zeroed() };
        let chunk = gpu.upload("points", &[params], wgpu::BufferUsages::UNIFORM);
        PointChunk { tile: image_of(size), chunk }
    })
}

/// Radiance of a word: nine bits a channel, and a common exponent of five bits.
fn from_rgb9e5(word: u32) -> Vec3 {
    let scale = 2f32.powi((word >> 27) as i32 - 24);
    Vec3::new((word & 511) as f32, (word >> 9 & 511) as f32, (word >> 18 & 511) as f32) * scale
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_of_radiance_are_those_of_the_format() {
        assert_eq!(from_rgb9e5(0), Vec3::ZERO);
        // 256 · 2^(16 − 24) = 1.
        assert_eq!(from_rgb9e5(16 << 27 | 256 << 18 | 256 << 9 | 256), Vec3::ONE);
        assert_eq!(from_rgb9e5(31 << 27 | 511), Vec3::X * 65408.0);
    }
}
