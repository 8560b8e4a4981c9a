//! Uploads a sample into texture arrays, in steps of a few milliseconds.
//!
//! Uploading a sample of 6×512² texels at once delayed views by 0.1 to 0.25 s on the software driver. So the work is a
//! list of steps of at most [`STEP_TEXELS`]: copy rows of planes, make rows of the display plane and of the coarser
//! levels, bound the tiles of each face. Several steps share a submission.

use std::collections::VecDeque;
use std::ops::Range;
use std::sync::{Arc, Weak};

use argus_gpu::{Commands, Gpu, PendingReadback, plane};
use argus_scene::camera::Face;
use argus_scene::{PlaneKind, RenderError, Sample, SampleId, SampleSetInfo};

use crate::cull::FaceTiles;
use crate::passes::bounds::BoundsPass;
use crate::passes::mips::{MipScratch, MipsPass};
use crate::pool::Pool;
use crate::settings::CompositorSettings;

/// Most texels of a step. Bounding the tiles of a face is one step.
const STEP_TEXELS: u32 = 1 << 18;

/// Device, passes and settings of an upload.
#[derive(Debug, Clone, Copy)]
pub(crate) struct UploadContext<'a> {
    pub(crate) gpu: &'a Arc<Gpu>,
    pub(crate) bounds: &'a BoundsPass,
    pub(crate) mips: &'a MipsPass,
    pub(crate) settings: &'a CompositorSettings,
}

/// A sample that is being uploaded.
#[derive(Debug)]
pub(crate) struct SampleUpload {
    pub(crate) info: Arc<SampleSetInfo>,
    /// The upload is abandoned once the sample is dropped elsewhere.
    pub(crate) sample: Weak<Sample>,
    /// Index of its pool.
    pub(crate) pool: usize,
    pub(crate) layer: u32,
    pub(crate) faces: Vec<Face>,
    /// One entry a face; empty until it is bounded.
    pub(crate) tiles: Vec<FaceTiles>,
    left: VecDeque<Step>,
    scratch: Option<MipScratch>,
}

/// One step of an upload.
#[derive(Debug, Clone, PartialEq)]
enum Step {
    /// Copies rows of a plane into the layer.
    Copy(PlaneKind, Range<u32>),
    /// Makes rows of the finest level of the display plane.
    DisplayRows(Range<u32>),
    /// Makes rows of a coarser level of radiance and of the display plane.
    Coarser(u32, Range<u32>),
    /// Bounds the tiles of a face.
    Bounds(usize),
}

/// Steps that are recorded and not yet submitted.
#[derive(Debug)]
pub(crate) struct Submission {
    commands: Commands,
    /// Work recorded so far, in units of one copied texel.
    pub(crate) weight: u64,
    bounds: Vec<(SampleId, usize, PendingReadback)>,
}

impl Submission {
    pub(crate) fn new(gpu: &Arc<Gpu>) -> Self {
        Self { commands: gpu.commands("hold samples"), weight: 0, bounds: Vec::new() }
    }

    /// Completes the steps. Returns the tile bounds by sample and face, in the format of [`BoundsPass`].
    ///
    /// # Errors
    /// Whatever the device fails with.
    pub(crate) fn finish(self) -> Result<Vec<(SampleId, usize, Vec<u8>)>, RenderError> {
        let mut finished = self.commands.submit().wait()?;
        let bounds = self.bounds.into_iter();
        Ok(bounds.map(|(id, face, pending)| (id, face, finished.take(pending).to_vec())).collect())
    }
}

/// Rows from 0 to `height` in bands of at most [`STEP_TEXELS`] texels.
fn bands(width: u32, height: u32) -> impl Iterator<Item = Range<u32>> {
    // A multiple of a workgroup's 8 rows.
    let rows = (STEP_TEXELS / width.max(1)).next_multiple_of(8).max(8);
    (0..height.div_ceil(rows)).map(move |i| i * rows..((i + 1) * rows).min(height))
}

impl SampleUpload {
    /// Begins the upload of a validated sample into a layer of the pool with that index.
    pub(crate) fn new(
        info: &Arc<SampleSetInfo>,
        sample: &Arc<Sample>,
        pool: &Pool,
        index: usize,
        layer: u32,
    ) -> Result<Self, RenderError> {
        let [width, height] = pool.class.size;
        let levels = pool.array(PlaneKind::Radiance)?.texture.mip_level_count();
        let faces = sample.camera.faces();
        let kinds = sample.planes.iter().map(|plane| plane.kind);
        let copies = kinds.flat_map(|kind| bands(width, height).map(move |rows| Step::Copy(kind, rows)));
        let display_rows = bands(width, height).map(Step::DisplayRows);
        let coarser = (1..levels).flat_map(|level| {
            bands((width >> level).max(1), (height >> level).max(1))
                .map(move |rows| Step::Coarser(level, rows))
        });
        let left = copies.chain(display_rows).chain(coarser).chain((0..faces.len()).map(Step::Bounds));
        Ok(Self {
            info: info.clone(),
            sample: Arc::downgrade(sample),
            pool: index,
            layer,
            tiles: vec![FaceTiles::default(); faces.len()],
            left: left.collect(),
            faces,
            scratch: None,
        })
    }

    /// Whether this uploads that sample as part of that set.
    pub(crate) fn is_of(&self, info: &Arc<SampleSetInfo>, sample: &Arc<Sample>) -> bool {
        std::ptr::eq(self.sample.as_ptr(), Arc::as_ptr(sample))
            && (Arc::ptr_eq(&self.info, info) || self.info == *info)
    }

    /// Whether all steps are recorded.
    pub(crate) fn is_recorded(&self) -> bool {
        self.left.is_empty()
    }

    /// Records the next step. Returns the program that it runs, if any.
    ///
    /// # Errors
    /// [`RenderError::Internal`] if planes do not fit the pool; validation excludes this.
    pub(crate) fn record(
        &mut self,
        context: &UploadContext<'_>,
        pool: &mut Pool,
        sample: &Sample,
        to: &mut Submission,
    ) -> Result<Option<&'static str>, RenderError> {
        let Some(step) = self.left.pop_front() else { return Ok(None) };
        let program = match step {
            Step::Copy(..) => None,
            Step::DisplayRows(_) => Some("display_rows"),
            Step::Coarser(..) => Some("coarsen"),
            Step::Bounds(_) => Some("bound_tile"),
        };
        pool.mark_dirty(self.layer);
        let width = u64::from(pool.class.size[0]);
        let texels = |rows: &Range<u32>| width * u64::from(rows.end - rows.start);
        let exposure = self.info.lighting.exposure;
        to.weight += match step {
            Step::Copy(kind, rows) => {
                if let (Some(plane), Ok(array)) = (sample.plane(kind), pool.array(kind)) {
                    plane::copy_rows_into_layer(
                        context.gpu,
                        plane,
                        rows.clone(),
                        &array.texture,
                        self.layer,
                    )?;
                }
                texels(&rows)
            }
            Step::DisplayRows(rows) => {
                let texels = texels(&rows);
                context.mips.display_rows(&mut to.commands, pool, self.layer, exposure, rows)?;
                DISPLAY_WEIGHT * texels
            }
            Step::Coarser(level, rows) => {
                let scratch = self.scratch.get_or_insert_with(|| MipScratch::new(context.gpu, pool));
                let texels = texels(&rows) >> level;
                context.mips.coarser(&mut to.commands, pool, self.layer, exposure, level, rows, scratch)?;
                COARSER_WEIGHT * texels
            }
            Step::Bounds(face) => {
                let of = &self.faces[face];
                let pending = context.bounds.record(context.gpu, &mut to.commands, pool, self.layer, of)?;
                to.bounds.push((sample.id, face, pending));
                BOUNDS_WEIGHT * u64::from(of.size[0]) * u64::from(of.size[1])
            }
        };
        Ok(program)
    }

    /// Stores the tile bounds of a face.
    pub(crate) fn bound(&mut self, face: usize, bytes: &[u8]) {
        self.tiles[face] = BoundsPass::tiles(&self.faces[face], bytes);
    }
}

/// Cost of a texel by step, in units of one copied texel. Measured roughly on the software driver.
const DISPLAY_WEIGHT: u64 = 8;
const COARSER_WEIGHT: u64 = 16;
const BOUNDS_WEIGHT: u64 = 4;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bands_cover_all_rows_once_and_no_band_is_longer_than_a_step() {
        for (width, height) in [(1536, 1024), (1, 1), (100, 75), (1 << 14, 3), (512, 512)] {
            let bands: Vec<_> = bands(width, height).collect();
            assert_eq!((bands[0].start, bands[bands.len() - 1].end), (0, height));
            assert!(bands.windows(2).all(|pair| pair[0].end == pair[1].start));
            assert!(
                bands.iter().all(|rows| rows.len() as u32 * width <= STEP_TEXELS.max(8 * width) + 8 * width)
            );
        }
        assert_eq!(bands(512, 0).count(), 0);
    }
}
