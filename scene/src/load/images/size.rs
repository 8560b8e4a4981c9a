//! The size of an image.

/// Texels of an image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::load) struct Size {
    pub(in crate::load) width: u32,
    pub(in crate::load) height: u32,
}

impl Size {
    pub(super) fn texels(self) -> u64 {
        u64::from(self.width) * u64::from(self.height)
    }
}
