//! How much the sides around a pixel count for its light, eight of them at a time.
//!
//! Sums are of lanes first, and then over lanes in a fixed order: all processors find the same bits. Vectors are never touched in
//! closures, which are not compiled for AVX2.

use glam::Vec3;

use super::super::shading_points::ShadingPoint;
use super::sides::{MOST_BLOCKED, ORIGINS};
use crate::packets::lanes::{LANES, Lanes, Mask};

/// Falloff with the squared distance from a side's plane, in edges of the cell: no weight from 0.91 on.
const PLANE: f32 = 1.2;
/// Weight below which the sides do not show what the pixel shows.
const LEAST_WEIGHT: f32 = 0.02;

/// Which sides of a corner describe pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Rule {
    /// No wall stands between them.
    InTheOpen,
    /// Only those count that see the side which the pixel lies on.
    BesideWall,
}

impl Rule {
    /// Blocked ways of eight between a side's origins up to which it is fit. Beside a wall, a side that reaches through it by
    /// little brings light of the other room.
    #[inline(always)]
    fn most_blocked(self) -> u8 {
        match self {
            Self::InTheOpen => MOST_BLOCKED,
            Self::BesideWall => 0,
        }
    }

    /// Share of unfit sides from which on the others do not describe a pixel.
    #[inline(always)]
    fn most_unfit(self) -> f32 {
        match self {
            Self::InTheOpen => 0.5,
            Self::BesideWall => 0.1,
        }
    }
}

/// Means of rays.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Mix {
    pub(super) seen: Vec3,
    pub(super) whole: Vec3,
    pub(super) reflected: Vec3,
}

impl Mix {
    #[inline(always)]
    pub(super) fn plus(self, other: Self, weight: f32) -> Self {
        Self {
            seen: self.seen + other.seen * weight,
            whole: self.whole + other.whole * weight,
            reflected: self.reflected + other.reflected * weight,
        }
    }
}

/// A side of one of a corner's cells.
#[derive(Debug, Clone, Copy)]
pub(super) struct Near {
    /// Offset of its cell from the corner's lowest: zeros and ones.
    pub(super) offset: Vec3,
    /// Mean point from that cell's lowest corner, in edges of a cell.
    pub(super) place: Vec3,
    pub(super) normal: Vec3,
    /// How many of eight ways between its own origins are blocked; all if the side is thin.
    pub(super) blocked: u8,
    /// Its group ([`super::corner::groups`]).
    pub(super) group: u8,
    /// Squared share of its rays that count.
    pub(super) valid: f32,
    pub(super) light: Mix,
}

type Row = [f32; LANES];

/// Eight sides, value by value. Those that are not set do not count.
#[derive(Default)]
pub(super) struct Octet {
    offset: [Row; 3],
    at: [Row; 3],
    normal: [Row; 3],
    valid: Row,
    light: [Row; 9],
    blocked: [u8; LANES],
    group: [u8; LANES],
}

impl Octet {
    pub(super) const SIDES: usize = LANES;

    pub(super) fn set(&mut self, lane: usize, side: Near) {
        let Near { offset, place, normal, blocked, group, valid, light } = side;
        let Mix { seen, whole, reflected } = light;
        put(&mut self.offset, lane, offset);
        put(&mut self.at, lane, offset + place);
        put(&mut self.normal, lane, normal);
        put(&mut self.light[..3], lane, seen);
        put(&mut self.light[3..6], lane, whole);
        put(&mut self.light[6..], lane, reflected);
        self.valid[lane] = valid;
        self.blocked[lane] = blocked;
        self.group[lane] = group;
    }

    /// How alike each side and the pixel face, and how near the pixel is to its plane: 0 to 1.
    #[inline(always)]
    fn likeness<L: Lanes>(&self, point: &ShadingPoint, place: Vec3) -> L {
        let (zero, normal, at) = (L::splat(0.0), &self.normal, &self.at);
        let facing = L::from_array(normal[0]) * L::splat(point.normal.x)
            + L::from_array(normal[1]) * L::splat(point.normal.y)
            + L::from_array(normal[2]) * L::splat(point.normal.z);
        let facing = facing.max(zero);
        let off = (L::splat(place.x) - L::from_array(at[0])) * L::splat(point.side.x)
            + (L::splat(place.y) - L::from_array(at[1])) * L::splat(point.side.y)
            + (L::splat(place.z) - L::from_array(at[2])) * L::splat(point.side.z);
        let plane = (L::splat(1.0) - L::splat(PLANE) * off * off).max(zero);
        let squared = facing * facing;
        squared * squared * (plane * plane)
    }

    /// How much each side counts at a pixel.
    #[inline(always)]
    fn weight<L: Lanes>(&self, point: &ShadingPoint, place: Vec3) -> L {
        let near = self.near::<L>(0, place.x) * self.near::<L>(1, place.y) * self.near::<L>(2, place.z);
        near * self.likeness::<L>(point, place) * L::from_array(self.valid)
    }

    /// Along an axis 1 − across for the lower cell, across for the upper one.
    #[inline(always)]
    fn near<L: Lanes>(&self, axis: usize, place: f32) -> L {
        let across = place - 0.5;
        L::splat(1.0 - across) + L::from_array(self.offset[axis]) * L::splat(2.0 * across - 1.0)
    }

    /// A bit for each side that is in the group or in none; for each side if the group is 0.
    #[inline(always)]
    fn of_group(&self, group: u8) -> u32 {
        let mut bits = 0;
        for (lane, of) in self.group.iter().enumerate() {
            bits |= u32::from(group == 0 || *of == 0 || *of == group) << lane;
        }
        bits
    }

    /// A bit for each side with at most so many blocked ways.
    #[inline(always)]
    fn at_most_blocked(&self, most: u8) -> u32 {
        let mut bits = 0;
        for (lane, blocked) in self.blocked.iter().enumerate() {
            bits |= u32::from(*blocked <= most) << lane;
        }
        bits
    }
}

/// The sides of a corner's cells.
pub(super) struct Octets<'a>(pub(super) &'a [Octet]);

impl Octets<'_> {
    /// The mean light of the sides at a pixel; `None` if they do not describe it. `place` is the pixel's, from the lowest cell's
    /// lowest corner, in edges of a cell.
    #[inline(always)]
    pub(super) fn mean<L: Lanes>(&self, point: &ShadingPoint, place: Vec3, rule: Rule) -> Option<Mix> {
        let group = match rule {
            Rule::InTheOpen => 0,
            Rule::BesideWall => self.home::<L>(point, place)?,
        };
        let zero = L::splat(0.0);
        let (mut light, mut fit, mut unfit) = ([zero; 9], zero, zero);
        for octet in self.0 {
            let mut weight = octet.weight::<L>(point, place);
            if group != 0 {
                weight = zero.replaced(L::Mask::from_bits(octet.of_group(group)), weight);
            }
            let is_fit = L::Mask::from_bits(octet.at_most_blocked(rule.most_blocked()));
            let counts = zero.replaced(is_fit, weight);
            fit = fit + counts;
            unfit = unfit + weight.replaced(is_fit, zero);
            for (sum, row) in light.iter_mut().zip(&octet.light) {
                *sum = *sum + L::from_array(*row) * counts;
            }
        }
        let (fit, unfit) = (sum(fit), sum(unfit));
        if !(fit > LEAST_WEIGHT && unfit <= rule.most_unfit() * (fit + unfit)) {
            return None;
        }
        let mut means = [0.0; 9];
        for (mean, lanes) in means.iter_mut().zip(light) {
            *mean = sum(lanes) / fit;
        }
        let [seen, whole, reflected] =
            [Vec3::from_slice(&means), Vec3::from_slice(&means[3..]), Vec3::from_slice(&means[6..])];
        Some(Mix { seen, whole, reflected })
    }

    /// The group of the side that a pixel itself lies on; `None` if there is no such side, or if it is not fit.
    #[inline(always)]
    fn home<L: Lanes>(&self, point: &ShadingPoint, place: Vec3) -> Option<u8> {
        let cell = place.floor();
        let mut most = (0.0, ORIGINS as u8, 0);
        for octet in self.0 {
            let likeness = octet.likeness::<L>(point, place).to_array();
            for lane in 0..LANES {
                let [x, y, z] = &octet.offset;
                let offset = Vec3::new(x[lane], y[lane], z[lane]);
                if octet.valid[lane] > 0.0 && offset == cell && likeness[lane] >= most.0 {
                    most = (likeness[lane], octet.blocked[lane], octet.group[lane]);
                }
            }
        }
        let (likeness, blocked, group) = most;
        (likeness > 0.0 && blocked <= Rule::BesideWall.most_blocked()).then_some(group)
    }
}

#[inline(always)]
fn put(rows: &mut [Row], lane: usize, v: Vec3) {
    rows[0][lane] = v.x;
    rows[1][lane] = v.y;
    rows[2][lane] = v.z;
}

#[inline(always)]
fn sum<L: Lanes>(lanes: L) -> f32 {
    let [a, b, c, d, e, f, g, h] = lanes.to_array();
    ((a + b) + (c + d)) + ((e + f) + (g + h))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::packets::lanes::Plain;

    fn side(offset: Vec3, normal: Vec3, light: f32) -> Near {
        let light = Mix { seen: Vec3::ZERO, whole: Vec3::ONE, reflected: Vec3::splat(light) };
        Near { offset, place: Vec3::splat(0.5), normal, blocked: 0, group: 0, valid: 1.0, light }
    }

    fn octets(sides: &[Near]) -> Vec<Octet> {
        let octet = |sides: &[Near]| {
            let mut octet = Octet::default();
            sides.iter().enumerate().for_each(|(lane, side)| octet.set(lane, *side));
            octet
        };
        sides.chunks(Octet::SIDES).map(octet).collect()
    }

    /// The mean of some sides at a pixel on the plane y = 1, which faces up.
    fn mean_at(sides: &[Near], place: Vec3, rule: Rule) -> Option<f32> {
        let point = ShadingPoint { exists: true, normal: Vec3::Y, side: Vec3::Y, ..ShadingPoint::default() };
        Octets(&octets(sides)).mean::<Plain>(&point, place, rule).map(|mix| mix.reflected.x)
    }

    #[test]
    fn a_pixel_between_sides_takes_each_by_how_near_it_is() {
        let sides = [side(Vec3::ZERO, Vec3::Y, 1.0), side(Vec3::X, Vec3::Y, 3.0)];
        for (x, expected) in [(0.5, 1.0), (1.0, 2.0), (1.25, 2.5)] {
            let light = mean_at(&sides, Vec3::new(x, 0.5, 0.5), Rule::InTheOpen).unwrap();
            assert!((light - expected).abs() < 1e-6, "{x}: {light}");
        }
        let turned = [side(Vec3::ZERO, -Vec3::Y, 1.0), side(Vec3::X, Vec3::X, 3.0)];
        assert_eq!(
            mean_at(&turned, Vec3::new(1.0, 0.5, 0.5), Rule::InTheOpen),
            None,
            "none faces as it does"
        );
        assert_eq!(mean_at(&[], Vec3::ONE, Rule::InTheOpen), None);
        assert_eq!(mean_at(&[], Vec3::ONE, Rule::BesideWall), None);
    }

    #[test]
    fn sides_count_alike_wherever_they_stand_among_the_eight() {
        let place = Vec3::new(0.75, 0.5, 0.5);
        let few = [side(Vec3::ZERO, Vec3::Y, 1.0), side(Vec3::X, Vec3::Y, 3.0)];
        let away = side(Vec3::ZERO, -Vec3::Y, 9.0);
        let mut many = vec![away; 7];
        many.extend(few);
        assert_eq!(mean_at(&many, place, Rule::InTheOpen), mean_at(&few, place, Rule::InTheOpen));
    }

    #[test]
    fn beside_a_wall_sides_of_the_other_room_do_not_count() {
        let [here, there] = [1, 2].map(|group| Near { group, ..side(Vec3::ZERO, Vec3::Y, f32::from(group)) });
        let there = Near { offset: Vec3::X, ..there };
        for (x, expected) in [(0.6, 1.0), (0.99, 1.0), (1.01, 2.0)] {
            assert_eq!(
                mean_at(&[here, there], Vec3::new(x, 0.5, 0.5), Rule::BesideWall),
                Some(expected),
                "{x}"
            );
        }
        let through = Near { blocked: 1, ..here };
        assert_eq!(mean_at(&[through, there], Vec3::new(0.6, 0.5, 0.5), Rule::BesideWall), None);
        assert!(mean_at(&[through, there], Vec3::new(0.6, 0.5, 0.5), Rule::InTheOpen).is_some());
    }
}
