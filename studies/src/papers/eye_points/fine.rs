//! The paper's reference: multi-view rendering at a multiple of the resolution. It has the error of looking up a map that is
//! seen from the reflector's middle, as all ways with maps have.

use argus_eye_points::{STEPS, reflect};
use argus_sampler::plug::taps;
use glam::Vec3;
use image::RgbImage;

use super::ways::Ways;

/// Most texels of all maps, 8 bytes each.
const MOST_TEXELS: usize = 1 << 26;
/// Multiples of the maps' sides, the largest that fits first. The paper's is 4.
const MULTIPLES: [u32; 3] = [4, 2, 1];
/// Taps of a pixel for each of the usual.
const TAPS: u32 = 4;

impl Ways<'_> {
    /// What multi-view rendering shows at four times the maps' sides, or as many as memory allows, and four times the taps.
    pub(super) fn fine_multi_view(&self) -> RgbImage {
        let mut reflectors = self.seen.reflectors.clone();
        let texels: usize = reflectors.iter().map(|reflector| 6 * (reflector.side as usize).pow(2)).sum();
        let fits = |multiple: &u32| texels * (*multiple as usize).pow(2) <= MOST_TEXELS;
        let multiple = MULTIPLES.into_iter().find(fits).unwrap_or(1);
        reflectors.iter_mut().for_each(|reflector| reflector.side *= multiple);
        let maps = self.points.rasterise(&reflectors);
        let taps = taps(TAPS * self.taps.len() as u32);
        let lookups = argus_eye_points::Lookups { taps: &taps, ..self.lookups(&maps, &reflectors, STEPS) };
        let shade = |texel: u32| {
            let at = self.points.shading_of_texel(&maps, &reflectors, texel as usize);
            at.map_or(Vec3::ZERO, |at| self.stage.shade(&at))
        };
        let lighting = &self.stage.scene.lighting;
        let reflected = reflect(&lookups, &lighting.sky, maps.texels(), |texel, _| texel as u32, shade);
        self.seen.image(&reflected.radiance, lighting.exposure)
    }
}
