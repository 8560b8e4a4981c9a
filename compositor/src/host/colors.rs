//! Colours and confidence of a view's pixels, from the places of frames that a lookup found.

use super::lookup::{Fetches, SETTLED, fetch, neighbours, splat, splat3};
use super::source::Level;
use super::view::{CERTAIN, HostSource, Pixel, UNRESOLVED, View};

/// Factor by which the level of colours in sRGB is coarser: averages give dark texels less weight, so stripes alias more.
const COARSER: f32 = 1.08;

impl View<'_> {
    /// The pixel of a settled fetch; unresolved if the frame's texels are too coarse for it.
    #[inline(always)]
    pub(super) fn surface(&self, fetched: &Fetches, lane: usize, source: usize, d: [f32; 3]) -> Pixel {
        let color = self.color(source, fetched.place(lane), || fetched.level(lane));
        if !fetched.is_fine(self, lane) {
            return Pixel { color, source: UNRESOLVED, confidence: 0, range: 0.0 };
        }
        let range = match self.ranged {
            true => (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt() / fetched.q[lane].max(1e-30),
            false => 0.0,
        };
        let confidence = if self.confident { self.confidence(fetched, lane, source, d) } else { 0 };
        Pixel { color, source: source as u32 + 1, confidence, range }
    }

    /// A pixel of the sky whose colour a frame has.
    #[inline(always)]
    pub(super) fn sky_in(&self, fetched: &Fetches, lane: usize, source: usize) -> Pixel {
        let color = self.color(source, fetched.place(lane), || 0.0);
        Pixel { color, source: 0, confidence: CERTAIN >> 1, range: 0.0 }
    }

    /// An unresolved pixel. Its colour is a guess.
    pub(super) fn unresolved(&self, fetched: &Fetches, source: usize) -> Pixel {
        let color = self.bilinear(self.sources[source].frame.level(0), fetched.place(0));
        Pixel { color, source: UNRESOLVED, confidence: 0, range: 0.0 }
    }

    /// Confidence that a frame has the surface of a pixel.
    fn confidence(&self, fetched: &Fetches, lane: usize, source: usize, d: [f32; 3]) -> u32 {
        // 0 is reserved for pixels that no frame saw.
        let match_of_depth = ((127.0 * (1.0 - fetched.residual[lane]) + 0.5) as u32).max(1);
        let others = (0..self.sources.len()).filter(|other| *other != source);
        let seconded = others
            .map(|other| fetch(self, other, &splat3(d), &splat(fetched.q[lane])))
            .any(|other| other.agreement[0] >= SETTLED);
        match_of_depth | u32::from(seconded) << 7
    }

    /// The colour at a place of a frame, texels. `level` is that whose texels are as large as the pixel.
    #[inline(always)]
    fn color(&self, source: usize, place: [f32; 2], level: impl FnOnce() -> f32) -> [f32; 3] {
        let HostSource { frame, level: own, between, .. } = &self.sources[source];
        if !*between && *own == 0 && !self.linear {
            return self.bilinear(&frame.finest, place);
        }
        self.color_between(source, place, level())
    }

    /// The colour at a place of a frame where coarser levels count, or linear radiance.
    fn color_between(&self, source: usize, place: [f32; 2], level: f32) -> [f32; 3] {
        let HostSource { frame, level: own, between, .. } = &self.sources[source];
        let (finer, share) = match (self.linear, *between) {
            (true, _) => (level as usize, level.fract()),
            (false, true) => (*own, (level * COARSER - *own as f32).clamp(0.0, 1.0)),
            (false, false) => (*own, 0.0),
        };
        let at = |level: usize| {
            let level = frame.level(level);
            let [x, y] = [
                (place[0] + 0.5) * (level.width as f32 / frame.width as f32) - 0.5,
                (place[1] + 0.5) * (level.height as f32 / frame.height as f32) - 0.5,
            ];
            self.bilinear(level, [x, y])
        };
        let first = at(finer);
        if share == 0.0 {
            return first;
        }
        let second = at(finer + 1);
        std::array::from_fn(|i| first[i] + (second[i] - first[i]) * share)
    }

    /// A bilinear fetch.
    #[inline(always)]
    fn bilinear(&self, level: &Level, [x, y]: [f32; 2]) -> [f32; 3] {
        let (base_x, base_y) = (x.floor(), y.floor());
        let (fx, fy) = (x - base_x, y - base_y);
        let (left, right) = neighbours(base_x, level.width);
        let (top, bottom) = neighbours(base_y, level.height);
        let above = &level.texels[top * level.width..][..level.width];
        let below = &level.texels[bottom * level.width..][..level.width];
        let texels = [above[left], above[right], below[left], below[right]];
        let weights = [(1.0 - fx) * (1.0 - fy), fx * (1.0 - fy), (1.0 - fx) * fy, fx * fy];
        if self.linear {
            return self.linear_mean(texels, weights);
        }
        let mut sum = [0.0f32; 4];
        for k in 0..4 {
            let channels = texels[k].to_le_bytes();
            for i in 0..4 {
                sum[i] += weights[k] * f32::from(channels[i]);
            }
        }
        [sum[0], sum[1], sum[2]]
    }

    /// The mean linear radiance of texels.
    fn linear_mean(&self, texels: [u32; 4], weights: [f32; 4]) -> [f32; 3] {
        let mut sum = [0.0; 3];
        for (texel, weight) in texels.into_iter().zip(weights) {
            let channels = texel.to_le_bytes();
            sum.iter_mut()
                .zip(channels)
                .for_each(|(sum, channel)| *sum += weight * self.radiance[usize::from(channel)]);
        }
        sum
    }
}
