//! Vectors of AVX2. Only to be used in functions that run where AVX2 was found: that is what makes the calls sound.

use std::arch::x86_64::*;

use super::{Add, LANES, Lanes, Mask, Mul, Sub};

#[derive(Debug, Clone, Copy)]
pub(crate) struct Avx2(__m256);

/// All bits of a lane are set, or none.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Wide(__m256);

/// Calls an instruction.
macro_rules! call {
    ($($instruction:tt)*) => {
        // SAFETY: the processor has AVX2, see the module's first line.
        unsafe { $($instruction)* }
    };
}

impl Add for Avx2 {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self(call!(_mm256_add_ps(self.0, other.0)))
    }
}

impl Sub for Avx2 {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self(call!(_mm256_sub_ps(self.0, other.0)))
    }
}

impl Mul for Avx2 {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        Self(call!(_mm256_mul_ps(self.0, other.0)))
    }
}

impl Lanes for Avx2 {
    type Mask = Wide;

    #[inline(always)]
    fn from_array(lanes: [f32; LANES]) -> Self {
        Self(call!(_mm256_loadu_ps(lanes.as_ptr())))
    }

    #[inline(always)]
    fn to_array(self) -> [f32; LANES] {
        let mut lanes = [0.0; LANES];
        call!(_mm256_storeu_ps(lanes.as_mut_ptr(), self.0));
        lanes
    }

    #[inline(always)]
    fn splat(x: f32) -> Self {
        Self(call!(_mm256_set1_ps(x)))
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        Self(call!(_mm256_min_ps(self.0, other.0)))
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        Self(call!(_mm256_max_ps(self.0, other.0)))
    }

    #[inline(always)]
    fn div(self, other: Self) -> Self {
        Self(call!(_mm256_div_ps(self.0, other.0)))
    }

    #[inline(always)]
    fn le(self, other: Self) -> Wide {
        Wide(call!(_mm256_cmp_ps::<_CMP_LE_OQ>(self.0, other.0)))
    }

    #[inline(always)]
    fn lt(self, other: Self) -> Wide {
        Wide(call!(_mm256_cmp_ps::<_CMP_LT_OQ>(self.0, other.0)))
    }

    #[inline(always)]
    fn eq(self, other: Self) -> Wide {
        Wide(call!(_mm256_cmp_ps::<_CMP_EQ_OQ>(self.0, other.0)))
    }

    #[inline(always)]
    fn replaced(self, mask: Wide, other: Self) -> Self {
        Self(call!(_mm256_blendv_ps(self.0, other.0, mask.0)))
    }
}

impl Mask for Wide {
    #[inline(always)]
    fn none() -> Self {
        Self(call!(_mm256_setzero_ps()))
    }

    #[inline(always)]
    fn and(self, other: Self) -> Self {
        Self(call!(_mm256_and_ps(self.0, other.0)))
    }

    #[inline(always)]
    fn or(self, other: Self) -> Self {
        Self(call!(_mm256_or_ps(self.0, other.0)))
    }

    #[inline(always)]
    fn without(self, other: Self) -> Self {
        Self(call!(_mm256_andnot_ps(other.0, self.0)))
    }

    #[inline(always)]
    fn bits(self) -> u32 {
        call!(_mm256_movemask_ps(self.0)) as u32
    }

    #[inline(always)]
    fn from_bits(bits: u32) -> Self {
        let one = call!(_mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128));
        let masked = call!(_mm256_and_si256(_mm256_set1_epi32(bits as i32), one));
        Self(call!(_mm256_castsi256_ps(_mm256_cmpeq_epi32(masked, one))))
    }
}

#[cfg(test)]
mod tests {
    use super::super::Plain;
    use super::*;

    /// Bits of what each operation makes of some numbers, odd ones among them.
    fn results<L: Lanes>() -> Vec<u32> {
        let a = L::from_array([1.5, -2.0, 0.0, -0.0, f32::NAN, f32::INFINITY, 3e38, 1e-40]);
        let b = L::from_array([0.1, -2.0, -0.0, 0.0, 1.0, f32::NEG_INFINITY, 2.5, f32::NAN]);
        let values = [a + b, a - b, a * b, a.div(b), a.min(b), a.max(b), L::splat(7.0)];
        let masks =
            [a.le(b), a.lt(b), a.eq(b), a.le(b).and(a.lt(b)), a.le(b).or(b.le(a)), a.le(b).without(a.eq(b))];
        let replaced = masks.map(|mask| a.replaced(L::Mask::from_bits(mask.bits()), b));
        // The payload of a NaN does not matter.
        let bits = |x: f32| if x.is_nan() { u32::MAX } else { x.to_bits() };
        let lanes = values.into_iter().chain(replaced).flat_map(|v| v.to_array().map(bits));
        lanes.chain(masks.map(Mask::bits)).chain([L::Mask::none().bits()]).collect()
    }

    #[test]
    fn both_kinds_of_lanes_find_the_same_bits() {
        if is_x86_feature_detected!("avx2") {
            assert_eq!(results::<Avx2>(), results::<Plain>());
        }
    }
}
