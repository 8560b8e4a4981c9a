//! Settings of the compositor. Only [`CompositorSettings::splat_samples`] and, for views with a history,
//! [`CompositorSettings::max_reprojections`] change the bytes of frames.

/// Settings of a compositor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CompositorSettings {
    /// Number of samples that are splatted, from the start of the plan's list. Colours are fetched from all samples.
    pub splat_samples: usize,
    /// Sub-pixels on a side of the pieces that large views are cut into.
    pub piece_side: u32,
    /// Most sub-pixels of one submission.
    pub chunk_pixels: u64,
    /// Most bytes of device memory for samples.
    pub max_sample_bytes: u64,
    /// Frames in a row that may start from the previous frame. Errors of a search persist in reprojected frames, so the
    /// next frame starts from samples again.
    pub max_reprojections: u32,
    /// The program that searches run as.
    pub search_backend: SearchBackend,
    /// Milliseconds after which a slice of uploading samples ends, at the end of its current step.
    pub slice_ms: f64,
}

/// The program that a search runs as. Both share the function that computes a pixel, and write equal bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum SearchBackend {
    /// Times both programs on real batches, then uses the faster one.
    #[default]
    Auto,
    /// The fragment program.
    Fragment,
    /// The compute program. On data-centre GPUs only a few multiprocessors run graphics work.
    Compute,
}

impl Default for CompositorSettings {
    fn default() -> Self {
        Self {
            splat_samples: 2,
            piece_side: 2048,
            chunk_pixels: 4 << 20,
            max_sample_bytes: 4 << 30,
            // `argus-lab study views reprojection`, terrain: FLIP is 0.081 from samples, 0.079 after 5 reprojections, 0.082 after 8.
            max_reprojections: 6,
            search_backend: SearchBackend::Auto,
            // With its last step a slice takes about as long as a direct view of 320×240 pixels.
            slice_ms: 8.0,
        }
    }
}
