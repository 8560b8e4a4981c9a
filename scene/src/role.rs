//! The two roles of a process, as traits. `sampler` and `compositor` implement them; the cluster's worker drives
//! them, and neither knows the other.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use bytes::Bytes;

use crate::{
    Camera, CellPages, CellReport, FaceMask, FaceMasks, Frame, History, InvalidField, LightEffects,
    LightLevel, Output, Outputs, Plan, RayList, ReflectionProbeSet, RenderError, Sample, SampleId, SampleSet,
    SampleSetInfo, SceneState, Stage, Visibility,
};

/// A flag that cancels a render. Renders check it between submissions, so a batch ends early but not at once.
#[derive(Debug, Clone, Default)]
pub struct Cancel(Arc<AtomicBool>);

impl Cancel {
    /// A flag that is not raised.
    pub fn new() -> Self {
        Self::default()
    }

    /// Raises the flag: the result is no longer needed.
    pub fn cancel(&self) {
        self.0.store(true, Ordering::Release);
    }

    /// Whether the flag is raised.
    pub fn is_cancelled(&self) -> bool {
        self.0.load(Ordering::Acquire)
    }
}

/// An order for samples.
#[derive(Debug, Clone)]
pub struct SampleJob {
    /// Scene, rig, version, specification and lighting of the samples.
    pub info: Arc<SampleSetInfo>,
    /// Cameras of the rig.
    pub ids: Vec<SampleId>,
    /// The faces of each camera that are needed. A sampler may render more.
    pub faces: FaceMasks,
    /// Samples of `ids` that lack needed faces. Their texels are taken over, and only the missing faces are rendered.
    pub extended: Vec<Arc<Sample>>,
    /// Whether the planes are read back for another process, or stay on the device.
    pub to_host: bool,
}

impl SampleJob {
    /// An order for whole samples.
    pub fn new(info: Arc<SampleSetInfo>, ids: Vec<SampleId>, to_host: bool) -> Self {
        Self { info, ids, faces: FaceMasks::default(), extended: Vec::new(), to_host }
    }

    /// The sample that a new one of an id extends, if there is one.
    pub fn extended(&self, id: SampleId) -> Option<&Arc<Sample>> {
        self.extended.iter().find(|sample| sample.id == id)
    }

    /// The faces of a sample that the job ends with: those that are needed, and those of the sample that it extends.
    pub fn faces_of(&self, id: SampleId) -> FaceMask {
        let before = self.extended(id).map_or(FaceMask::NONE, |sample| sample.faces);
        self.faces.of(id.camera).union(before)
    }
}

/// An order for one view; validated, with a complete plan.
#[derive(Debug, Clone)]
pub struct ViewJob {
    /// Viewpoint.
    pub camera: Camera,
    /// The pixels' directions, of a camera of listed rays alone.
    pub rays: Option<RayList>,
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Images of the frame.
    pub outputs: Outputs,
    /// Method of rendering.
    pub plan: Plan,
    /// Rows of pixels of a view whose plan is [`Plan::Direct`] that are rendered together; 0: all. A frame in bands can be rendered
    /// in slices. Rows of one band share rays of light, so the height of bands changes bytes.
    pub band_rows: u32,
    /// Epoch and light that are shown.
    pub state: SceneState,
    /// Scene time of that epoch, seconds; see [`crate::Scene::at`].
    pub time_secs: f64,
    /// Visibility backend of a view whose plan is [`Plan::Direct`].
    pub visibility: Visibility,
    /// Reflection probes of a view whose plan is [`Plan::Direct`].
    pub reflections: Option<ReflectionProbeSet>,
    /// An earlier frame as the start of [`crate::Search::Seeded`], if it shows enough of this view; other searches ignore
    /// it. [`crate::Provenance::history`] says whether it was used.
    pub history: Option<Arc<History>>,
}

impl ViewJob {
    /// The colour of a view of the scene at its start, without probes and history.
    pub fn new(camera: Camera, [width, height]: [u32; 2], plan: Plan) -> Self {
        Self {
            camera,
            width,
            height,
            outputs: Outputs::COLOR,
            plan,
            band_rows: 0,
            state: SceneState::default(),
            time_secs: 0.0,
            visibility: Visibility::default(),
            reflections: None,
            history: None,
            rays: None,
        }
    }
}

/// An order for some pixels of a view: those that no sample saw.
#[derive(Debug, Clone)]
pub struct PixelJob {
    /// Viewpoint.
    pub camera: Camera,
    /// Pixels in a row of the whole view.
    pub width: u32,
    /// Rows of the whole view.
    pub height: u32,
    /// Indices of the pixels: row × width + column, ascending.
    pub pixels: Vec<u32>,
    /// Samples per pixel on a regular grid, a square number.
    pub samples_per_pixel: u32,
    /// Epoch and light that are shown.
    pub state: SceneState,
    /// Scene time of that epoch, seconds; see [`crate::Scene::at`].
    pub time_secs: f64,
    /// Reflection probes that the pixels' surfaces look up.
    pub reflections: Option<ReflectionProbeSet>,
}

/// Some pixels of a view, in the order of the request.
#[derive(Debug, Clone, PartialEq)]
pub struct Pixels {
    /// sRGB, 3 bytes a pixel.
    pub color: Bytes,
    /// f32 little-endian, metres from the eye along the pixel's central ray; +inf without a surface.
    pub range: Bytes,
    /// Cost by pass.
    pub stages: Vec<Stage>,
}

/// Renders from triangles: samples, direct views, and pixels that no sample saw.
pub trait Sampler: Send {
    /// Kind of device, as in [`crate::Provenance::device`].
    fn device(&self) -> &str;

    /// The device's visibility backends, and the milliseconds that each takes for a tile of a sample of such a set. A
    /// single backend, as here, need not be measured.
    ///
    /// # Errors
    /// Those of rendering the tile.
    fn measure_backends(&mut self, _info: &SampleSetInfo) -> Result<Vec<(Visibility, f64)>, RenderError> {
        Ok(vec![(Visibility::Raster, 0.0)])
    }

    /// The visibility backend that is probably fastest for views on this device, before any measurement.
    fn usual_visibility(&self) -> Visibility {
        Visibility::default()
    }

    /// Prepares a level of light beside other work: begins at the first call, and returns whether it is ready. What is rendered
    /// at a level that is not ready waits for it. The default is for samplers whose levels need no preparation.
    ///
    /// # Errors
    /// Those of preparing it.
    fn prepare_light(&mut self, _info: &SampleSetInfo, _light: LightLevel) -> Result<bool, RenderError> {
        Ok(true)
    }

    /// Fills light cells that views lacked, for about so long; with `refines`, also casts further rays for those in use, for when
    /// nothing else is to do. Returns whether there is more of either to do. The default is for samplers without light cells.
    fn fill_light(&mut self, _time: Duration, _refines: bool) -> bool {
        false
    }

    /// What the sampler's light cells are; `None` without any.
    fn light_cells(&self) -> Option<CellReport> {
        None
    }

    /// The pages of those cells, for other threads.
    fn cell_pages(&self) -> Option<Arc<dyn CellPages>> {
        None
    }

    /// The faces of an earlier version's sample that rendering them for `job` would give again, to the byte: nothing that they show or
    /// are lit by has changed. `earlier`: the sample, and the state of the scene that it shows. The default is for samplers that do not
    /// know.
    ///
    /// # Errors
    /// Those of making the scene ready for the job.
    fn unchanged_faces(
        &mut self,
        _job: &SampleJob,
        _earlier: (&Sample, SceneState),
        _cancel: &Cancel,
    ) -> Result<FaceMask, RenderError> {
        Ok(FaceMask::NONE)
    }

    /// Renders the samples of `job`, one result each, in order.
    fn render_samples(&mut self, job: &SampleJob, cancel: &Cancel) -> Vec<Result<Sample, RenderError>>;

    /// Renders samples in slices, with the bytes of [`Self::render_samples`]. `give_way` is called between slices of
    /// about 20 ms and may render views with the sampler it receives; it also receives the share of the job that is done, 0 to 1. The
    /// default renders everything in one slice.
    fn render_samples_in_slices(
        &mut self,
        job: &SampleJob,
        cancel: &Cancel,
        _give_way: &mut dyn FnMut(&mut dyn Sampler, f64),
    ) -> Vec<Result<Sample, RenderError>> {
        self.render_samples(job, cancel)
    }

    /// Renders views whose plan is [`Plan::Direct`], one result each, in order.
    fn render_views(&mut self, views: &[ViewJob], cancel: &Cancel) -> Vec<Result<Frame, RenderError>>;

    /// Renders a view whose plan is [`Plan::Direct`] in slices, with the bytes of [`Self::render_views`] for the light that the frame
    /// says. It waits for no fill of light cells. `give_way` is called between slices of about 20 ms and may render other views with the
    /// sampler it receives; it also receives the share that is done, 0 to 1. Only views with [`ViewJob::band_rows`] have slices. The
    /// default renders the view in one slice.
    ///
    /// # Errors
    /// Those of rendering the view.
    fn render_view_in_slices(
        &mut self,
        view: &ViewJob,
        cancel: &Cancel,
        _give_way: &mut dyn FnMut(&mut dyn Sampler, f64),
    ) -> Result<Frame, RenderError> {
        let frames = self.render_views(std::slice::from_ref(view), cancel);
        let missing = || Err(RenderError::Internal("a sampler returned no frame".to_owned()));
        frames.into_iter().next().unwrap_or_else(missing)
    }

    /// Renders a view with other effects of direct light than the set's, to measure what they cost; it may show another time. `None` where that takes
    /// more than other rays, such as other programs, or is not possible now. The default is for samplers that cannot.
    fn render_with(&mut self, _effects: LightEffects, _view: &ViewJob) -> Option<Result<Frame, RenderError>> {
        None
    }

    /// Renders some pixels of views, one result each, in order, with the bytes of [`Sampler::render_views`]. A
    /// sampler that rasterises its views and traces single rays may find another triangle along edges. The default is
    /// for samplers that cannot trace single rays: it renders the whole view.
    fn render_pixels(&mut self, jobs: &[PixelJob], cancel: &Cancel) -> Vec<Result<Pixels, RenderError>> {
        let views: Vec<ViewJob> = jobs
            .iter()
            .map(|job| ViewJob {
                outputs: Outputs::COLOR.with(Output::Range),
                state: job.state,
                time_secs: job.time_secs,
                reflections: job.reflections,
                ..ViewJob::new(job.camera, [job.width, job.height], Plan::direct(job.samples_per_pixel))
            })
            .collect();
        let frames = self.render_views(&views, cancel);
        jobs.iter().zip(frames).map(|(job, frame)| pick_pixels(&job.pixels, &frame?)).collect()
    }
}

/// Some pixels of a frame with colour and range.
fn pick_pixels(pixels: &[u32], frame: &Frame) -> Result<Pixels, RenderError> {
    let pick = |output: Output| -> Result<Bytes, RenderError> {
        let (image, bytes) = (frame.images[output].as_deref().unwrap_or_default(), output.pixel_bytes());
        let mut picked = Vec::with_capacity(pixels.len() * bytes);
        for &pixel in pixels {
            let at = pixel as usize * bytes;
            let texel = image
                .get(at..at + bytes)
                .ok_or_else(|| InvalidField::new("pixels", format!("the view has no pixel {pixel}")))?;
            picked.extend_from_slice(texel);
        }
        Ok(picked.into())
    };
    Ok(Pixels { color: pick(Output::Color)?, range: pick(Output::Range)?, stages: frame.stages.clone() })
}

/// Reconstructs views from samples; never sees a triangle.
pub trait Compositor: Send {
    /// Kind of device, as in [`crate::Provenance::device`].
    fn device(&self) -> &str;

    /// Takes samples, and replaces those of the same id.
    ///
    /// # Errors
    /// [`RenderError::OutOfMemory`] if they do not fit, [`RenderError::Invalid`] if a plane is malformed.
    fn hold(&mut self, set: &SampleSet) -> Result<(), RenderError>;

    /// Does the next slice of [`Self::hold`], of about 10 ms, and returns whether all of the samples are held. Views
    /// may be composed and other samples held between slices. A finished slice is not repeated while the samples
    /// live. The default holds everything at once.
    ///
    /// # Errors
    /// Those of [`Self::hold`]; the next call begins again with the samples that are not held yet.
    fn hold_slice(&mut self, set: &SampleSet) -> Result<bool, RenderError> {
        self.hold(set).map(|()| true)
    }

    /// Prepares the programs of such a view, so that no view waits for a compiling driver. `between` is called between
    /// slices of the work, as small as the driver makes them. The view is composed for it, and discarded.
    ///
    /// # Errors
    /// Those of composing the view.
    fn ready(&mut self, view: &ViewJob, between: &mut dyn FnMut()) -> Result<(), RenderError> {
        let frames = self.compose(std::slice::from_ref(view), &Cancel::default());
        between();
        frames.into_iter().try_for_each(|frame| frame.map(drop))
    }

    /// Releases samples, also those held in part; unknown ids are ignored.
    fn release(&mut self, ids: &[SampleId]);

    /// Reconstructs views whose plan is [`Plan::Warp`], one result each, in order. Views of different sizes and plans may
    /// share a batch, which does not change their bytes.
    fn compose(&mut self, views: &[ViewJob], cancel: &Cancel) -> Vec<Result<Frame, RenderError>>;
}
