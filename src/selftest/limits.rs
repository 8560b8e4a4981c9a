//! What images are held to, in one place. FLIP is a mean over all pixels, 0 equal to 1; PSNR is in decibels.
//!
//! All views are of the built-in terrain of 20,000 triangles, 160×120 pixels; the reference takes 16 samples a pixel. The
//! figures in brackets were measured on Mesa's software driver, the worst of two views. Limits lie so far from them that
//! another device's rounding passes, and a missing pass, a wrong surface or a wrong light does not.

/// A view from triangles at 16 samples a pixel: the bound that the sampler's own tests hold (0.001 to 0.004).
pub(super) const DIRECT_FLIP: f64 = 0.01;

/// The same view's PSNR.
pub(super) const DIRECT_PSNR_DB: f64 = 38.0;

/// Share of sub-samples in which two ways of seeing triangles may see different ones: edges, where roundings differ.
pub(super) const DIFFERING_IDS: f64 = 0.01;

/// Share of a sample's texels whose range may be off the reference's by more than a hundredth: texels on silhouettes, where
/// the surface that covers most of a texel need not be the one on its central ray.
pub(super) const SAMPLE_OFF: f64 = 0.05;

/// A view from four samples: what no sample resolves, and what fills holes, shows.
pub(super) const WARP_FLIP: f64 = 0.12;

/// The same view's PSNR.
pub(super) const WARP_PSNR_DB: f64 = 22.0;

/// Share of colour bytes in which a search's fragment and compute programs may differ. They share their source, so that the
/// software driver writes equal bytes; compilers of other devices may round the two differently.
pub(super) const DIFFERING_BYTES: f64 = 0.01;
