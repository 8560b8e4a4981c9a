//! What a user may turn; none of it shows in a frame's bytes but [`CompositorKnobs::splat_samples`] and, of views that come with
//! a history, [`CompositorKnobs::max_reprojections`].

/// How a compositor works.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CompositorKnobs {
    /// The first this many samples of a plan leave their depth in the view; all of them are fetched from.
    pub splat_samples: usize,
    /// Sub-pixels on a side of the pieces that a large view is worked off in.
    pub piece_side: u32,
    /// Sub-pixels that are worked on at once, in one submission.
    pub chunk_pixels: u64,
    /// Bytes of device memory that samples may fill.
    pub max_sample_bytes: u64,
    /// Frames that begin one from the other before one begins at the samples again: what a search missed, those after it
    /// miss, too.
    pub max_reprojections: u32,
    /// Which of the two programs of a search draws.
    pub search_backend: SearchBackend,
    /// A slice of taking samples up ends at the first step that ends after so many milliseconds.
    pub slice_ms: f64,
}

/// Which of the two programs of a search draws: they share the function that finds a pixel, and write equal bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum SearchBackend {
    /// Both in turn until it is known which is the faster on this device, then that one.
    #[default]
    Auto,
    /// The fragment program.
    Fragment,
    /// The compute program: on data-centre GPUs only a few multiprocessors run graphics work.
    Compute,
}

impl Default for CompositorKnobs {
    fn default() -> Self {
        Self {
            splat_samples: 2,
            piece_side: 2048,
            chunk_pixels: 4 << 20,
            max_sample_bytes: 4 << 30,
            // `argus study history`: views of terrain err less than from samples after 5 (FLIP 0.079 and 0.081), and
            // more after 8 (0.082).
            max_reprojections: 6,
            search_backend: SearchBackend::Auto,
            // With the step after which it ends, a slice is about as long as a direct view of 320×240.
            slice_ms: 8.0,
        }
    }
}
