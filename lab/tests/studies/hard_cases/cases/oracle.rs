//! The expected view, by the f64 ray tracer, and the comparison of a frame with it.

use argus_scene::reference::Tracer;
use argus_scene::tone::display_from_radiance;
use argus_scene::{Camera, Frame, Output};
use glam::{DVec2, DVec3};
use image::{Rgb, RgbImage};
use rayon::prelude::*;

/// Largest relative range difference of a right surface.
pub(super) const RANGE: f64 = 0.03;
/// Largest difference of a colour channel, in steps of 255, of a right position on the surface.
pub(super) const COLOR: u8 = 24;

/// Range and colour of every pixel's central ray.
pub(super) struct Truth {
    size: [u32; 2],
    range: Vec<f64>,
    color: Vec<[u8; 3]>,
    /// The instance that each ray meets; `None` is the sky.
    instance: Vec<Option<u32>>,
}

/// A frame's errors.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Judged {
    /// Share of resolved pixels that match none of the nine rays around them.
    pub(super) wrong: f64,
    /// Share of pixels that no sample saw.
    pub(super) unresolved: f64,
    /// Pixels that contradict themselves: NaN, a range without a source, a source that the plan does not have.
    pub(super) malformed: usize,
}

impl Truth {
    pub(super) fn of(tracer: &Tracer, camera: &Camera, size: [u32; 2]) -> Self {
        let exposure = tracer.scene().lighting.exposure;
        let ray = |i: u32| {
            let at = DVec2::new(f64::from(i % size[0]), f64::from(i / size[0])) + 0.5;
            let direction = camera.direction(at, size[0], size[1]);
            let hit = tracer.trace(camera.eye, direction);
            let radiance = tracer.radiance_of(hit.as_ref(), direction, DVec3::ZERO, DVec3::ZERO);
            let range = hit.map_or(f64::INFINITY, |hit| hit.range);
            (range, (display_from_radiance(radiance, exposure), hit.map(|hit| hit.instance)))
        };
        let (range, (color, instance)) = (0..size[0] * size[1]).into_par_iter().map(ray).unzip();
        Self { size, range, color, instance }
    }

    /// Judges a frame. `colors`: whether a right surface with a wrong colour is wrong.
    pub(super) fn judge(&self, frame: &Frame, samples: usize, colors: bool) -> Judged {
        let image = |output| frame.images[output].as_ref().map(|bytes| bytes.as_ref()).unwrap_or_default();
        let (color, range) = (image(Output::Color), image(Output::Range));
        let (mask, source) = (image(Output::Mask), image(Output::Source));
        let pixels = self.range.len();
        if [color.len(), range.len(), mask.len(), source.len()] != [3 * pixels, 4 * pixels, pixels, pixels] {
            return Judged { malformed: pixels, ..Judged::default() };
        }
        let (mut wrong, mut unresolved, mut malformed) = (0, 0, 0);
        for i in 0..pixels {
            let got =
                f32::from_le_bytes([range[4 * i], range[4 * i + 1], range[4 * i + 2], range[4 * i + 3]]);
            let sky = got == f32::INFINITY;
            let known = usize::from(source[i]) <= samples && (mask[i] == 0 || mask[i] == 255);
            let consistent = if mask[i] == 255 { source[i] == 0 && sky } else { (source[i] == 0) == sky };
            // Written so that a NaN is malformed.
            malformed += usize::from(!(got > 0.0 && known && consistent));
            if mask[i] == 255 {
                unresolved += 1;
                continue;
            }
            let shown = colors.then(|| [color[3 * i], color[3 * i + 1], color[3 * i + 2]]);
            wrong += usize::from(!self.agrees(i, f64::from(got), shown));
        }
        let claimed = f64::from(u32::try_from(unresolved).unwrap_or(u32::MAX)) / pixels as f64;
        malformed += usize::from((claimed - frame.unresolved_fraction).abs() > 1e-6);
        Judged { wrong: wrong as f64 / pixels as f64, unresolved: claimed, malformed }
    }

    /// Whether a pixel matches its own ray or one of the eight around it: an edge may be off by a pixel. If several
    /// of them meet the same instance, any value between theirs matches: a grazing plane continues between two rays.
    fn agrees(&self, i: usize, range: f64, color: Option<[u8; 3]>) -> bool {
        let [width, height] = self.size.map(|n| n as usize);
        let (x, y) = (i % width, i / width);
        let side = |at: usize, side: usize| at.saturating_sub(1)..(at + 2).min(side);
        let around: Vec<usize> =
            side(y, height).flat_map(|v| side(x, width).map(move |u| v * width + u)).collect();
        around.iter().any(|&j| {
            let alike = || around.iter().copied().filter(|&k| self.instance[k] == self.instance[j]);
            let least = alike().map(|k| self.range[k]).fold(f64::INFINITY, f64::min);
            let most = alike().map(|k| self.range[k]).fold(0.0, f64::max);
            let surface = range >= least * (1.0 - RANGE) && range <= most * (1.0 + RANGE);
            let place = color.is_none_or(|color| {
                (0..3).all(|c| {
                    let least = alike().map(|k| self.color[k][c]).min().unwrap_or(255);
                    let most = alike().map(|k| self.color[k][c]).max().unwrap_or(0);
                    color[c] >= least.saturating_sub(COLOR) && color[c] <= most.saturating_add(COLOR)
                })
            });
            surface && place
        })
    }

    /// The oracle's image, the frame, and its wrong (white) and unresolved (grey) pixels, side by side.
    pub(super) fn picture(&self, frame: &Frame, colors: bool) -> RgbImage {
        let [width, height] = self.size;
        let image = |output| frame.images[output].as_ref().map(|bytes| bytes.as_ref()).unwrap_or_default();
        let (color, range, mask) = (image(Output::Color), image(Output::Range), image(Output::Mask));
        RgbImage::from_fn(3 * width, height, |x, y| {
            let i = (y * width + x % width) as usize;
            let shown = [color[3 * i], color[3 * i + 1], color[3 * i + 2]];
            let got =
                f32::from_le_bytes([range[4 * i], range[4 * i + 1], range[4 * i + 2], range[4 * i + 3]]);
            Rgb(match x / width {
                0 => self.color[i],
                1 => shown,
                _ if mask[i] != 0 => [90; 3],
                _ if !self.agrees(i, f64::from(got), colors.then_some(shown)) => [255; 3],
                _ => [0; 3],
            })
        })
    }
}
