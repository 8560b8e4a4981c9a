//! Renders lists of pixels of direct views. They are traced and shaded as lists, so that the cost is that of the lists.

use argus_scene::{
    Cancel, Images, InvalidField, Output, Outputs, PixelJob, Pixels, Plan, RenderError, Visibility,
};

use super::gpu_sampler::{GpuSampler, Moment};
use super::ready_scene::{JobScene, ReadyScene};
use super::surface_programs::ReflectionLookup;
use super::tile_loop::ListOf;
use super::views::{checked_size, faces_of};
use crate::pixel_list::pixel_lists;
use crate::stages::{Part, PartOutput};
use crate::view::grid_side;

/// Most jobs that are rendered beside each other.
const TOGETHER: usize = 32;

const RANGE: Outputs = Outputs::only(Output::Range);

/// The images of a job, in the order of its pixels.
struct Found(Vec<(Output, Vec<u8>)>);

impl Found {
    fn new(job: &PixelJob) -> Self {
        let image = |output: Output| (output, vec![0; job.pixels.len() * output.pixel_bytes()]);
        Self([Output::Color, Output::Range].map(image).into())
    }

    /// Takes the pixels of a list.
    fn place(&mut self, part: &Part, pixels: &Images) {
        let Part::Pixels(list) = part else { return };
        for (output, image) in &mut self.0 {
            let (pixels, bytes) = (pixels[*output].as_deref().unwrap_or_default(), output.pixel_bytes());
            for (&asked, pixel) in list.asked.iter().zip(pixels.chunks_exact(bytes)) {
                let at = asked as usize * bytes;
                image[at..at + bytes].copy_from_slice(pixel);
            }
        }
    }

    fn into_pixels(self, scene: ReadyScene) -> Pixels {
        let mut images: Images = self.0.into_iter().map(|(output, image)| (output, image.into())).collect();
        let mut take = |output: Output| images[output].take().unwrap_or_default();
        let (color, range) = (take(Output::Color), take(Output::Range));
        Pixels { color, range, stages: scene.into_stages() }
    }
}

impl GpuSampler {
    /// Renders lists of pixels. Lists of one moment and light are rendered beside each other; the bytes of each are those that it has
    /// alone.
    pub(super) fn render_lists(
        &mut self,
        jobs: &[PixelJob],
        cancel: &Cancel,
    ) -> Vec<Result<Pixels, RenderError>> {
        let mut results = Vec::with_capacity(jobs.len());
        let alike = |one: &PixelJob, other: &PixelJob| {
            (one.state, one.time_secs, one.reflections) == (other.state, other.time_secs, other.reflections)
        };
        for group in jobs.chunk_by(alike).flat_map(|group| group.chunks(TOGETHER)) {
            match self.render_beside(group, cancel) {
                Ok(pixels) => results.extend(pixels.into_iter().map(Ok)),
                // Each has its own error, or none.
                Err(_) if group.len() > 1 => {
                    let alone = group.iter().map(|job| self.render_beside(std::slice::from_ref(job), cancel));
                    results.extend(alone.map(|pixels| {
                        pixels.and_then(|mut pixels| {
                            pixels.pop().ok_or_else(|| RenderError::Internal("a list was lost".to_owned()))
                        })
                    }));
                }
                Err(error) => results.push(Err(error)),
            }
        }
        results
    }

    /// Renders lists of one moment and light.
    fn render_beside(&mut self, jobs: &[PixelJob], cancel: &Cancel) -> Result<Vec<Pixels>, RenderError> {
        let lists = lists_of(jobs)?;
        let mut scenes = Vec::with_capacity(jobs.len());
        for job in jobs {
            scenes.push(self.ready_for(job, cancel)?);
        }
        let mut found: Vec<Found> = jobs.iter().map(Found::new).collect();
        if self.visibility.has_layers() {
            // What shows transparent surfaces waits for the device at each of them.
            for ListOf { job, part, outputs } in &lists {
                let output = PartOutput::Pixels(*outputs);
                let (scene, part) = (&mut scenes[*job], std::slice::from_ref(part));
                self.render_image(scene, part, output, cancel, |part, pixels| {
                    found[*job].place(part, &pixels)
                })?;
            }
        } else {
            self.render_lists_of(&mut scenes, &lists, cancel, |list, pixels| {
                found[list.job].place(&list.part, &pixels);
            })?;
        }
        Ok(found.into_iter().zip(scenes).map(|(found, scene)| found.into_pixels(scene)).collect())
    }

    /// Makes the scene ready for a list.
    fn ready_for(&mut self, job: &PixelJob, cancel: &Cancel) -> Result<ReadyScene, RenderError> {
        let job_scene = JobScene {
            position: job.camera.eye,
            moment: Moment::of(job.state, job.time_secs),
            lighting: None,
            light: job.state.light,
            ray_divisor: 1,
            cells: self.cells_of_samples(),
            // As direct views: nothing is rendered for later pixels while a view waits for these.
            reflections: ReflectionLookup::of_list(job.reflections),
            // Lists are traced on the CPU.
            visibility: Visibility::Cpu,
            is_shaded: true,
        };
        self.make_ready(job_scene, cancel)
    }
}

/// The lists of some jobs: colour by each sub-sample, and range by one ray a pixel.
fn lists_of(jobs: &[PixelJob]) -> Result<Vec<ListOf>, RenderError> {
    let mut lists = Vec::new();
    for (index, job) in jobs.iter().enumerate() {
        if !job.camera.is_pinhole() {
            return Err(InvalidField::new("camera", "lists of pixels are of pinholes").into());
        }
        let side = grid_side(&Plan::direct(job.samples_per_pixel))?;
        let faces = faces_of(job.camera, checked_size(job.width, job.height)?);
        let passes = match side {
            1 => vec![(1, Outputs::COLOR.union(RANGE))],
            side => vec![(side, Outputs::COLOR), (1, RANGE)],
        };
        for (side, outputs) in passes {
            for face in &faces {
                let parts = pixel_lists(face, side, &job.pixels)?.into_iter().map(Part::Pixels);
                lists.extend(parts.map(|part| ListOf { job: index, part, outputs }));
            }
        }
    }
    Ok(lists)
}
