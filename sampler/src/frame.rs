//! A frame: an image on its way through the stages that shade and light it. Their list is in [`crate::stages`].

use argus_gpu::{Commands, GpuError, PendingReadback, Submitted, wgpu};
use argus_scene::{Cancel, RenderError, Stage};
use bytes::Bytes;

use crate::passes::TileContext;
use crate::scratch::GBuffer;
use crate::tile::Tile;
use crate::timing;

/// An image that is being rendered: a part of a view or sample, layers of one, or points on surfaces.
pub struct Frame<'a> {
    /// The scene, the eye, the tile and its targets.
    pub context: TileContext<'a>,
    /// Which sub-samples share light.
    pub sharing: LightSharing,
    /// What the sub-samples stand for on surfaces.
    pub footprint: Footprint,
    /// Whether light that depends on the viewer is added, too.
    pub(crate) is_view: bool,
    /// What is recorded since the last submission.
    pub commands: Commands,
    /// Times of stages so far.
    pub stages: &'a mut Vec<Stage>,
    /// [`crate::lit_tile::Arriving`] of each sub-sample, once direct light by rays is added.
    pub(crate) arriving: Option<wgpu::Buffer>,
    /// Whether the frame may be rendered again once it is finished, so that what light cells it lacked is read with it.
    pub(crate) may_wait: bool,
    /// [`crate::lit_cells::CellOutcome`] that is read with the finished image.
    pub(crate) outcome: Option<wgpu::Buffer>,
}

impl<'a> Frame<'a> {
    /// A frame without light that depends on the viewer, whose first commands have this label.
    pub fn new(
        context: TileContext<'a>,
        sharing: LightSharing,
        label: &str,
        stages: &'a mut Vec<Stage>,
    ) -> Self {
        let commands = context.gpu.commands(label);
        let footprint = Footprint::Pixels;
        Self {
            context,
            sharing,
            footprint,
            is_view: false,
            commands,
            stages,
            arriving: None,
            may_wait: false,
            outcome: None,
        }
    }

    /// Submits what is recorded and waits for it. Later stages record commands with a label.
    ///
    /// # Errors
    /// The errors of the device.
    pub fn submit_and_wait(&mut self, label: &str) -> Result<(), GpuError> {
        self.read_back([], label).map(|[]| ())
    }

    /// Submits what is recorded and waits for it.
    ///
    /// # Errors
    /// The errors of the device.
    pub(crate) fn finish(self) -> Result<(), GpuError> {
        timing::add(self.stages, self.commands.submit().wait()?.stages);
        Ok(())
    }

    /// Submits what is recorded, waits for it, and returns the first bytes of buffers. Later stages record commands with a label.
    ///
    /// # Errors
    /// The errors of the device.
    pub fn read_back<const N: usize>(
        &mut self,
        buffers: [(&wgpu::Buffer, u64); N],
        label: &str,
    ) -> Result<[Bytes; N], GpuError> {
        let pending = buffers.map(|(buffer, bytes)| self.commands.read_buffer(buffer, 0..bytes));
        let commands = std::mem::replace(&mut self.commands, self.context.gpu.commands(label));
        let mut finished = commands.submit().wait()?;
        timing::add(self.stages, std::mem::take(&mut finished.stages));
        Ok(pending.map(|pending| finished.take(pending)))
    }

    /// Submits what is recorded, with reads of the first bytes of buffers. Later stages record commands with a label.
    pub(crate) fn begin_read(&mut self, buffers: &[(&wgpu::Buffer, u64)], label: &str) -> BegunRead {
        let pending =
            buffers.iter().map(|(buffer, bytes)| self.commands.read_buffer(buffer, 0..*bytes)).collect();
        let commands = std::mem::replace(&mut self.commands, self.context.gpu.commands(label));
        BegunRead { pending, submitted: commands.submit() }
    }

    /// Waits for a read.
    ///
    /// # Errors
    /// The errors of the device.
    pub(crate) fn end_read(&mut self, begun: BegunRead) -> Result<Vec<Bytes>, GpuError> {
        let mut finished = begun.submitted.wait()?;
        timing::add(self.stages, std::mem::take(&mut finished.stages));
        Ok(begun.pending.into_iter().map(|pending| finished.take(pending)).collect())
    }

    /// Number of sub-samples.
    pub(crate) fn sub_samples(&self) -> u64 {
        self.context.tile.sub_samples().map(u64::from).iter().product()
    }

    /// Reads the G-buffer back: surfaces and materials, 16 bytes a sub-sample each.
    pub(crate) fn read_g_buffer(&mut self, g_buffer: &GBuffer, label: &str) -> Result<[Bytes; 2], GpuError> {
        let bytes = self.sub_samples() * 16;
        self.read_back([(&g_buffer.surfaces, bytes), (&g_buffer.materials, bytes)], label)
    }

    /// Which sub-samples know one another, for direct light.
    pub(crate) fn neighbours(&self) -> Neighbours {
        self.sharing.neighbours(&self.context.tile)
    }

    /// Whether indirect light may be looked up in light cells. Their level follows from what a sub-sample stands for.
    pub(crate) fn uses_cells(&self) -> bool {
        let is_image = self.is_view || matches!(self.sharing, LightSharing::Texels { .. });
        is_image || self.footprint != Footprint::Pixels
    }
}

/// A read that was submitted.
pub(crate) struct BegunRead {
    pending: Vec<PendingReadback>,
    submitted: Submitted,
}

/// What sub-samples stand for on surfaces.
#[derive(Debug, Clone, PartialEq)]
pub enum Footprint {
    /// What pixels show from the eye.
    Pixels,
    /// Areas of points that were found from elsewhere. The mean side of each, metres; 0 where there is no point.
    Areas(Vec<f32>),
    /// Areas of this side, metres.
    Equal(f32),
}

/// Which sub-samples of a tile share received light.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LightSharing {
    /// Neighbours in an image.
    Image,
    /// Neighbours in a sample. Its texels have `side` sub-samples along each side.
    Texels {
        /// Sub-samples along each side of a texel.
        side: u32,
    },
    /// Sub-samples of one pixel, because neighbours in a list are not neighbours in the view.
    Pixels,
    /// Consecutive leaves of a list, which are neighbours in space.
    Leaves,
    /// Nothing is shared.
    Each,
}

impl LightSharing {
    /// The texels of a tile that know one another, for direct light.
    pub(crate) fn neighbours(self, tile: &Tile) -> Neighbours {
        match self {
            Self::Image | Self::Texels { .. } => Neighbours::Image(tile.begin.map(|texel| texel * tile.side)),
            Self::Pixels => Neighbours::None { rays: 64 },
            Self::Leaves | Self::Each => Neighbours::None { rays: 16 },
        }
    }

    /// Size of the blocks that share receivers, in sub-samples, and the reach of a receiver, in blocks. `block` is the
    /// block side in an image; `side` is the number of sub-samples along a pixel's side.
    pub fn blocks(self, block: u32, side: u32) -> ([u32; 2], u32) {
        match self {
            Self::Image => ([block, block], 1),
            // Receivers are as far apart as if sub-samples were lit.
            Self::Texels { side } => ([(block / side).max(1); 2], 1),
            Self::Pixels => ([side, side], 0),
            Self::Leaves => ([16, 1], 1),
            Self::Each => ([1, 1], 0),
        }
    }
}

/// Which of a tile's texels know one another.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Neighbours {
    /// An image, whose first texel has these coordinates in the whole image.
    Image([u32; 2]),
    /// Texels that have nothing to do with one another: each casts so many rays to the sky, and to emitters.
    None { rays: usize },
}

/// Fails once a job is cancelled.
pub(crate) fn check_wanted(cancel: &Cancel) -> Result<(), RenderError> {
    if cancel.is_cancelled() { Err(RenderError::Cancelled) } else { Ok(()) }
}
