//! Limits of the image checks. FLIP is a mean over all pixels, 0 for equal images; PSNR is in dB.
//!
//! All views show the built-in terrain of 20,000 triangles at 160×120 pixels; the reference takes 16 samples a pixel.
//! Figures in brackets were measured on Mesa's software driver, as the worse of two views. The limits are wide enough
//! for another device's rounding, but not for a missing pass, a wrong surface or wrong light.

/// FLIP of a view from triangles at 16 samples a pixel: the limit of the sampler's own tests (0.001 to 0.004).
pub(super) const DIRECT_FLIP: f64 = 0.01;

/// PSNR of a view from triangles.
pub(super) const DIRECT_PSNR_DB: f64 = 38.0;

/// Share of sub-samples whose triangle may differ between two visibility backends: edges, where rounding differs.
pub(super) const DIFFERING_IDS: f64 = 0.01;

/// Share of a sample's texels whose range may differ from the reference by more than 1%. On silhouettes, the surface that
/// covers most of a texel may not be the one on its central ray.
pub(super) const SAMPLE_OFF: f64 = 0.05;

/// FLIP of a view from four samples, including unresolved pixels and filled holes.
pub(super) const WARP_FLIP: f64 = 0.12;

/// PSNR of a view from four samples.
pub(super) const WARP_PSNR_DB: f64 = 22.0;

/// Share of colour bytes that may differ between a search's fragment and compute programs. They share their source,
/// and the software driver gives equal bytes; other compilers may round differently.
pub(super) const DIFFERING_BYTES: f64 = 0.01;
