//! Vectors of eight floats: AVX2 if the processor has it, otherwise plain arrays. Both give the same bits.
//!
//! Multiplications and additions are never fused, because not every processor can. Everything is inlined into functions
//! of `mod.rs` that are compiled for AVX2; elsewhere each instruction would be a call.

#[cfg(target_arch = "x86_64")]
pub(crate) mod avx2;

use std::ops::{Add, Mul, Sub};

/// Floats of a vector.
pub(crate) const LANES: usize = 8;

/// One float a ray.
pub(crate) trait Lanes: Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> {
    /// One bool a ray.
    type Mask: Mask;

    fn from_array(lanes: [f32; LANES]) -> Self;
    fn to_array(self) -> [f32; LANES];
    fn splat(x: f32) -> Self;
    /// The smaller; the second if one is NaN.
    fn min(self, other: Self) -> Self;
    /// The larger; the second if one is NaN.
    fn max(self, other: Self) -> Self;
    fn div(self, other: Self) -> Self;
    /// `self <= other`; false for NaN.
    fn le(self, other: Self) -> Self::Mask;
    fn lt(self, other: Self) -> Self::Mask;
    fn eq(self, other: Self) -> Self::Mask;
    /// `other` where the mask is set.
    fn replaced(self, mask: Self::Mask, other: Self) -> Self;
}

/// One bool a ray.
pub(crate) trait Mask: Copy {
    fn none() -> Self;
    fn and(self, other: Self) -> Self;
    fn or(self, other: Self) -> Self;
    /// `self & !other`.
    fn without(self, other: Self) -> Self;
    /// One bit a lane, starting with the lowest.
    fn bits(self) -> u32;
    fn from_bits(bits: u32) -> Self;

    #[inline(always)]
    fn any(self) -> bool {
        self.bits() != 0
    }
}

/// For any processor.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Plain([f32; LANES]);

/// One bit a lane.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Bits(u32);

impl Plain {
    #[inline(always)]
    fn each(self, other: Self, f: impl Fn(f32, f32) -> f32) -> Self {
        let mut lanes = self.0;
        for (lane, other) in lanes.iter_mut().zip(other.0) {
            *lane = f(*lane, other);
        }
        Self(lanes)
    }

    #[inline(always)]
    fn compare(self, other: Self, f: impl Fn(f32, f32) -> bool) -> Bits {
        let lanes = (0..LANES).map(|i| u32::from(f(self.0[i], other.0[i])) << i);
        Bits(lanes.sum())
    }
}

impl Add for Plain {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.each(other, |a, b| a + b)
    }
}

impl Sub for Plain {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self.each(other, |a, b| a - b)
    }
}

impl Mul for Plain {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        self.each(other, |a, b| a * b)
    }
}

impl Lanes for Plain {
    type Mask = Bits;

    #[inline(always)]
    fn from_array(lanes: [f32; LANES]) -> Self {
        Self(lanes)
    }

    #[inline(always)]
    fn to_array(self) -> [f32; LANES] {
        self.0
    }

    #[inline(always)]
    fn splat(x: f32) -> Self {
        Self([x; LANES])
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        self.each(other, |a, b| if a < b { a } else { b })
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        self.each(other, |a, b| if a > b { a } else { b })
    }

    #[inline(always)]
    fn div(self, other: Self) -> Self {
        self.each(other, |a, b| a / b)
    }

    #[inline(always)]
    fn le(self, other: Self) -> Bits {
        self.compare(other, |a, b| a <= b)
    }

    #[inline(always)]
    fn lt(self, other: Self) -> Bits {
        self.compare(other, |a, b| a < b)
    }

    #[inline(always)]
    #[allow(clippy::float_cmp, reason = "ties are exact")]
    fn eq(self, other: Self) -> Bits {
        self.compare(other, |a, b| a == b)
    }

    #[inline(always)]
    fn replaced(self, mask: Bits, other: Self) -> Self {
        let mut lanes = self.0;
        for (i, lane) in lanes.iter_mut().enumerate() {
            *lane = if mask.0 >> i & 1 == 1 { other.0[i] } else { *lane };
        }
        Self(lanes)
    }
}

impl Mask for Bits {
    #[inline(always)]
    fn none() -> Self {
        Self(0)
    }

    #[inline(always)]
    fn and(self, other: Self) -> Self {
        Self(self.0 & other.0)
    }

    #[inline(always)]
    fn or(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    #[inline(always)]
    fn without(self, other: Self) -> Self {
        Self(self.0 & !other.0)
    }

    #[inline(always)]
    fn bits(self) -> u32 {
        self.0
    }

    #[inline(always)]
    fn from_bits(bits: u32) -> Self {
        Self(bits)
    }
}
