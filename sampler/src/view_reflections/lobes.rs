//! The rays of what sub-samples reflect, and the means of what they meet.
//!
//! A sharp reflection has rays of its own in each sub-sample. A blurred one varies little from pixel to pixel: a pixel casts
//! one ray of the surface's lobe, pixels of a square cast different ones, and each takes the mean around it,
//! within its surface. So every pixel sees the whole lobe.

use std::ops::Range;

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::taps::taps;
use crate::light::ShadingPoint;
use crate::reflected_light::{Mirror, Ray, reflected};
use crate::tile::Tile;

/// Largest α of a reflection that pixels share in squares of 3 × 3; others share in squares of 5 × 5.
const SMOOTH: f32 = 0.12;
/// Least cosine between the normals of pixels that share a blurred reflection.
const ALIKE: f32 = 0.85;
/// A change from sub-sample to sub-sample is at most so large a share of the distance.
const LARGEST_STEP: f32 = 0.05;

/// Rays of a surface.
#[derive(Debug, Clone)]
struct Lobe {
    point: ShadingPoint,
    reflector: u32,
    /// Rays of the reflection, with their weights in [`Lobes::weights`].
    reflected: Range<u32>,
    /// The refracted ray.
    through: Option<u32>,
}

/// All rays of a tile.
pub(crate) struct Lobes {
    pub(crate) rays: Vec<Ray>,
    weights: Vec<f32>,
    lobes: Vec<Lobe>,
    /// Reflective sub-samples.
    seen: Vec<Seen>,
    /// For each pixel of the tile its shared lobe, if it has one.
    shared: Vec<Option<u32>>,
    /// Pixels: columns, rows; and sub-samples along a pixel's side.
    size: [u32; 2],
    side: u32,
}

/// A reflective sub-sample.
#[derive(Debug, Clone, Copy)]
struct Seen {
    /// Its number in the tile.
    at: u32,
    /// Its lobe.
    lobe: u32,
    /// Pixels on a side of the square whose lobes it takes the mean of; 1 for a sharp reflection.
    square: u32,
}

impl Lobes {
    /// Rays of a tile, of which the G-buffer (`shaders/shared/g_buffer.wgsl`) and words of reflectors were read back. A sharp
    /// reflection has `taps_` rays in each sub-sample. `offset` is how far off a surface about the eye rays begin, metres.
    /// `instances` are those of the reflectors.
    pub(crate) fn new(
        g_buffer: [&[u8]; 3],
        tile: &Tile,
        taps_: u32,
        offset: impl Fn(Vec3) -> f32 + Sync,
        instances: &[u32],
    ) -> Self {
        let [width, _] = tile.sub_samples();
        let mirrors = mirrors(g_buffer, offset);
        let offsets: Vec<Vec2> = taps(taps_).into_iter().map(|tap| tap.as_vec2()).collect();
        let mut all = Self {
            rays: Vec::new(),
            weights: Vec::new(),
            lobes: Vec::new(),
            seen: Vec::new(),
            shared: vec![None; (tile.size[0] * tile.size[1]) as usize],
            size: tile.size,
            side: tile.side,
        };
        let pixel_width = tile_spread(tile);
        for (at, mirror) in mirrors.iter().enumerate() {
            let Some(mirror) = mirror else { continue };
            let [x, y] = [at as u32 % width, at as u32 / width];
            let pixel = [x / tile.side, y / tile.side];
            let own = instances.get(mirror.reflector as usize).copied();
            if mirror.is_sharp() {
                let steps = [(1, x + 1 < width), (width as usize, true)].map(|(stride, is_inside)| {
                    let next = mirrors.get(at + stride).copied().flatten().filter(|_| is_inside);
                    step(mirror, next.as_ref())
                });
                let rays = offsets.iter().map(|tap| tapped(mirror, steps, *tap));
                let lobe = all.cast(mirror, at as u32, own, rays, pixel_width / tile.side as f32);
                all.seen.push(Seen { at: at as u32, lobe, square: 1 });
                continue;
            }
            let square = if mirror.alpha() < SMOOTH { 3 } else { 5 };
            let number = (pixel[1] * tile.size[0] + pixel[0]) as usize;
            let is_of = |lobe: &u32| all.lobes[*lobe as usize].reflector == mirror.reflector;
            let lobe = match all.shared[number].filter(is_of) {
                Some(lobe) => lobe,
                None => {
                    let in_image = [0, 1].map(|axis| tile.begin[axis] + pixel[axis]);
                    let stratum = in_image[0] % square + square * (in_image[1] % square);
                    let half = mirror.half_vector(stratum, square * square);
                    let towards = mirror.point.position.normalize_or(-half);
                    let rays = std::iter::once((mirror.point.start, reflected(towards, half)));
                    let lobe = all.cast(mirror, at as u32, own, rays, pixel_width);
                    all.shared[number] = Some(lobe);
                    lobe
                }
            };
            all.seen.push(Seen { at: at as u32, lobe, square });
        }
        all
    }

    /// Adds a surface's lobe: starts and directions of reflected rays, and the refracted ray. They are for sub-sample `at`, and
    /// of the instance `own`. Returns its number.
    fn cast(
        &mut self,
        mirror: &Mirror,
        at: u32,
        own: Option<u32>,
        reflected: impl Iterator<Item = (Vec3, Vec3)>,
        pixel_width: f32,
    ) -> u32 {
        let &Mirror { point, reflector, .. } = mirror;
        let (width, spread) = (pixel_width * point.position.length(), pixel_width + mirror.alpha());
        let ray = |start, direction, past, is_through| Ray {
            start,
            direction,
            reflector,
            past,
            width,
            spread,
            at,
            is_through,
        };
        let first = self.rays.len() as u32;
        for (start, direction) in reflected {
            let weight = direction.dot(point.normal);
            if weight > 0.0 {
                // Where the shading normal leans away from the triangle's, a ray may point into the surface. It stands for
                // a smooth one, and passes through.
                let past = own.filter(|_| direction.dot(point.side) <= 0.0);
                self.rays.push(ray(start, direction, past, false));
                self.weights.push(weight);
            }
        }
        let end = self.rays.len() as u32;
        let through = mirror.through(point.position.normalize_or(-point.normal)).map(|(start, inward)| {
            self.rays.push(ray(start, inward, own, true));
            self.weights.push(1.0);
            end
        });
        self.lobes.push(Lobe { point, reflector, reflected: first..end, through });
        self.lobes.len() as u32 - 1
    }

    /// What arrives at each of `count` sub-samples, by the radiance that rays meet: reflected radiance of all, and then
    /// refracted radiance of all, if there is any. The fourth component is unused.
    pub(crate) fn gather(&self, arriving: &[Vec3], count: usize) -> Vec<[f32; 4]> {
        let sums: Vec<[Sum; 2]> =
            self.lobes.par_iter().with_min_len(1024).map(|lobe| self.sums(lobe, arriving)).collect();
        let found: Vec<[Vec3; 2]> =
            self.seen.par_iter().with_min_len(256).map(|seen| self.of_square(seen, &sums)).collect();
        let lets_through = self.lobes.iter().any(|lobe| lobe.through.is_some());
        let mut words = vec![[0.0; 4]; if lets_through { 2 * count } else { count }];
        for (seen, [reflected, through]) in self.seen.iter().zip(found) {
            words[seen.at as usize] = reflected.extend(0.0).to_array();
            if lets_through {
                words[count + seen.at as usize] = through.extend(0.0).to_array();
            }
        }
        words
    }

    /// Weighted sums of a lobe's reflected and refracted radiance, and their weights.
    fn sums(&self, lobe: &Lobe, arriving: &[Vec3]) -> [Sum; 2] {
        let rays = lobe.reflected.start as usize..lobe.reflected.end as usize;
        let mut reflected = Sum::default();
        for (radiance, weight) in arriving[rays.clone()].iter().zip(&self.weights[rays]) {
            reflected.add(*radiance * *weight, *weight);
        }
        let through =
            lobe.through.map(|ray| Sum { radiance: arriving[ray as usize], weight: 1.0 }).unwrap_or_default();
        [reflected, through]
    }

    /// Means over the lobes of the square around a sub-sample's pixel that show its surface.
    fn of_square(&self, seen: &Seen, sums: &[[Sum; 2]]) -> [Vec3; 2] {
        let own = &sums[seen.lobe as usize];
        if seen.square == 1 {
            return own.map(Sum::mean);
        }
        let lobe = &self.lobes[seen.lobe as usize];
        let [width, height] = self.size.map(i64::from);
        let side = i64::from(self.side);
        // Two boxes: the first covers each direction of the lobe once, the second takes off the edges of few bright rays.
        let reach = i64::from(seen.square / 2) + 1;
        let weight = |off: i64| (reach + 1 - off.abs()).min(3) as f32;
        let (at, columns) = (i64::from(seen.at), width * side);
        let (column, row) = (at % columns / side, at / columns / side);
        let mut all = [Sum::default(); 2];
        for y in (row - reach).max(0)..=(row + reach).min(height - 1) {
            for x in (column - reach).max(0)..=(column + reach).min(width - 1) {
                let Some(number) = self.shared[(y * width + x) as usize] else { continue };
                let other = &self.lobes[number as usize];
                if number == seen.lobe || lobe.agrees(other) {
                    let weight = weight(x - column) * weight(y - row);
                    for (all, one) in all.iter_mut().zip(&sums[number as usize]) {
                        all.add(one.radiance * weight, one.weight * weight);
                    }
                }
            }
        }
        all.map(Sum::mean)
    }
}

impl Lobe {
    /// Whether another pixel reflects about the same.
    fn agrees(&self, other: &Self) -> bool {
        let off = (self.point.position - other.point.position).length();
        self.reflector == other.reflector
            && self.point.normal.dot(other.point.normal) > ALIKE
            && off < LARGEST_STEP * self.point.position.length()
    }
}

/// A weighted sum of radiance.
#[derive(Clone, Copy, Default)]
struct Sum {
    radiance: Vec3,
    weight: f32,
}

impl Sum {
    /// Adds radiance that is already weighted.
    fn add(&mut self, radiance: Vec3, weight: f32) {
        self.radiance += radiance;
        self.weight += weight;
    }

    fn mean(self) -> Vec3 {
        if self.weight > 0.0 { self.radiance / self.weight } else { Vec3::ZERO }
    }
}

/// Reflective surfaces of a tile's sub-samples.
fn mirrors(
    [surfaces, materials, words]: [&[u8]; 3],
    offset: impl Fn(Vec3) -> f32 + Sync,
) -> Vec<Option<Mirror>> {
    let word4 = |bytes: &[u8; 16]| bytemuck::pod_read_unaligned::<[u32; 4]>(bytes);
    let g_buffer = surfaces.as_chunks::<16>().0.par_iter().zip(materials.as_chunks::<16>().0);
    let of_sub_sample = |((surface, material), word): ((&[u8; 16], &[u8; 16]), &[u8; 4])| {
        let word = u32::from_le_bytes(*word);
        let number = probe_in_word(word).checked_sub(1)?;
        Mirror::of_g_buffer([word4(surface), word4(material)], &offset, number, lets_through(word))
    };
    g_buffer.zip(words.as_chunks::<4>().0).with_min_len(4096).map(of_sub_sample).collect()
}

/// Number of the reflector, from 1, in a word of `shaders/shared/reflection_probes.wgsl`.
fn probe_in_word(word: u32) -> u32 {
    word & 2047
}

/// Whether light passes through, in the same word.
fn lets_through(word: u32) -> bool {
    word >> 11 != 0
}

/// Change of position and normal to a neighbour, if it shows the same surface.
fn step(here: &Mirror, next: Option<&Mirror>) -> [Vec3; 2] {
    let Some(next) = next.filter(|next| next.reflector == here.reflector) else { return [Vec3::ZERO; 2] };
    let [step, turn] = [next.point.position - here.point.position, next.point.normal - here.point.normal];
    let is_smooth = step.length() < LARGEST_STEP * here.point.position.length() && turn.length() < 1.0;
    if is_smooth { [step, turn] } else { [Vec3::ZERO; 2] }
}

/// Start and direction of the reflected ray at an offset from a sub-sample's middle, in sub-samples.
fn tapped(mirror: &Mirror, [right, down]: [[Vec3; 2]; 2], tap: Vec2) -> (Vec3, Vec3) {
    let ShadingPoint { position, normal, start, .. } = mirror.point;
    let normal = (normal + right[1] * tap.x + down[1] * tap.y).normalize_or(normal);
    let step = right[0] * tap.x + down[0] * tap.y;
    let towards = (position + step).normalize_or(-normal);
    (start + step, reflected(towards, normal))
}

/// Width of a pixel at unit distance, in the middle of a tile.
fn tile_spread(tile: &Tile) -> f32 {
    Vec3::from_array(tile.rays().right).length() * tile.side as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mirror(normal: Vec3) -> Mirror {
        let position = Vec3::new(0.0, 0.0, -4.0);
        let point = ShadingPoint {
            exists: true,
            position,
            normal,
            side: Vec3::Z,
            start: position,
            is_lifted: false,
            across: 0.0,
        };
        Mirror { point, reflector: 0, f0: Vec3::ONE, roughness: 0.0, eta: None }
    }

    #[test]
    fn light_that_meets_a_mirror_head_on_returns_and_taps_turn_with_the_normal() {
        let here = mirror(Vec3::Z);
        assert_eq!(reflected(-Vec3::Z, Vec3::Z), Vec3::Z);
        let turn = [[Vec3::X * 0.1, Vec3::X * 0.2], [Vec3::ZERO; 2]];
        let (start, direction) = tapped(&here, turn, Vec2::X);
        assert!(
            (start - here.point.start - Vec3::X * 0.1).length() < 1e-6 && direction.x > 0.2,
            "{direction}"
        );
        assert_eq!(tapped(&here, turn, Vec2::ZERO).1, Vec3::Z);
    }

    #[test]
    fn steps_are_none_across_reflectors_and_edges() {
        let here = mirror(Vec3::Z);
        assert_eq!(step(&here, None), [Vec3::ZERO; 2]);
        assert_eq!(step(&here, Some(&Mirror { reflector: 1, ..here })), [Vec3::ZERO; 2]);
        assert_eq!(step(&here, Some(&mirror(-Vec3::Z))), [Vec3::ZERO; 2]);
        assert!(step(&here, Some(&mirror(Vec3::new(0.1, 0.0, 0.995))))[1].x > 0.05);
    }

    #[test]
    fn an_eye_on_the_surface_gives_unit_directions() {
        let mut here = mirror(Vec3::Z);
        here.point.position = Vec3::ZERO;
        assert!(
            here.through(-Vec3::Z).is_none() && tapped(&here, [[Vec3::ZERO; 2]; 2], Vec2::X).1.is_finite()
        );
    }
}
