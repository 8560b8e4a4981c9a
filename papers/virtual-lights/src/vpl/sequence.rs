//! Quasi-random numbers of paths.

use argus_sampler::plug::mixed;

/// Bases of the Halton dimensions: choice of a light, position and direction on it, first reflections.
const BASES: [u32; 8] = [2, 3, 5, 7, 11, 13, 17, 19];

/// Numbers in 0..1 of one path. The first dimensions are a Halton sequence with a Cranley-Patterson rotation by the seed
/// (1976), the others SplitMix64.
pub(crate) struct Path {
    index: u32,
    seed: u64,
    dimension: usize,
}

impl Path {
    /// The numbers of the path with that index.
    pub(crate) fn new(index: u32, seed: u32) -> Self {
        Self { index, seed: u64::from(seed) << 32, dimension: 0 }
    }

    /// The number of the next dimension.
    pub(crate) fn next(&mut self) -> f64 {
        let dimension = self.dimension;
        self.dimension += 1;
        match BASES.get(dimension) {
            Some(&base) => (radical_inverse(self.index, base) + mixed(self.seed | dimension as u64)).fract(),
            None => mixed(self.seed ^ u64::from(self.index) << 8 ^ (dimension as u64 | 1 << 63)),
        }
    }
}

/// Radical inverse of a number.
fn radical_inverse(mut index: u32, base: u32) -> f64 {
    let (mut inverse, mut digit) = (0.0, 1.0 / f64::from(base));
    while index > 0 {
        inverse += f64::from(index % base) * digit;
        index /= base;
        digit /= f64::from(base);
    }
    inverse
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dimensions_are_even_and_seeds_differ() {
        for dimension in 0..12 {
            let values = |seed| {
                (0..4096).map(move |i| {
                    let mut path = Path::new(i, seed);
                    (0..dimension).for_each(|_| _ = path.next());
                    path.next()
                })
            };
            assert!(values(1).all(|x| (0.0..1.0).contains(&x)));
            let mean: f64 = values(1).sum::<f64>() / 4096.0;
            assert!((mean - 0.5).abs() < 0.02, "dimension {dimension}: {mean}");
            assert!(values(1).zip(values(2)).any(|(a, b)| a != b));
        }
    }
}
