//! Hierarchies against the same on the CPU, in f64.
#![allow(clippy::unwrap_used)] // a test ends at the first thing that goes wrong

mod octree;
mod oracle;
mod sort;
mod spheres;

use crate::{gpu, read};

/// Numbers that look random, the same every time (splitmix64).
struct Numbers(u64);

impl Numbers {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let x = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        x ^ (x >> 31)
    }

    /// In 0..1.
    fn unit(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1u64 << 53) as f64
    }

    fn point(&mut self) -> glam::DVec3 {
        glam::DVec3::new(self.unit(), self.unit(), self.unit())
    }
}
