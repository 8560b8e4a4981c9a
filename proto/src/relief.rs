//! The relief of a frame, for browsers: its inverse depth, as planes over squares of pixels.
//!
//! A page redraws a frame from another viewpoint by moving its pixels. Inverse depth along the optical axis is affine in
//! pixels on a plane, so a square of pixels that see one plane needs three numbers, and a redraw of them is one quad. A
//! quadtree finds the squares: a square is a leaf if an affine function is nowhere further than the tolerance from its
//! pixels, else it has four children, down to single pixels. So planes are exact to a known residual, and silhouettes to
//! a pixel. A frame with too many leaves gets a wider tolerance and larger smallest squares, and says so.
//!
//! The bytes, before they are deflated (RFC 1951):
//!
//! 1. The number of bytes of part 2: 4 bytes, little-endian.
//! 2. One bit a square, lowest bit of a byte first: 1 if it has children. The squares of [`ROOT`] pixels come row by row,
//!    each before its children, these row by row. Squares outside of the image are left out, and single pixels (or
//!    squares of the smallest size) have no bit.
//! 3. The leaves in that order, each three numbers as LEB128 of their zigzag: how much the value at its centre differs
//!    from what the previous leaf's plane has there, and how much each slope differs from the previous one. A square of
//!    the smallest size has only the first, and no slope; the next leaf's slopes still differ from the last slopes there
//!    were. Values count steps of [`Relief::step`]; slopes count 1/64 steps a pixel. The previous plane's value is
//!    ⌊(slope x · 2Δx + slope y · 2Δy + 64) / 128⌋ steps from its centre's.

use std::io::Write as _;

use flate2::Compression;
use flate2::write::DeflateEncoder;

/// Side of the largest squares in pixels.
pub const ROOT: u32 = 64;

/// Most leaves of a relief. A page without a graphics processor draws as many in about 10 ms.
pub const MOST_LEAVES: usize = 16_000;

/// Largest slope, in 1/64 steps a pixel.
const STEEPEST: f32 = 32_768.0;

/// Largest value in steps. Beyond it, 2⁻²⁰ of the tolerance is no longer told apart.
const MOST_STEPS: f32 = 1_000_000.0;

/// The inverse depth of a frame as planes.
#[derive(Debug, Clone, PartialEq)]
pub struct Relief {
    /// Its deflated bytes.
    pub bytes: Vec<u8>,
    /// Number of leaves.
    pub leaves: usize,
    /// Side of the smallest squares in pixels, a power of two.
    pub smallest: u32,
    /// Unit of its values, 1/m.
    pub step: f64,
    /// No pixel of a square above the smallest size is further than this from its plane, 1/m.
    pub residual: f64,
    /// Share of pixels in squares of the smallest size that are further from them than that. 0 if they are single pixels.
    pub torn: f64,
    /// Sum over neighbouring pixels, in rows and in columns, of jumps in inverse depth above that residual: 1/m. A viewer who
    /// moves aside by one metre bares as many pixels, for a focal length of one pixel.
    pub jumps: f64,
    /// Median of inverse depth, 1/m.
    pub median: f64,
}

/// Encodes a range image (metres from the eye; infinite where nothing is), row 0 at the top, of a pinhole camera with this
/// tangent of half its field of view, horizontal and vertical. `tolerance`: the residual that planes may have, 1/m.
///
/// Takes milliseconds: call it off async threads.
///
/// Returns `None` if `range` does not have `width` × `height` pixels, there are none, or the tolerance is not above 0.
pub fn encode(range: &[f32], width: u32, height: u32, tan_half: [f64; 2], tolerance: f64) -> Option<Relief> {
    let fits = width > 0 && height > 0 && range.len() == width as usize * height as usize;
    let wanted = tolerance > 0.0 && tolerance.is_finite();
    if !fits || !wanted {
        return None;
    }
    let image = Image { values: inverse_depth(range, width, height, tan_half), width, height };
    let (mut tolerance, mut smallest) = (tolerance as f32, 1);
    loop {
        let mut tree = Tree::new(&image, tolerance, smallest);
        if tree.grow() {
            return tree.finish();
        }
        (tolerance, smallest) = (2.0 * tolerance, (2 * smallest).min(ROOT));
    }
}

/// Inverse depth along the axis from ranges, 1/m.
fn inverse_depth(range: &[f32], width: u32, height: u32, tan_half: [f64; 2]) -> Vec<f32> {
    let slope = |i: usize, count: u32, tan: f64| ((i as f64 + 0.5) / f64::from(count) * 2.0 - 1.0) * tan;
    let across: Vec<f32> = (0..width as usize).map(|x| slope(x, width, tan_half[0]).powi(2) as f32).collect();
    let mut values = Vec::with_capacity(range.len());
    for (y, row) in range.chunks(width as usize).enumerate() {
        let down = 1.0 + slope(y, height, tan_half[1]).powi(2) as f32;
        values.extend(row.iter().zip(&across).map(|(range, across)| {
            let value = (down + across).sqrt() / range;
            // A range that is no distance counts as sky.
            if value.is_finite() && value > 0.0 { value } else { 0.0 }
        }));
    }
    values
}

struct Image {
    values: Vec<f32>,
    width: u32,
    height: u32,
}

/// A square of pixels, clipped to the image.
#[derive(Clone, Copy)]
struct Square {
    x: u32,
    y: u32,
    width: u32,
    height: u32,
}

/// A plane over a square: its value at the centre in steps, and its slopes in 1/64 steps a pixel.
#[derive(Clone, Copy, Default)]
struct Plane {
    centre: i64,
    slope: [i64; 2],
}

impl Plane {
    /// Its value in steps at twice this offset from its centre.
    fn at(&self, twice: [i64; 2]) -> f32 {
        self.centre as f32 + (self.slope[0] * twice[0] + self.slope[1] * twice[1]) as f32 / 128.0
    }
}

struct Tree<'a> {
    image: &'a Image,
    tolerance: f32,
    smallest: u32,
    step: f32,
    splits: Vec<u8>,
    /// Number of bits in `splits`.
    bits: usize,
    planes: Vec<u8>,
    leaves: usize,
    /// The last slopes that were written, with the last leaf's value at its centre.
    last: Plane,
    /// Twice the last leaf's centre.
    last_at: [i64; 2],
    residual: f32,
    torn: usize,
}

impl<'a> Tree<'a> {
    fn new(image: &'a Image, tolerance: f32, smallest: u32) -> Self {
        let nearest = image.values.iter().copied().fold(0.0, f32::max);
        Self {
            image,
            tolerance,
            smallest,
            step: (tolerance / 4.0).max(nearest / MOST_STEPS),
            splits: Vec::new(),
            bits: 0,
            planes: Vec::new(),
            leaves: 0,
            last: Plane::default(),
            last_at: [0; 2],
            residual: 0.0,
            torn: 0,
        }
    }

    /// Adds the squares of the image. Returns whether there are few enough leaves.
    fn grow(&mut self) -> bool {
        for y in (0..self.image.height).step_by(ROOT as usize) {
            for x in (0..self.image.width).step_by(ROOT as usize) {
                self.add(x, y, ROOT);
                if self.leaves > MOST_LEAVES && self.smallest < ROOT {
                    return false;
                }
            }
        }
        true
    }

    fn add(&mut self, x: u32, y: u32, size: u32) {
        let Image { width, height, .. } = *self.image;
        if x >= width || y >= height {
            return;
        }
        let square = Square { x, y, width: size.min(width - x), height: size.min(height - y) };
        if size == self.smallest {
            return self.add_smallest(square);
        }
        let plane = self.fitting(square);
        self.split(plane.is_none());
        match plane {
            Some(plane) => self.leaf(square, plane, true),
            None => {
                let half = size / 2;
                for (dx, dy) in [(0, 0), (half, 0), (0, half), (half, half)] {
                    self.add(x + dx, y + dy, half);
                }
            }
        }
    }

    fn split(&mut self, split: bool) {
        if self.bits.is_multiple_of(8) {
            self.splits.push(0);
        }
        if let Some(last) = self.splits.last_mut() {
            *last |= u8::from(split) << (self.bits % 8);
        }
        self.bits += 1;
    }

    /// A square of the smallest size has its middle pixel's value.
    fn add_smallest(&mut self, square: Square) {
        let Square { x, y, width, height } = square;
        let middle = self.value(x + width / 2, y + height / 2);
        let centre = (middle / self.step).round() as i64;
        let shown = centre as f32 * self.step;
        for j in y..y + height {
            let torn = (x..x + width).filter(|i| (self.value(*i, j) - shown).abs() > self.tolerance);
            self.torn += torn.count();
        }
        self.leaf(square, Plane { centre, slope: [0; 2] }, false);
    }

    fn value(&self, x: u32, y: u32) -> f32 {
        self.image.values[y as usize * self.image.width as usize + x as usize]
    }

    /// The plane of a square, if its pixels are within the tolerance of one: fitted by least squares to at most 9 × 9 of
    /// them, rounded, and then compared with all.
    fn fitting(&mut self, square: Square) -> Option<Plane> {
        let Square { x, y, width, height } = square;
        let stride = (width.max(height) / 8).max(1);
        // Slopes are independent of one another over a grid.
        let (mut sum, mut of_x, mut of_y) = ([0.0_f32; 3], 0.0, 0.0);
        let mut count = 0.0;
        let spread = |length: u32| ((length - 1) / stride * stride) as f32 / 2.0;
        let middle = [spread(width), spread(height)];
        for j in (0..height).step_by(stride as usize) {
            for i in (0..width).step_by(stride as usize) {
                let (dx, dy) = (i as f32 - middle[0], j as f32 - middle[1]);
                let value = self.value(x + i, y + j);
                sum = [sum[0] + value, sum[1] + dx * value, sum[2] + dy * value];
                (of_x, of_y, count) = (of_x + dx * dx, of_y + dy * dy, count + 1.0);
            }
        }
        let per_step = 64.0 / self.step;
        let slope = |sum: f32, of: f32| if of > 0.0 { sum / of * per_step } else { 0.0 };
        let slopes = [slope(sum[1], of_x), slope(sum[2], of_y)];
        if slopes.iter().any(|slope| !(slope.abs() < STEEPEST)) {
            return None;
        }
        // From the middle of the fitted pixels to that of the square.
        let to_centre = [(width - 1) as f32 / 2.0 - middle[0], (height - 1) as f32 / 2.0 - middle[1]];
        let centre =
            sum[0] / count / self.step + (slopes[0] * to_centre[0] + slopes[1] * to_centre[1]) / 64.0;
        let plane = Plane { centre: centre.round() as i64, slope: slopes.map(|slope| slope.round() as i64) };
        let worst = self.worst(square, plane)?;
        self.residual = self.residual.max(worst);
        Some(plane)
    }

    /// Largest distance of a pixel from a plane, if it is within the tolerance.
    fn worst(&self, square: Square, plane: Plane) -> Option<f32> {
        let Square { x, y, width, height } = square;
        let mut worst = 0.0_f32;
        for j in 0..height {
            let first = (y + j) as usize * self.image.width as usize + x as usize;
            let row = &self.image.values[first..first + width as usize];
            let twice_y = 2 * i64::from(j) + 1 - i64::from(height);
            let start = plane.at([1 - i64::from(width), twice_y]);
            let slope = plane.slope[0] as f32 / 64.0;
            for (i, value) in row.iter().enumerate() {
                worst = worst.max((value - (start + slope * i as f32) * self.step).abs());
            }
            if worst > self.tolerance {
                return None;
            }
        }
        Some(worst)
    }

    /// Writes a leaf.
    fn leaf(&mut self, square: Square, plane: Plane, slopes: bool) {
        let at = [i64::from(2 * square.x + square.width), i64::from(2 * square.y + square.height)];
        let slope = self.last.slope;
        let apart = [at[0] - self.last_at[0], at[1] - self.last_at[1]];
        let expected = self.last.centre + ((slope[0] * apart[0] + slope[1] * apart[1] + 64) >> 7);
        self.number(plane.centre - expected);
        if slopes {
            self.number(plane.slope[0] - slope[0]);
            self.number(plane.slope[1] - slope[1]);
            self.last.slope = plane.slope;
        }
        self.last.centre = plane.centre;
        self.last_at = at;
        self.leaves += 1;
    }

    fn number(&mut self, number: i64) {
        let mut rest = ((number << 1) ^ (number >> 63)) as u64;
        while rest >= 0x80 {
            self.planes.push(rest as u8 | 0x80);
            rest >>= 7;
        }
        self.planes.push(rest as u8);
    }

    fn finish(self) -> Option<Relief> {
        let mut deflated = DeflateEncoder::new(Vec::new(), Compression::fast());
        deflated.write_all(&(self.splits.len() as u32).to_le_bytes()).ok()?;
        deflated.write_all(&self.splits).ok()?;
        deflated.write_all(&self.planes).ok()?;
        Some(Relief {
            bytes: deflated.finish().ok()?,
            leaves: self.leaves,
            smallest: self.smallest,
            step: f64::from(self.step),
            residual: f64::from(self.residual.max(self.step / 2.0)),
            torn: self.torn as f64 / self.image.values.len() as f64,
            jumps: self.image.jumps(2.0 * self.tolerance),
            median: self.image.median(),
        })
    }
}

impl Image {
    /// Sum of the jumps above a threshold between neighbours.
    fn jumps(&self, threshold: f32) -> f64 {
        let width = self.width as usize;
        let jump = |(a, b): (&f32, &f32)| {
            let jump = (a - b).abs();
            if jump > threshold { f64::from(jump) } else { 0.0 }
        };
        let across: f64 =
            self.values.chunks(width).map(|row| row.iter().zip(&row[1..]).map(jump).sum::<f64>()).sum();
        let down: f64 = self.values.iter().zip(&self.values[width..]).map(jump).sum();
        across + down
    }

    fn median(&self) -> f64 {
        // One in 61, a prime: no column is preferred.
        let mut some: Vec<f32> = self.values.iter().copied().step_by(61).collect();
        let middle = some.len() / 2;
        f64::from(*some.select_nth_unstable_by(middle, f32::total_cmp).1)
    }
}

#[cfg(test)]
mod tests;
