//! The inputs of a view that is computed on the processor.

use argus_scene::{Outputs, RenderError};

use super::{ChunkOffsets, PreparedView, level_of};
use crate::cull::spacings;
use crate::host::{HostInputs, HostSource};
use crate::layout::{Piece, Rect};

impl PreparedView {
    /// What the view is computed from on the processor.
    ///
    /// # Errors
    /// [`RenderError::Internal`] for a view without samples.
    pub(crate) fn host_inputs(&self, outputs: Outputs) -> Result<HostInputs<'_>, RenderError> {
        let none = || RenderError::Internal("a view from frames has none".to_owned());
        let lighting = &self.samples.first().ok_or_else(none)?.info.lighting;
        let [width, height] = self.geometry.size.to_array().map(|sub_pixels| sub_pixels as u32 / self.side);
        let piece =
            Piece { view: 0, part: Rect { x: 0, y: 0, width, height }, target: [0, 0], side: self.side };
        let view = self.uniform(&piece, &ChunkOffsets::default());
        let mut blocks = Vec::new();
        let splats = self.splats(&piece, 0, &mut blocks);
        let sources =
            self.samples.iter().zip(view.samples).enumerate().filter_map(|(index, (held, sample))| {
                let tiles = self.sources.iter().filter(|source| source.sample == index);
                // A frame that is not splatted is read like one at the distance of the view's eye.
                let [dense, sparse] = match tiles.clone().next() {
                    Some(_) => spacings(tiles.flat_map(|source| &source.tiles), self.geometry.size),
                    None => [1.0 / f64::from(self.footprint_in(held)); 2],
                };
                let level = level_of(sparse) as usize;
                Some(HostSource {
                    sample,
                    frame: held.host()?,
                    footprint: self.footprint_in(held),
                    level,
                    between: level_of(dense) > level as f64,
                })
            });
        Ok(HostInputs {
            view,
            sources: sources.collect(),
            splats,
            blocks,
            fill: self.fill(&piece, 0),
            lighting,
            side: self.side,
            linear: self.linear,
            outputs,
        })
    }
}
