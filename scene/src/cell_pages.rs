//! Pages of light cells, which workers send one another.

use bytes::Bytes;

use crate::InvalidField;

/// Names what light cells are of: a scene's pose, its lighting, and how surfaces exchange light. Cells of equal names have equal values.
pub type CellContent = [u8; 32];

/// A page of 8³ cells, by its place in the lattice: a number that is the same in all processes.
pub type CellPage = u64;

/// The pages of a sampler's light cells. Other threads than the sampler's read and add them.
pub trait CellPages: Send + Sync {
    /// What the cells are of; `None` before any was looked up, and where cells cannot be named.
    fn content(&self) -> Option<CellContent>;

    /// Up to `most` pages of cells that views lack, newest first. The sampler does not fill them until they are [added](Self::add) or
    /// [given up](Self::give_up), or a few seconds have passed. A page is not named again for some seconds.
    fn wanted(&self, most: usize) -> Vec<CellPage>;

    /// The cells held of those pages, packed; of each page that has any. None if the cells are of other content.
    fn packed(&self, content: CellContent, pages: &[CellPage]) -> Vec<(CellPage, Bytes)>;

    /// Adds cells that another sampler packed. Cells of other content are left out.
    ///
    /// # Errors
    /// What is wrong with the bytes. No cell of them is added then.
    fn add(&self, content: CellContent, page: CellPage, packed: &[u8]) -> Result<(), InvalidField>;

    /// Has the sampler fill pages itself that it awaits.
    fn give_up(&self, pages: &[CellPage]);
}
