//! Encoding of maps' texels. In WGSL: `shaders/shared/map_texels.wgsl`.
//!
//! In every format the greater code is the nearer texel, so the result of several writes does not depend on their order.
//! An inverse range of fewer than 32 bits is an f32 without its lower bits, relative to the least representable value. A
//! stored range is never nearer than the rendered one, and storing it again is lossless.
//!
//! If texels have nodes, readers compute the range from the octree. Texels of 16 bits are written by compare-exchange,
//! because pairs reach a map in any order until the end of the frame.

use crate::hierarchy::HierarchyError;

/// Format of texels: inverse range (1/metres; 0 for none), and the visible node.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Texel {
    /// 64 bits: inverse range (f32) above the node's index.
    RangeAndNode,
    /// 32 bits: inverse range above the node's index. The index has as many bits as the octree needs.
    RangeAndNode32,
    /// 32 bits: inverse range (f32).
    Range,
    /// 16 bits: inverse range.
    Range16,
}

impl Texel {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::RangeAndNode, Self::RangeAndNode32, Self::Range, Self::Range16];

    /// Name in options and tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::RangeAndNode => "node-64",
            Self::RangeAndNode32 => "node-32",
            Self::Range => "range-32",
            Self::Range16 => "range-16",
        }
    }

    /// Bits of a texel.
    pub fn bits(self) -> u32 {
        match self {
            Self::RangeAndNode => 64,
            Self::RangeAndNode32 | Self::Range => 32,
            Self::Range16 => 16,
        }
    }

    /// Whether it has the visible node.
    pub fn names_nodes(self) -> bool {
        matches!(self, Self::RangeAndNode | Self::RangeAndNode32)
    }

    /// The lossless format with the same content.
    pub fn exact(self) -> Self {
        match self {
            Self::RangeAndNode | Self::RangeAndNode32 => Self::RangeAndNode,
            Self::Range | Self::Range16 => Self::Range,
        }
    }
}

/// Exponent bits of an inverse range of fewer than 32 bits: 16 octaves.
const EXPONENT_BITS: u32 = 4;
/// The farthest range of these octaves, edges of the scene's root. Farther ranges are stored at up to twice this range;
/// nearer ones than 2⁻¹² edges as 2⁻¹² edges.
const FARTHEST: f64 = 8.0;
/// Fewest bits of an inverse range.
const LEAST_BITS: u32 = 8;

/// Encoding of texels for one scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TexelCode {
    texel: Texel,
    /// Bits of a node's index in a texel of 32 bits; otherwise 0.
    node_bits: u32,
    /// Number of dropped lower bits of an f32.
    dropped: u32,
    /// Codes of the least and greatest representable inverse range, before the offset.
    least: u32,
    greatest: u32,
}

impl TexelCode {
    /// The encoding for a scene with `nodes` nodes and a root edge of `edge` metres.
    ///
    /// # Errors
    /// [`HierarchyError::OutOfRange`] if node indices leave too few bits for the range.
    pub fn new(texel: Texel, nodes: u32, edge: f64) -> Result<Self, HierarchyError> {
        let (node_bits, range_bits) = match texel {
            Texel::RangeAndNode | Texel::Range => {
                // The f32 is stored unchanged.
                return Ok(Self { texel, node_bits: 0, dropped: 0, least: 1, greatest: u32::MAX });
            }
            Texel::RangeAndNode32 => {
                let node_bits = nodes.saturating_sub(1).max(1).ilog2() + 1;
                (node_bits, 32 - node_bits)
            }
            Texel::Range16 => (0, 16),
        };
        if range_bits < LEAST_BITS {
            return Err(HierarchyError::OutOfRange {
                field: "nodes of an octree that texels of 32 bits name",
                range: format!("at most {}", 1u32 << (32 - LEAST_BITS)),
                value: nodes.to_string(),
            });
        }
        let dropped = (f32::MANTISSA_DIGITS - 1).saturating_sub(range_bits - EXPONENT_BITS);
        // A power of two, so that octaves are those of f32.
        let exponent = f32::INFINITY.to_bits();
        let least = (((1.0 / (FARTHEST * edge)) as f32).to_bits() & exponent).max(1 << 23) >> dropped;
        // All codes but 0, which is sky.
        let greatest = least + (1 << range_bits) - 2;
        Ok(Self { texel, node_bits, dropped, least, greatest: greatest.min((exponent >> dropped) - 1) })
    }

    /// The format.
    pub fn texel(&self) -> Texel {
        self.texel
    }

    /// Greatest relative error of a stored inverse range, for ranges between 2⁻¹² and 8 edges of the scene's root. 0 if
    /// lossless.
    pub fn step(&self) -> f64 {
        match self.dropped {
            0 => 0.0,
            dropped => (f64::from(dropped) - f64::from(f32::MANTISSA_DIGITS - 1)).exp2(),
        }
    }

    /// The code of an inverse range (1/metres, finite, at least 0).
    pub fn encode(&self, inverse_range: f32) -> u32 {
        if inverse_range == 0.0 {
            return 0;
        }
        (inverse_range.to_bits() >> self.dropped).clamp(self.least, self.greatest) - self.least + 1
    }

    /// The inverse range of a code, 1/metres.
    pub fn decode(&self, code: u32) -> f32 {
        if code == 0 { 0.0 } else { f32::from_bits((code - 1 + self.least) << self.dropped) }
    }

    /// Bytes of `texels` texels, an even number.
    pub(super) fn bytes(&self, texels: u64) -> u64 {
        texels * u64::from(self.texel.bits()) / 8
    }

    /// Decodes words: inverse range (f32 bits) and node (or 0) of each texel.
    pub(super) fn unpack(&self, words: &[u32]) -> Vec<[u32; 2]> {
        let range = |code: u32| self.decode(code).to_bits();
        match self.texel {
            Texel::RangeAndNode => words.chunks_exact(2).map(|texel| [range(texel[1]), texel[0]]).collect(),
            Texel::RangeAndNode32 | Texel::Range => {
                let node = (1u32 << self.node_bits) - 1;
                words.iter().map(|texel| [range(texel >> self.node_bits), texel & node]).collect()
            }
            Texel::Range16 => words
                .iter()
                .flat_map(|pair| [pair & 0xffff, pair >> 16].map(|code| [range(code), 0]))
                .collect(),
        }
    }

    /// Values for the `override`s of `shaders/shared/map_texels.wgsl`, maps being spread over so many arrays.
    pub(super) fn constants(&self, arrays: usize) -> [(&'static str, f64); 7] {
        [
            ("arrays", arrays as f64),
            ("texel_bits", f64::from(self.texel.bits())),
            ("names_nodes", f64::from(u8::from(self.texel.names_nodes()))),
            ("node_bits", f64::from(self.node_bits)),
            ("dropped_bits", f64::from(self.dropped)),
            ("least_code", f64::from(self.least)),
            ("greatest_code", f64::from(self.greatest)),
        ]
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)] // a test ends at the first thing that goes wrong

    use super::*;

    /// Codes of few bits, for small scenes and for large ones.
    fn coarse() -> impl Iterator<Item = (TexelCode, f64)> {
        [0.01, 1.0, 37.25, 1e6].into_iter().flat_map(|edge| {
            [(Texel::Range16, 1), (Texel::RangeAndNode32, 100), (Texel::RangeAndNode32, 1 << 24)]
                .map(|(texel, nodes)| (TexelCode::new(texel, nodes, edge).unwrap(), edge))
        })
    }

    #[test]
    fn what_is_stored_is_further_by_less_than_a_step_and_in_the_same_order() {
        for (code, edge) in coarse() {
            let mut before = 0;
            // From 8 edges away to 2^-12 of one.
            for i in 0..=15_000 {
                let range = 8.0 * edge * (-f64::from(i) / 1000.0).exp2();
                let inverse = (1.0 / range) as f32;
                let stored = code.encode(inverse);
                let back = code.decode(stored);
                assert!(
                    back <= inverse && f64::from(back) > f64::from(inverse) * (1.0 - code.step()),
                    "{range}"
                );
                assert_eq!(code.encode(back), stored, "once stored, it stays");
                assert!(stored >= before, "{range}");
                before = stored;
            }
        }
    }

    #[test]
    fn what_is_nearer_or_further_than_codes_tell_is_finite_and_not_the_sky() {
        for (code, _) in coarse() {
            for inverse in [f32::MIN_POSITIVE, 1e-37, 1e37, f32::MAX] {
                let back = code.decode(code.encode(inverse));
                assert!(back > 0.0 && back.is_finite(), "{inverse} {back}");
            }
            assert_eq!(code.encode(0.0), 0);
            assert_eq!(code.decode(0), 0.0);
            let bits = if code.texel == Texel::Range16 { 16 } else { 32 - code.node_bits };
            assert!(u64::from(code.encode(f32::MAX)) < 1 << bits);
        }
    }

    #[test]
    fn whole_ranges_are_stored_as_they_are() {
        for texel in [Texel::Range, Texel::RangeAndNode] {
            let code = TexelCode::new(texel, u32::MAX, 3.0).unwrap();
            assert_eq!(code.step(), 0.0);
            for inverse in [0.0, 1e-37, 0.3, 1e37] {
                assert_eq!(code.encode(inverse), inverse.to_bits());
                assert_eq!(code.decode(inverse.to_bits()), inverse);
            }
        }
    }

    #[test]
    fn nodes_have_as_many_bits_as_they_need_and_too_many_are_refused() {
        let bits = |nodes| TexelCode::new(Texel::RangeAndNode32, nodes, 1.0).unwrap().node_bits;
        assert_eq!([1, 2, 3, 4, 5, 1 << 24].map(bits), [1, 1, 2, 2, 3, 24]);
        let error = TexelCode::new(Texel::RangeAndNode32, (1 << 24) + 1, 1.0).unwrap_err();
        assert!(error.to_string().contains("at most 16777216, not 16777217"), "{error}");
    }
}
