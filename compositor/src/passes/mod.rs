//! The passes, one file each. The first line of a file names its program.

pub(crate) mod bounds;
pub(crate) mod build_pyramid;
pub(crate) mod fill;
pub(crate) mod highlight;
pub(crate) mod mips;
pub(crate) mod reproject;
pub(crate) mod resolve;
pub(crate) mod second_pass;
pub(crate) mod sky_mask;
pub(crate) mod splat;
