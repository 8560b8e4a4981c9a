use std::io::Read as _;

use flate2::read::DeflateDecoder;
use proptest::prelude::*;

use super::*;

/// A decoded leaf: its square, the step values at the pixels, and whether it is of the smallest size.
struct Leaf {
    square: Square,
    plane: Plane,
    smallest: bool,
}

/// Decodes by the format's description.
struct Reader {
    splits: Vec<u8>,
    bit: usize,
    planes: std::vec::IntoIter<u8>,
    last: Plane,
    at: [i64; 2],
    leaves: Vec<Leaf>,
    size: [u32; 2],
    smallest: u32,
}

impl Reader {
    fn read(relief: &Relief, size: [u32; 2]) -> Vec<Leaf> {
        let mut bytes = Vec::new();
        DeflateDecoder::new(&relief.bytes[..]).read_to_end(&mut bytes).unwrap();
        let length = u32::from_le_bytes(bytes[..4].try_into().unwrap()) as usize;
        let mut reader = Self {
            splits: bytes[4..4 + length].to_vec(),
            bit: 0,
            planes: bytes.split_off(4 + length).into_iter(),
            last: Plane::default(),
            at: [0; 2],
            leaves: vec![],
            size,
            smallest: relief.smallest,
        };
        for y in (0..size[1]).step_by(64) {
            for x in (0..size[0]).step_by(64) {
                reader.square(x, y, 64);
            }
        }
        assert_eq!(reader.planes.len(), 0, "all bytes are of leaves");
        assert_eq!(reader.leaves.len(), relief.leaves);
        reader.leaves
    }

    fn number(&mut self) -> i64 {
        let (mut number, mut shift) = (0_u64, 0);
        loop {
            let byte = self.planes.next().unwrap();
            number |= u64::from(byte & 0x7f) << shift;
            shift += 7;
            if byte < 0x80 {
                return (number >> 1) as i64 ^ -((number & 1) as i64);
            }
        }
    }

    fn square(&mut self, x: u32, y: u32, size: u32) {
        if x >= self.size[0] || y >= self.size[1] {
            return;
        }
        let smallest = size == self.smallest;
        if !smallest {
            let splits = self.splits[self.bit / 8] >> (self.bit % 8) & 1 == 1;
            self.bit += 1;
            if splits {
                let half = size / 2;
                for (dx, dy) in [(0, 0), (half, 0), (0, half), (half, half)] {
                    self.square(x + dx, y + dy, half);
                }
                return;
            }
        }
        let square = Square { x, y, width: size.min(self.size[0] - x), height: size.min(self.size[1] - y) };
        let at = [i64::from(2 * x + square.width), i64::from(2 * y + square.height)];
        let twice: i64 = (0..2).map(|i| self.last.slope[i] * (at[i] - self.at[i])).sum();
        self.last.centre += (twice + 64).div_euclid(128) + self.number();
        self.at = at;
        let mut slope = [0; 2];
        if !smallest {
            for i in 0..2 {
                self.last.slope[i] += self.number();
            }
            slope = self.last.slope;
        }
        self.leaves.push(Leaf { square, plane: Plane { centre: self.last.centre, slope }, smallest });
    }
}

/// Encodes inverse depths and checks what the relief says of them. Returns it.
fn checked(width: u32, height: u32, tolerance: f64, inverse: impl Fn(u32, u32) -> f64) -> Relief {
    let tan_half = [0.7, 0.5];
    let slope = |i: u32, count: u32, tan: f64| ((f64::from(i) + 0.5) / f64::from(count) * 2.0 - 1.0) * tan;
    let range = |x, y| {
        let ray = (1.0 + slope(x, width, 0.7).powi(2) + slope(y, height, 0.5).powi(2)).sqrt();
        (ray / inverse(x, y)) as f32
    };
    let ranges: Vec<f32> =
        (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).map(|(x, y)| range(x, y)).collect();
    let relief = encode(&ranges, width, height, tan_half, tolerance).unwrap();
    let mut seen = vec![0; ranges.len()];
    let mut torn = 0;
    for Leaf { square, plane, smallest } in Reader::read(&relief, [width, height]) {
        for j in 0..square.height {
            for i in 0..square.width {
                let (x, y) = (square.x + i, square.y + j);
                seen[(y * width + x) as usize] += 1;
                let twice = [
                    i64::from(2 * i + 1) - i64::from(square.width),
                    i64::from(2 * j + 1) - i64::from(square.height),
                ];
                let off = (f64::from(plane.at(twice)) * relief.step - inverse(x, y)).abs();
                // The images, and distances from planes, are of single precision.
                let rounding = 1e-5 * inverse(x, y) + 1e-6 * off + 1e-9;
                if smallest {
                    torn += usize::from(off > tolerance.max(relief.residual) + rounding);
                } else {
                    assert!(off <= relief.residual + rounding, "{x}, {y}: {off} above {}", relief.residual);
                }
            }
        }
    }
    assert!(seen.iter().all(|count| *count == 1), "each pixel is in one square");
    assert!(relief.leaves <= MOST_LEAVES);
    assert!(torn as f64 / ranges.len() as f64 <= relief.torn + 1e-9, "{torn} torn, {}", relief.torn);
    relief
}

#[test]
fn a_plane_is_one_leaf_a_square_of_the_largest_size() {
    let relief = checked(640, 480, 1e-3, |x, y| 0.2 + 1e-4 * f64::from(x) + 3e-4 * f64::from(y));
    assert_eq!((relief.leaves, relief.smallest, relief.torn), (80, 1, 0.0));
    assert!(relief.residual <= 1e-3 && relief.jumps == 0.0, "{relief:?}");
    assert!(relief.bytes.len() < 300, "{} bytes", relief.bytes.len());
    assert!((relief.median - 0.3).abs() < 0.01, "{}", relief.median);
}

#[test]
fn a_silhouette_is_found_to_a_pixel_and_its_jump_is_counted() {
    // A near disk before a far wall.
    let disk = |x: u32, y: u32| f64::hypot(f64::from(x) - 99.5, f64::from(y) - 70.5) < 40.0;
    let relief = checked(200, 150, 1e-3, |x, y| if disk(x, y) { 1.0 } else { 0.1 });
    assert_eq!((relief.smallest, relief.torn), (1, 0.0));
    // Each of its 80 rows and 80 columns has two jumps of 0.9.
    assert!((relief.jumps - 4.0 * 80.0 * 0.9).abs() < 1.0, "{}", relief.jumps);
    assert!(relief.leaves < 2000, "{}", relief.leaves);
}

#[test]
fn what_is_no_distance_counts_as_sky() {
    let ranges = [f32::INFINITY, f32::NAN, -1.0, 0.0, -0.0, f32::NEG_INFINITY];
    let relief = encode(&ranges, 3, 2, [1.0, 1.0], 1e-3).unwrap();
    assert_eq!((relief.leaves, relief.median, relief.jumps), (1, 0.0, 0.0));
    assert_eq!(Reader::read(&relief, [3, 2])[0].plane.centre, 0);
}

#[test]
fn noise_gets_larger_squares_until_there_are_few_enough() {
    let noise = |x: u32, y: u32| {
        f64::from((x.wrapping_mul(2_654_435_761) ^ y.wrapping_mul(40_503)) >> 8 & 0xff) / 100.0
    };
    let relief = checked(800, 600, 1e-3, noise);
    assert!(relief.smallest >= 8 && relief.torn > 0.5, "{} {}", relief.smallest, relief.torn);
    // One far brighter than the rest: values stay within 32 bits.
    let relief = checked(65, 65, 1e-3, |x, y| if (x, y) == (64, 64) { 1e7 } else { 0.5 });
    assert!(relief.step >= 1.0);
}

#[test]
fn images_and_tolerances_that_cannot_be_are_refused() {
    let encode =
        |count, width, height, tolerance| encode(&vec![1.0; count], width, height, [1.0; 2], tolerance);
    assert!(encode(6, 3, 2, 1e-3).is_some());
    for (count, width, height, tolerance) in
        [(0, 0, 0, 1e-3), (5, 3, 2, 1e-3), (6, 3, 2, 0.0), (6, 3, 2, f64::NAN), (6, 3, 2, f64::INFINITY)]
    {
        assert!(encode(count, width, height, tolerance).is_none(), "{count} {width} {height} {tolerance}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn every_pixel_is_within_the_residual_of_its_plane(
        (width, height) in (1_u32..140, 1_u32..140),
        bumps in prop::collection::vec((0.0..140.0, 0.0..140.0, 1.0..60.0, 0.0..2.0), 0..6),
        tolerance in 1e-4..1e-1,
    ) {
        checked(width, height, tolerance, |x, y| {
            let near = bumps.iter().map(|(cx, cy, radius, inverse): &(f64, f64, f64, f64)| {
                let off = f64::hypot(f64::from(x) - cx, f64::from(y) - cy);
                if off < *radius { inverse * (1.0 - 0.3 * off / radius) } else { 0.0 }
            });
            near.fold(1e-3 * f64::from(x), f64::max)
        });
    }
}
