//! `shaders/shared/fetch.wgsl` and `shaders/shared/cells.wgsl`: the depth-corrected fetch, for eight points at once, and how cells
//! hold depths.

use super::source::HostFrame;
use super::view::View;

/// Pixels that are computed at once.
pub(super) const LANES: usize = 8;
/// A number of each pixel.
pub(super) type Lanes = [f32; LANES];

/// What the position of a sample in the plan's list takes off a depth: `HANDICAP` in the program.
const HANDICAP: u32 = 0x80000;
/// A filled cell that shows the sky: negative zero.
pub(super) const SKY: u32 = 0x8000_0000;
/// Relative difference of inverse depth up to which two neighbours belong to one surface.
pub(super) const CONTINUES: f32 = 0.1;
/// Share of agreeing bilinear weights from which a fetch is settled.
pub(super) const SETTLED: f32 = 0.5;
/// Share of them from which all four texels agree.
pub(super) const WHOLE: f32 = 0.999;
/// Texels between two points of a plane from which one is extrapolated to the other.
const MOST_APART: f32 = 2.0;
/// Steps of the fixed-point iteration that are taken at once.
const MOST_STEPS: f32 = 8.0;

/// A depth of a cell: inverse depth, 1/metres, 0 for none; a negative one is a guess. And its sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Depth {
    pub(super) q: f32,
    pub(super) source: u32,
}

/// The filled cell of a depth.
#[inline(always)]
pub(super) fn bits_of(depth: Depth) -> u32 {
    if depth.q != 0.0 { depth.q.to_bits() & !7 | depth.source } else { 0 }
}

/// The depth of a filled cell.
#[inline(always)]
pub(super) fn depth_of(bits: u32) -> Depth {
    Depth { q: f32::from_bits(bits & !7), source: bits & 7 }
}

/// The unfilled cell of a positive inverse depth.
#[inline(always)]
pub(super) fn cell_of(q: f32, source: u32) -> u32 {
    let handicap = source * HANDICAP;
    (q.to_bits().max(handicap + 8) - handicap) & !7 | source
}

/// The depth of an unfilled cell.
#[inline(always)]
pub(super) fn depth_of_cell(cell: u32) -> Depth {
    let source = cell & 7;
    let bits = (cell & !7).wrapping_add(source * HANDICAP);
    Depth { q: if cell >= 8 { f32::from_bits(bits) } else { 0.0 }, source }
}

/// The farther of two depths; none is ignored.
#[inline(always)]
pub(super) fn farther(a: Depth, b: Depth) -> Depth {
    let second = (a.q == 0.0) | ((b.q > 0.0) & (b.q < a.q));
    Depth { q: if second { b.q } else { a.q }, source: if second { b.source } else { a.source } }
}

/// Whether two positive inverse depths belong to one surface.
#[inline(always)]
pub(super) fn continues(a: f32, b: f32) -> bool {
    (a - b).abs() <= CONTINUES * a.min(b)
}

#[inline(always)]
pub(super) fn dot3(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline(always)]
pub(super) fn dot4(a: [f32; 4], b: [f32; 4]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]
}

#[inline(always)]
fn mix(a: f32, b: f32, t: f32) -> f32 {
    a * (1.0 - t) + b * t
}

/// Eight points of view rays looked up in one frame: `Fetch` in the program. Positions are in texels, from the centre of the
/// first one.
#[derive(Debug, Clone, Copy)]
pub(super) struct Fetches {
    /// Where a bilinear fetch reads only agreeing texels. Valid where all four agree: see [`Fetches::place`].
    x: Lanes,
    y: Lanes,
    /// First of the four texels, their inverse ranges, and shares of those that agree.
    base: [Lanes; 2],
    four: [Lanes; 4],
    weights: [Lanes; 4],
    /// Inverse depth, refined towards the frame's surface.
    pub(super) q: Lanes,
    pub(super) agreement: Lanes,
    /// Share of the bilinear weights whose texels lie beyond the point.
    pub(super) past: Lanes,
    /// Difference of range, as a share of the tolerance.
    pub(super) residual: Lanes,
    /// Pixels along the edge of a texel, both facing the surface.
    pixels: Lanes,
    pub(super) inside: [bool; LANES],
}

impl Fetches {
    /// Whether the frame's texels are fine enough for a pixel.
    #[inline(always)]
    pub(super) fn is_fine(&self, view: &View<'_>, lane: usize) -> bool {
        let most = if self.agreement[lane] > WHOLE { view.of.coarse } else { view.of.coarse_edge };
        self.pixels[lane] <= most
    }

    /// Level of colour whose texels are as large as the pixel.
    pub(super) fn level(&self, lane: usize) -> f32 {
        (0.707 / self.pixels[lane].max(1e-30)).max(1.0).log2()
    }

    /// Where to read a pixel's colour.
    #[inline(always)]
    pub(super) fn place(&self, lane: usize) -> [f32; 2] {
        if self.agreement[lane] > WHOLE {
            return [self.x[lane], self.y[lane]];
        }
        let [a, b, c, d] = &self.weights;
        let [p, q, r, s] = &self.four;
        let [x, y] = match self.agreement[lane] > 0.0 {
            true => agreeing_offset([a[lane], b[lane], c[lane], d[lane]], self.agreement[lane]),
            false => farthest_offset([p[lane], q[lane], r[lane], s[lane]]),
        };
        [self.base[0][lane] + x, self.base[1][lane] + y]
    }
}

/// Looks up, in frame `index`, the points at inverse depths `q` in directions `d`.
///
/// Loops over lanes hold plain arithmetic alone, which the compiler computes eight lanes at a time: it does not inline closures into
/// functions for wider vectors.
#[inline(always)]
pub(super) fn fetch(view: &View<'_>, index: usize, d: &[Lanes; 3], q: &Lanes) -> Fetches {
    let source = &view.sources[index];
    let (sample, frame) = (&source.sample, source.frame);
    let [ex, ey, ez] = sample.eye_from_center;
    let ([ux, uy, uz], [vx, vy, vz], [wx, wy, wz]) =
        (sample.u_from_world, sample.v_from_world, sample.w_from_world);
    let [fx, fy, fz] = view.of.forward;
    let (width, height) = (frame.width as f32, frame.height as f32);
    let [dx, dy, dz] = d;
    let [mut unit, mut expected, mut base_x, mut base_y, mut share_x, mut share_y] = [[0.0f32; LANES]; 6];
    let mut inside = [false; LANES];
    for i in 0..LANES {
        let (rx, ry, rz) = (dx[i] + ex * q[i], dy[i] + ey * q[i], dz[i] + ez * q[i]);
        let w = wx * rx + wy * ry + wz * rz;
        let by_w = 1.0 / w.max(1e-30);
        let (u, v) = ((ux * rx + uy * ry + uz * rz) * by_w, (vx * rx + vy * ry + vz * rz) * by_w);
        inside[i] = (w > 0.0) & (u >= 0.0) & (u <= 1.0) & (v >= 0.0) & (v <= 1.0);
        unit[i] = 1.0 / (rx * rx + ry * ry + rz * rz).max(1e-30).sqrt();
        expected[i] = q[i] * unit[i];
        let (x, y) = (u * width - 0.5, v * height - 0.5);
        base_x[i] = x.floor();
        base_y[i] = y.floor();
        share_x[i] = x - base_x[i];
        share_y[i] = y - base_y[i];
    }
    let base = [base_x, base_y];
    let four = gathered(frame, &base);
    let [s0, s1, s2, s3] = &four;
    let [mut w0, mut w1, mut w2, mut w3, mut mean] = [[0.0f32; LANES]; 5];
    let [mut agreement, mut past, mut residual, mut pixels] = [[0.0f32; LANES]; 4];
    let (most, footprint) = (view.of.tolerance, source.footprint);
    for i in 0..LANES {
        let (x, y) = (share_x[i], share_y[i]);
        let (a, b, c, e) = ((1.0 - x) * y, x * y, x * (1.0 - y), (1.0 - x) * (1.0 - y));
        let tolerance = most * expected[i];
        let least = expected[i] - tolerance;
        w0[i] = if (s0[i] - expected[i]).abs() <= tolerance { a } else { 0.0 };
        w1[i] = if (s1[i] - expected[i]).abs() <= tolerance { b } else { 0.0 };
        w2[i] = if (s2[i] - expected[i]).abs() <= tolerance { c } else { 0.0 };
        w3[i] = if (s3[i] - expected[i]).abs() <= tolerance { e } else { 0.0 };
        let sum = w0[i] + w1[i] + w2[i] + w3[i];
        let stored = w0[i] * s0[i] + w1[i] * s1[i] + w2[i] * s2[i] + w3[i] * s3[i];
        let beyond = if s0[i] < least { a } else { 0.0 }
            + if s1[i] < least { b } else { 0.0 }
            + if s2[i] < least { c } else { 0.0 }
            + if s3[i] < least { e } else { 0.0 };
        agreement[i] = if inside[i] { sum } else { 0.0 };
        past[i] = if inside[i] { beyond } else { 0.0 };
        residual[i] = ((stored / sum.max(1e-30) - expected[i]).abs() / tolerance.max(1e-30)).min(1.0);
        pixels[i] = q[i] / (footprint * expected[i]).max(1e-30);
        mean[i] = a * s0[i] + b * s1[i] + c * s2[i] + e * s3[i];
    }
    // Where all four texels agree, the depth is that at which the ray meets the plane through them.
    let [mut px, mut py, mut refined] = [[0.0f32; LANES]; 3];
    for i in 0..LANES {
        let (rx, ry, rz) = (dx[i] + ex * q[i], dy[i] + ey * q[i], dz[i] + ez * q[i]);
        let along = unit[i] / mean[i];
        let depth = fx * (rx * along - ex) + fy * (ry * along - ey) + fz * (rz * along - ez);
        let (least, most) = (0.9 * q[i], 1.1 * q[i]);
        let closer = (1.0 / depth.max(1e-30)).max(least).min(most);
        let (ax, ay, az) = (dx[i] + ex * closer, dy[i] + ey * closer, dz[i] + ez * closer);
        let by_w = 1.0 / (wx * ax + wy * ay + wz * az).max(1e-30);
        let gx = (ux * ax + uy * ay + uz * az) * by_w * width - 0.5 - base_x[i];
        let gy = (vx * ax + vy * ay + vz * az) * by_w * height - 0.5 - base_y[i];
        let there = (1.0 - gx) * gy * s0[i]
            + gx * gy * s1[i]
            + gx * (1.0 - gy) * s2[i]
            + (1.0 - gx) * (1.0 - gy) * s3[i];
        let first = mean[i] - expected[i];
        let second = there - closer / (ax * ax + ay * ay + az * az).max(1e-30).sqrt();
        let near = ((gx - share_x[i]).abs() < MOST_APART)
            & ((gy - share_y[i]).abs() < MOST_APART)
            & ((first - second).abs() > 1e-6 * expected[i]);
        let root = (first / (first - second)).max(0.0).min(MOST_STEPS);
        let steps = if near { root } else { 1.0 };
        px[i] = base_x[i] + mix(share_x[i], gx, steps);
        py[i] = base_y[i] + mix(share_y[i], gy, steps);
        let whole = mix(q[i], closer, steps).max(least).min(most);
        refined[i] = if agreement[i] > WHOLE { whole } else { q[i] };
    }
    let weights = [w0, w1, w2, w3];
    Fetches { x: px, y: py, base, four, weights, q: refined, agreement, past, residual, pixels, inside }
}

/// The inverse ranges of four texels, in the order of `textureGather`; beyond the image those of its border.
#[inline(always)]
fn gathered(frame: &HostFrame, base: &[Lanes; 2]) -> [Lanes; 4] {
    let mut four = [[0.0; LANES]; 4];
    let (width, height) = (frame.width, frame.height);
    for i in 0..LANES {
        let (left, right) = neighbours(base[0][i], width);
        let (top, bottom) = neighbours(base[1][i], height);
        let (above, below) =
            (&frame.inverse_range[top * width..][..width], &frame.inverse_range[bottom * width..][..width]);
        four[0][i] = below[left];
        four[1][i] = below[right];
        four[2][i] = above[right];
        four[3][i] = above[left];
    }
    four
}

/// A texel and the next one, within an image of `count`.
#[inline(always)]
pub(super) fn neighbours(base: f32, count: usize) -> (usize, usize) {
    // A position that is no number converts to 0.
    let at = base.max(-1.0).min(count as f32) as i32;
    let last = count as i32 - 1;
    (at.clamp(0, last) as usize, (at + 1).clamp(0, last) as usize)
}

/// Offset from the first of four texels at which a bilinear fetch reads only those with a weight: their weighted centre if they
/// form a row, a column or all four; otherwise the texel of greatest weight.
fn agreeing_offset(weights: [f32; 4], sum: f32) -> [f32; 2] {
    let by_sum = 1.0 / sum.max(1e-30);
    let (x, y) = ((weights[1] + weights[2]) * by_sum, (weights[0] + weights[1]) * by_sum);
    let implied = [(1.0 - x) * y, x * y, x * (1.0 - y), (1.0 - x) * (1.0 - y)];
    let leaked: f32 =
        implied.iter().zip(weights).filter(|(_, weight)| *weight == 0.0).map(|(implied, _)| implied).sum();
    if leaked < 1e-3 {
        return [x, y];
    }
    offset_of(weights, |a, b| a > b)
}

/// Offset of the texel of greatest range.
fn farthest_offset(four: [f32; 4]) -> [f32; 2] {
    offset_of(four, |a, b| a < b)
}

/// Offset of the best of four texels, in the order of `textureGather`.
fn offset_of(of: [f32; 4], is_better: impl Fn(f32, f32) -> bool) -> [f32; 2] {
    let best = |a: f32, b: f32| if is_better(a, b) { a } else { b };
    match is_better(best(of[0], of[1]), best(of[2], of[3])) {
        true => [f32::from(is_better(of[1], of[0])), 1.0],
        false => [f32::from(is_better(of[2], of[3])), 0.0],
    }
}

/// One number for all lanes.
#[inline(always)]
pub(super) fn splat(one: f32) -> Lanes {
    [one; LANES]
}

/// One direction for all lanes.
#[inline(always)]
pub(super) fn splat3([x, y, z]: [f32; 3]) -> [Lanes; 3] {
    [splat(x), splat(y), splat(z)]
}
