//! Fake roles whose pixels are a hash of their inputs: a frame of the wrong samples or the wrong plan is a different
//! frame.

use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::time::Duration;

use argus_cluster::RoleFactory;
use argus_scene::{
    Cancel, CellContent, CellPage, CellPages, CellReport, Compositor, FaceMask, Frame, InvalidField, Output,
    Plan, Plane, PlaneData, PlaneFormat, PlaneKind, Provenance, RenderError, Sample, SampleId, SampleJob,
    SampleSet, SampleSetInfo, Sampler, Scene, Served, Specification, Stage, ViewJob, Warp,
};
use bytes::Bytes;

/// What a test may change while a cluster runs, shared by its workers.
#[derive(Default)]
pub struct Settings {
    pub view_us: AtomicU64,
    pub direct_us: AtomicU64,
    pub sample_us: AtomicU64,
    /// Time to make a sampler.
    pub sampler_us: AtomicU64,
    /// Roles stay at their work, cancelled or not, while this is set.
    pub stuck: AtomicBool,
    /// Number of next calls that lose the device.
    pub lose_device: AtomicUsize,
    /// Number of next calls that panic.
    pub panics: AtomicUsize,
    /// Views of this width fail.
    pub poisoned_width: AtomicU64,
    pub compositors_made: AtomicUsize,
    pub samplers_made: AtomicUsize,
    pub samplers_dropped: AtomicUsize,
    pub samples_rendered: AtomicUsize,
    pub samples_read_back: AtomicUsize,
    pub largest_batch: AtomicUsize,
    pub cancelled: AtomicUsize,
    /// Samples that a compositor has memory for; 0: any number.
    pub compositor_holds: AtomicUsize,
    /// Most samples that one compositor held.
    pub most_held: AtomicUsize,
    /// Slices of a background sample, each as long as a sample; 0: no slices.
    pub sample_parts: AtomicUsize,
    /// Number of background samples.
    pub samples_ahead: AtomicUsize,
    /// Pixels of reconstructed views that no sample saw, in a hundred.
    pub unresolved_percent: AtomicU64,
    /// Compositors refuse to be made.
    pub no_device: AtomicBool,
    /// Slices in which a compositor uploads a background sample; 0: no slices.
    pub hold_slices: AtomicUsize,
    /// Time of a slice.
    pub hold_us: AtomicU64,
    /// Slices and views, in the order in which they were done.
    pub done: parking_lot::Mutex<Vec<Done>>,
    /// The sampler's light cells.
    pub cells: parking_lot::Mutex<Option<Arc<FakeCells>>>,
}

/// Light cells whose pages are a few bytes each.
#[derive(Default)]
pub struct FakeCells {
    pub pages: parking_lot::Mutex<BTreeMap<CellPage, Bytes>>,
    /// Pages that are still to be asked for.
    pub wanted: parking_lot::Mutex<Vec<CellPage>>,
    pub given_up: parking_lot::Mutex<Vec<CellPage>>,
    /// No page is packed while this is set.
    pub stuck: AtomicBool,
    asked: AtomicBool,
}

impl FakeCells {
    /// A page that no sampler takes over.
    pub const MALFORMED: CellPage = 99_999;

    pub fn of(held: &[CellPage], wanted: &[CellPage]) -> Arc<Self> {
        let page =
            |&page: &CellPage| (page, Bytes::copy_from_slice(&[&page.to_le_bytes()[..], b"cells"].concat()));
        let cells = Self::default();
        cells.pages.lock().extend(held.iter().map(page));
        cells.wanted.lock().extend(wanted);
        Arc::new(cells)
    }

    pub fn was_asked(&self) -> bool {
        self.asked.load(Ordering::SeqCst)
    }
}

impl CellPages for FakeCells {
    fn content(&self) -> Option<CellContent> {
        Some([7; 32])
    }

    fn wanted(&self, most: usize) -> Vec<CellPage> {
        let mut wanted = self.wanted.lock();
        let most = most.min(wanted.len());
        wanted.drain(..most).collect()
    }

    fn packed(&self, content: CellContent, pages: &[CellPage]) -> Vec<(CellPage, Bytes)> {
        assert_eq!(Some(content), self.content());
        self.asked.store(true, Ordering::SeqCst);
        while self.stuck.load(Ordering::SeqCst) {
            std::thread::sleep(Duration::from_millis(5));
        }
        let held = self.pages.lock();
        pages.iter().filter_map(|page| Some((*page, held.get(page)?.clone()))).collect()
    }

    fn add(&self, _: CellContent, page: CellPage, packed: &[u8]) -> Result<(), InvalidField> {
        if page == Self::MALFORMED {
            return Err(InvalidField::new("page", "is malformed"));
        }
        self.pages.lock().insert(page, Bytes::copy_from_slice(packed));
        Ok(())
    }

    fn give_up(&self, pages: &[CellPage]) {
        self.given_up.lock().extend(pages);
    }
}

/// A piece of work that a role did.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Done {
    /// A slice of a sample's upload, counted from 0.
    Slice(SampleId, usize),
    Direct,
    Warped,
}

impl Settings {
    pub fn set(&self, view_us: u64, direct_us: u64) {
        self.view_us.store(view_us, Ordering::SeqCst);
        self.direct_us.store(direct_us, Ordering::SeqCst);
    }

    /// Works for a while, in slices. Returns whether it was cancelled.
    fn work(&self, us: &AtomicU64, cancel: &Cancel) -> bool {
        while self.stuck.load(Ordering::SeqCst) {
            std::thread::sleep(Duration::from_millis(5));
        }
        let mut left = Duration::from_micros(us.load(Ordering::SeqCst));
        while !left.is_zero() {
            if cancel.is_cancelled() {
                self.cancelled.fetch_add(1, Ordering::SeqCst);
                return true;
            }
            let slice = left.min(Duration::from_millis(5));
            std::thread::sleep(slice);
            left -= slice;
        }
        false
    }

    fn misfortune(&self) -> Result<(), RenderError> {
        let strikes = |count: &AtomicUsize| {
            count.fetch_update(Ordering::SeqCst, Ordering::SeqCst, |n| n.checked_sub(1)).is_ok()
        };
        if strikes(&self.panics) {
            panic!("a role panics, as told");
        }
        match strikes(&self.lose_device) {
            true => Err(RenderError::DeviceLost("as told".to_owned())),
            false => Ok(()),
        }
    }
}

pub struct Factory {
    pub settings: Arc<Settings>,
}

/// Id of the sample that a sampler renders to warm up.
const WARM_UP: u64 = u64::MAX;

pub const DEVICE: &str = "no device at all, version 1";

impl RoleFactory for Factory {
    fn sampler(&self, scene: Arc<Scene>, set: &SampleSetInfo) -> Result<Box<dyn Sampler>, RenderError> {
        std::thread::sleep(Duration::from_micros(self.settings.sampler_us.load(Ordering::SeqCst)));
        self.settings.samplers_made.fetch_add(1, Ordering::SeqCst);
        Ok(Box::new(FakeSampler { settings: self.settings.clone(), scene, set: set.clone() }))
    }

    fn compositor(&self) -> Result<Box<dyn Compositor>, RenderError> {
        if self.settings.no_device.load(Ordering::SeqCst) {
            return Err(RenderError::Internal("there is no device".to_owned()));
        }
        self.settings.compositors_made.fetch_add(1, Ordering::SeqCst);
        Ok(Box::new(FakeCompositor {
            settings: self.settings.clone(),
            held: HashMap::new(),
            begun: HashMap::new(),
        }))
    }
}

/// FNV-1a.
fn hash(parts: &[&[u8]]) -> u64 {
    let bytes = parts.iter().flat_map(|part| part.iter());
    bytes.fold(0xcbf2_9ce4_8422_2325, |h, b| (h ^ u64::from(*b)).wrapping_mul(0x0000_0100_0000_01b3))
}

/// Bytes that follow from a seed.
fn noise(seed: u64, count: usize) -> Bytes {
    let mut x = seed | 1;
    let next = |_| {
        x ^= x << 13;
        x ^= x >> 7;
        x ^= x << 17;
        (x >> 24) as u8
    };
    (0..count).map(next).collect::<Vec<u8>>().into()
}

fn frame(job: &ViewJob, scene: &Scene, specification: Specification, seed: u64) -> Frame {
    let pixels = (job.width * job.height) as usize;
    Frame {
        width: job.width,
        height: job.height,
        images: job
            .outputs
            .iter()
            .map(|output| match output {
                // No pixel names a sample.
                Output::Source => (output, vec![0; pixels].into()),
                _ => (output, noise(seed ^ output as u64, pixels * output.pixel_bytes())),
            })
            .collect(),
        unresolved_fraction: 0.0,
        served: Served::default(),
        predicted: None,
        decision: None,
        provenance: Provenance {
            scene: scene.hash,
            state: job.state,
            plan: job.plan.clone(),
            specification: Some(specification),
            device: DEVICE.to_owned(),
            history: job.history.is_some(),
        },
        stages: Vec::new(),
    }
}

/// The stages of a frame: the role's working time, at least a millisecond.
fn stages(us: &AtomicU64) -> Vec<Stage> {
    vec![Stage::new("render", (us.load(Ordering::SeqCst) as f64 * 1e-3).max(1.0))]
}

fn seed_of(job: &ViewJob, more: &[u8]) -> u64 {
    let shown = (job.state.epoch, job.state.revision);
    let text = format!("{:?} {:?} {} {} {shown:?}", job.camera, job.plan, job.width, job.height);
    hash(&[text.as_bytes(), more])
}

struct FakeSampler {
    settings: Arc<Settings>,
    scene: Arc<Scene>,
    /// The sample set that it was made for.
    set: SampleSetInfo,
}

impl Drop for FakeSampler {
    fn drop(&mut self) {
        self.settings.samplers_dropped.fetch_add(1, Ordering::SeqCst);
    }
}

impl FakeSampler {
    fn sample(&self, info: &SampleSetInfo, id: SampleId, to_host: bool) -> Result<Sample, RenderError> {
        let camera = info.rig.camera(id.camera)?;
        let size = camera.size();
        let texels = (size[0] * size[1]) as usize;
        assert_eq!(info.indirect, self.set.indirect, "a sampler is made for one way to light");
        let light = info.indirect.to_string();
        let seed = hash(&[
            &self.scene.hash.0,
            &id.camera.to_le_bytes(),
            &info.version.state.epoch.to_le_bytes(),
            &info.version.state.revision.to_le_bytes(),
            light.as_bytes(),
        ]);
        let plane = |kind, format: PlaneFormat, seed| {
            let bytes = noise(seed, texels * format.texel_bytes());
            let data = if to_host { PlaneData::Host(bytes) } else { PlaneData::Device(Arc::new(bytes)) };
            Plane { kind, format, size, data }
        };
        let radiance = plane(PlaneKind::Radiance, PlaneFormat::Rgb9e5Ufloat, seed);
        let range = plane(PlaneKind::InverseRange, PlaneFormat::R32Float, seed ^ 1);
        let (faces, planes) = (FaceMask::ALL, vec![radiance, range]);
        Ok(Sample { id, camera, faces, planes, stages: vec![Stage::new("sample", 1.0)] })
    }
}

impl Sampler for FakeSampler {
    fn device(&self) -> &str {
        DEVICE
    }

    fn light_cells(&self) -> Option<CellReport> {
        let pages = self.settings.cells.lock().as_ref().map(|cells| cells.pages.lock().len())?;
        Some(CellReport { pages, ..CellReport::default() })
    }

    fn cell_pages(&self) -> Option<Arc<dyn CellPages>> {
        Some(self.settings.cells.lock().clone()?)
    }

    fn render_samples(&mut self, job: &SampleJob, cancel: &Cancel) -> Vec<Result<Sample, RenderError>> {
        let one = |id: &SampleId| {
            self.settings.misfortune()?;
            if self.settings.work(&self.settings.sample_us, cancel) {
                return Err(RenderError::Cancelled);
            }
            if id.version != WARM_UP {
                self.settings.samples_rendered.fetch_add(1, Ordering::SeqCst);
                self.settings.samples_read_back.fetch_add(job.to_host.into(), Ordering::SeqCst);
            }
            self.sample(&job.info, *id, job.to_host)
        };
        job.ids.iter().map(one).collect()
    }

    fn render_samples_in_slices(
        &mut self,
        job: &SampleJob,
        cancel: &Cancel,
        give_way: &mut dyn FnMut(&mut dyn Sampler, f64),
    ) -> Vec<Result<Sample, RenderError>> {
        let parts = self.settings.sample_parts.load(Ordering::SeqCst);
        for part in 1..parts {
            self.settings.work(&self.settings.sample_us, cancel);
            give_way(self, part as f64 / parts as f64);
        }
        self.settings.samples_ahead.fetch_add(job.ids.len(), Ordering::SeqCst);
        self.render_samples(job, cancel)
    }

    fn render_view_in_slices(
        &mut self,
        view: &ViewJob,
        cancel: &Cancel,
        give_way: &mut dyn FnMut(&mut dyn Sampler, f64),
    ) -> Result<Frame, RenderError> {
        let parts = self.settings.sample_parts.load(Ordering::SeqCst);
        for part in 1..parts {
            if self.settings.work(&self.settings.sample_us, cancel) {
                return Err(RenderError::Cancelled);
            }
            give_way(self, part as f64 / parts as f64);
        }
        self.render_views(std::slice::from_ref(view), cancel).remove(0)
    }

    fn render_views(&mut self, views: &[ViewJob], cancel: &Cancel) -> Vec<Result<Frame, RenderError>> {
        let one = |job: &ViewJob| {
            assert!(matches!(job.plan, Plan::Direct { .. }));
            self.settings.misfortune()?;
            if self.settings.work(&self.settings.direct_us, cancel) {
                return Err(RenderError::Cancelled);
            }
            self.settings.done.lock().push(Done::Direct);
            let specification = Specification { visibility: job.visibility, ..self.set.specification() };
            let light = self.set.indirect.to_string();
            let seed = seed_of(job, &[&self.scene.hash.0, light.as_bytes()].concat());
            let mut made = frame(job, &self.scene, specification, seed);
            made.stages = stages(&self.settings.direct_us);
            Ok(made)
        };
        views.iter().map(one).collect()
    }
}

struct FakeCompositor {
    settings: Arc<Settings>,
    held: HashMap<SampleId, (Arc<SampleSetInfo>, Vec<Bytes>)>,
    /// Uploaded slices of samples that are not held yet.
    begun: HashMap<SampleId, usize>,
}

impl Compositor for FakeCompositor {
    fn device(&self) -> &str {
        DEVICE
    }

    fn hold(&mut self, set: &SampleSet) -> Result<(), RenderError> {
        let new = set.samples.iter().filter(|sample| !self.held.contains_key(&sample.id)).count();
        let most = self.settings.compositor_holds.load(Ordering::SeqCst);
        if most > 0 && self.held.len() + new > most {
            return Err(RenderError::OutOfMemory(format!("{most} samples fit")));
        }
        self.settings.most_held.fetch_max(self.held.len() + new, Ordering::SeqCst);
        for sample in &set.samples {
            self.begun.remove(&sample.id);
            let bytes = |plane: &Plane| match &plane.data {
                PlaneData::Host(bytes) => Ok(bytes.clone()),
                PlaneData::Device(any) => {
                    let bytes = any.clone().downcast::<Bytes>();
                    bytes.map(|b| (*b).clone()).map_err(|_| RenderError::Internal("not our plane".to_owned()))
                }
            };
            let planes = sample.planes.iter().map(bytes).collect::<Result<_, _>>()?;
            self.held.insert(sample.id, (set.info.clone(), planes));
        }
        Ok(())
    }

    fn hold_slice(&mut self, set: &SampleSet) -> Result<bool, RenderError> {
        let slices = self.settings.hold_slices.load(Ordering::SeqCst);
        for sample in &set.samples {
            let begun = self.begun.entry(sample.id).or_default();
            if *begun + 1 < slices {
                self.settings.work(&self.settings.hold_us, &Cancel::default());
                self.settings.done.lock().push(Done::Slice(sample.id, *begun));
                *begun += 1;
                return Ok(false);
            }
        }
        self.hold(set).map(|()| true)
    }

    fn release(&mut self, ids: &[SampleId]) {
        for id in ids {
            self.begun.remove(id);
            self.held.remove(id);
        }
    }

    fn compose(&mut self, views: &[ViewJob], cancel: &Cancel) -> Vec<Result<Frame, RenderError>> {
        self.settings.largest_batch.fetch_max(views.len(), Ordering::SeqCst);
        let one = |job: &ViewJob| {
            let Plan::Warp(Warp { samples, .. }) = &job.plan else { panic!("a direct view") };
            self.settings.misfortune()?;
            if u64::from(job.width) == self.settings.poisoned_width.load(Ordering::SeqCst) {
                return Err(RenderError::Internal("poisoned".to_owned()));
            }
            if self.settings.work(&self.settings.view_us, cancel) {
                return Err(RenderError::Cancelled);
            }
            self.settings.done.lock().push(Done::Warped);
            let mut texels = Vec::new();
            let mut of = None;
            for id in samples {
                let (info, planes) = self.held.get(id).ok_or(RenderError::MissingSample(*id))?;
                of = Some(info.clone());
                planes.iter().for_each(|plane| texels.extend_from_slice(&plane[..64]));
            }
            // The state that a later search may start from.
            texels.push(job.history.is_some().into());
            let info = of.ok_or_else(|| RenderError::Internal("no samples".to_owned()))?;
            let mut made = frame(job, &super::scene("test"), info.specification(), seed_of(job, &texels));
            made.provenance.scene = info.scene;
            made.stages = stages(&self.settings.view_us);
            made.unresolved_fraction = self.settings.unresolved_percent.load(Ordering::SeqCst) as f64 * 1e-2;
            Ok(made)
        };
        views.iter().map(one).collect()
    }
}
