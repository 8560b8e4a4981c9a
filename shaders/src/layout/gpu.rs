//! Mirrors of structs of `shaders/gpu/*.wgsl`: hierarchies and their traversals.

use super::Mirror;

/// All mirrors of this file.
pub(super) const MIRRORS: &[Mirror] = &[Digit::MIRROR, ListStep::MIRROR, Scatter::MIRROR];

mirror! {
    /// One digit of a radix sort: `gpu/sort.wgsl`.
    pub struct Digit {
        /// Number of keys.
        pub count: u32,
        /// Number of runs of keys.
        pub runs: u32,
        /// Lowest bit of the digit.
        pub shift: u32,
    }
}

mirror! {
    /// One step of a list: `gpu/list_scan.wgsl`.
    pub struct ListStep {
        /// Index of the list.
        pub list: u32,
        /// Level of sums: 0 is the list itself.
        pub level: u32,
        /// Most elements of the list.
        pub capacity: u32,
        /// Index of the word that has its length.
        pub word: u32,
        /// What is added to that.
        pub more: u32,
    }
}

mirror! {
    /// Atomics at pseudo-random words: `gpu/scattered_atomics.wgsl`.
    pub struct Scatter {
        /// Number of words of the buffer, of 32 or 64 bits.
        pub words: u32,
        /// Seed of the words, different in each dispatch.
        pub seed: u32,
    }
}
