//! The image of an environment, and its irradiance.

use std::f64::consts::{PI, TAU};

use glam::{DVec3, Vec3};

use crate::rgb9e5;

/// Directions, around and from pole to pole, of the patches that integrals over a map are sums of.
const PATCHES: [u32; 2] = [256, 128];

/// The smooth part of an environment map, as shading and rays see it.
#[derive(Debug)]
pub struct EnvironmentMap {
    hash: [u8; 32],
    size: [u32; 2],
    /// Row by row, top row first: nine bits of mantissa a colour and a shared exponent, as on the GPU.
    texels: Vec<u32>,
    harmonics: [Vec3; 9],
    brightest: Vec3,
    darkest: Vec3,
}

impl PartialEq for EnvironmentMap {
    fn eq(&self, other: &Self) -> bool {
        self.hash == other.hash
    }
}

impl EnvironmentMap {
    pub(crate) fn new(size: [u32; 2], texels: &[Vec3]) -> Self {
        let texels: Vec<u32> = texels.iter().map(|texel| rgb9e5::encode(*texel)).collect();
        let mut hasher = blake3::Hasher::new();
        size.iter().chain(&texels).for_each(|word| {
            hasher.update(&word.to_le_bytes());
        });
        let hash = *hasher.finalize().as_bytes();
        let (mut brightest, mut darkest) = (Vec3::ZERO, Vec3::INFINITY);
        for texel in &texels {
            let radiance = rgb9e5::decode(*texel);
            (brightest, darkest) = (brightest.max(radiance), darkest.min(radiance));
        }
        let mut map = Self { hash, size, texels, harmonics: [Vec3::ZERO; 9], brightest, darkest };
        map.harmonics = harmonics(&map.patches(PATCHES));
        map
    }

    /// BLAKE3 over its size and texels.
    pub fn hash(&self) -> [u8; 32] {
        self.hash
    }

    /// Columns and rows.
    pub fn size(&self) -> [u32; 2] {
        self.size
    }

    /// Texels row by row from the top, as `rgb9e5ufloat`.
    pub fn texels(&self) -> &[u32] {
        &self.texels
    }

    /// The largest radiance of each colour.
    pub fn brightest(&self) -> Vec3 {
        self.brightest
    }

    /// The smallest radiance of each colour.
    pub fn darkest(&self) -> Vec3 {
        self.darkest
    }

    /// Radiance from the unit direction `d`.
    pub fn radiance(&self, d: Vec3) -> Vec3 {
        let [width, height] = self.size.map(|side| side as f32);
        let [u, v] = place_of(d);
        let (x, y) = (u * width - 0.5, v * height - 0.5);
        let (left, top) = (x.floor(), y.floor());
        let column = |x: f32| (x as i64).rem_euclid(i64::from(self.size[0])) as usize;
        let row = |y: f32| (y as i64).clamp(0, i64::from(self.size[1]) - 1) as usize;
        let [left_column, right_column] = [column(left), column(left + 1.0)];
        let line = |y: f32| {
            let first = row(y) * self.size[0] as usize;
            let texel = |column: usize| rgb9e5::decode(self.texels[first + column]);
            texel(left_column).lerp(texel(right_column), x - left)
        };
        line(top).lerp(line(top + 1.0), y - top)
    }

    /// Irradiance on a surface with unit normal `n` by π, from below and above: the spherical harmonics of the map up to
    /// degree 2 (Ramamoorthi and Hanrahan, "An Efficient Representation for Irradiance Environment Maps", 2001).
    pub fn ambient(&self, n: Vec3) -> Vec3 {
        let k = &self.harmonics;
        let linear = k[0] + k[1] * n.x + k[2] * n.y + k[3] * n.z;
        let products = k[4] * (n.x * n.y) + k[5] * (n.y * n.z) + k[6] * (n.x * n.z);
        let squares = k[7] * (3.0 * n.z * n.z - 1.0) + k[8] * (n.x * n.x - n.y * n.y);
        (linear + products + squares).max(Vec3::ZERO)
    }

    /// Factors of [`Self::ambient`]: of 1, x, y, z, xy, yz, xz, 3z² − 1 and x² − y².
    pub fn harmonics(&self) -> &[Vec3; 9] {
        &self.harmonics
    }

    /// The map by patches, so many columns and rows, row by row from the top. Solid angles add up to 4π.
    pub fn patches(&self, [columns, rows]: [u32; 2]) -> Vec<Patch> {
        let [width, height] = self.size;
        // A map that is smaller than its patches is looked up in the middle of each.
        let is_coarse = width < columns || height < rows;
        let grid = if is_coarse { [columns, rows] } else { self.size };
        // The texels from `first` on that belong to a patch: all sides differ by a texel at most.
        let first = |patch: u32, texels: u32, patches: u32| {
            (u64::from(patch) * u64::from(texels)).div_ceil(u64::from(patches)) as u32
        };
        let mut patches = Vec::with_capacity((columns * rows) as usize);
        for row in 0..rows {
            let [top, bottom] = [row, row + 1].map(|row| first(row, grid[1], rows));
            for column in 0..columns {
                let [left, right] = [column, column + 1].map(|column| first(column, grid[0], columns));
                let middle = [left + right, top + bottom].map(|sum| f64::from(sum) * 0.5);
                let mut patch =
                    Patch { direction: toward(grid, middle), power: DVec3::ZERO, solid_angle: 0.0 };
                for y in top..bottom {
                    let area = solid_angle(grid, y);
                    for x in left..right {
                        let radiance = match is_coarse {
                            true => self.radiance(direction_of(grid, x, y).as_vec3()),
                            false => rgb9e5::decode(self.texels[y as usize * width as usize + x as usize]),
                        };
                        patch.power += radiance.as_dvec3() * area;
                        patch.solid_angle += area;
                    }
                }
                patches.push(patch);
            }
        }
        patches
    }
}

/// A part of a map.
#[derive(Debug, Clone, Copy)]
pub struct Patch {
    /// Unit direction of its middle.
    pub direction: DVec3,
    /// Its mean radiance times its solid angle.
    pub power: DVec3,
    /// Steradians.
    pub solid_angle: f64,
}

/// Column and row of a direction, as shares of width and height.
fn place_of(d: Vec3) -> [f32; 2] {
    let across = d.x.hypot(d.z);
    // At the poles every column is right.
    let u = if across > 1e-20 { d.x.atan2(-d.z) / std::f32::consts::TAU } else { 0.0 };
    [u - u.floor(), across.atan2(d.y) / std::f32::consts::PI]
}

/// Unit direction of the middle of a texel.
pub(crate) fn direction_of(size: [u32; 2], column: u32, row: u32) -> DVec3 {
    toward(size, [column, row].map(|at| f64::from(at) + 0.5))
}

/// Unit direction of a place of the image, in texels from its top left corner.
fn toward([width, height]: [u32; 2], [x, y]: [f64; 2]) -> DVec3 {
    let polar = PI * y / f64::from(height);
    let around = TAU * x / f64::from(width);
    DVec3::new(polar.sin() * around.sin(), polar.cos(), -polar.sin() * around.cos())
}

/// Solid angle of a texel of a row, steradians.
pub(crate) fn solid_angle([width, height]: [u32; 2], row: u32) -> f64 {
    let cosine = |edge: u32| (PI * f64::from(edge) / f64::from(height)).cos();
    TAU / f64::from(width) * (cosine(row) - cosine(row + 1))
}

/// Factors of [`EnvironmentMap::ambient`] for a map by patches.
fn harmonics(patches: &[Patch]) -> [Vec3; 9] {
    // For each product of the direction: the square of the harmonic's factor, times the factor of degree 0, 1 or 2 by
    // which a cosine-weighted mean shrinks it, which is 1, 2/3 or 1/4.
    type Factor = (f64, fn(DVec3) -> f64);
    let factors: [Factor; 9] = [
        (1.0 / (4.0 * PI), |_| 1.0),
        (1.0 / TAU, |d| d.x),
        (1.0 / TAU, |d| d.y),
        (1.0 / TAU, |d| d.z),
        (15.0 / (16.0 * PI), |d| d.x * d.y),
        (15.0 / (16.0 * PI), |d| d.y * d.z),
        (15.0 / (16.0 * PI), |d| d.x * d.z),
        (5.0 / (64.0 * PI), |d| 3.0 * d.z * d.z - 1.0),
        (15.0 / (64.0 * PI), |d| d.x * d.x - d.y * d.y),
    ];
    factors.map(|(factor, of)| {
        let sum: DVec3 = patches.iter().map(|patch| patch.power * of(patch.direction)).sum();
        (sum * factor).as_vec3()
    })
}
