//! Renders direct views, and lists of their pixels.

use std::time::Instant;

use argus_scene::camera::Face;
use argus_scene::{
    Camera, Cancel, Detail, Frame, InvalidField, Outputs, PixelJob, Pixels, Plan, RenderError, SampleCamera,
    Sampling, Specification, ViewJob, Visibility,
};
use bytes::Bytes;

use super::gpu_sampler::GpuSampler;
use super::ready_scene::JobScene;
use super::surface_programs::ReflectionLookup;
use crate::enlarge::enlarged;
use crate::pixel_list::pixel_lists;
use crate::stages::{Output, Part};
use crate::tile::{Tile, tiles};
use crate::timing;
use crate::view::{Image, ViewParts, frame, grid_side};

/// Sub-samples of a band of a view that finds its own reflections: rays of all take up to 400 MB.
const REFLECTING_SUB_SAMPLES: u32 = 1 << 20;

impl GpuSampler {
    /// Renders one direct view in its plan's detail. All images but the colours have all of their pixels.
    pub(super) fn render_view(&mut self, view: &ViewJob, cancel: &Cancel) -> Result<Frame, RenderError> {
        let (detail, size) = (detail_of(&view.plan), checked_size(view.width, view.height)?);
        let [width, height] = detail.size(size);
        if [width, height] == size || !view.outputs.color {
            return self.render_all_pixels(view, cancel);
        }
        let camera = detail.camera(view.camera, size);
        let small = ViewJob { camera, width, height, outputs: Outputs::COLOR, ..view.clone() };
        let small = self.render_all_pixels(&small, cancel)?;
        let outputs = Outputs { color: false, ..view.outputs };
        let mut frame = self.render_all_pixels(&ViewJob { outputs, ..view.clone() }, cancel)?;
        timing::add(&mut frame.stages, small.stages);
        let begin = Instant::now();
        frame.color = small.color.map(|color| enlarged(&color, detail, size).into());
        timing::add_since(&mut frame.stages, "enlarge", begin);
        Ok(frame)
    }

    /// Renders each pixel of a direct view. Range has one ray a pixel, through the pixel's centre.
    pub(super) fn render_all_pixels(
        &mut self,
        view: &ViewJob,
        cancel: &Cancel,
    ) -> Result<Frame, RenderError> {
        let side = grid_side(&view.plan)?;
        let size = checked_size(view.width, view.height)?;
        let faces = faces_of(view.camera, size);
        let job_scene = JobScene {
            position: view.camera.eye,
            time_secs: view.time_secs,
            lighting: None,
            light: view.state.light,
            ray_divisor: detail_of(&view.plan).ray_divisor(),
            cells: self.cells_of_view(view)?,
            reflections: ReflectionLookup::of_view(view.reflections),
            visibility: view.visibility,
            is_shaded: view.outputs.color,
        };
        let mut scene = self.make_ready(job_scene, cancel)?;
        if view.outputs.color {
            self.see_reflectors(view, &faces, &mut scene);
        }
        let defers = matches!(scene.reflections, ReflectionLookup::View(_));
        let mut images = |side, output| -> Result<[Bytes; 2], RenderError> {
            let (mut color, mut range) = (Image::new(size, 3), Image::new(size, 4));
            // Rays of reflections are in memory, a tile's at once.
            let bands =
                |tile: Tile| if defers { tile.bands(REFLECTING_SUB_SAMPLES).collect() } else { vec![tile] };
            let parts = Part::of_tiles(tiles(&faces, side).into_iter().flat_map(bands).collect());
            self.render_image(&mut scene, &parts, output, cancel, |part, pixels| {
                pixels.color.into_iter().for_each(|pixels| color.place(part.tile(), pixels));
                pixels.range.into_iter().for_each(|pixels| range.place(part.tile(), pixels));
            })?;
            Ok([color.into_bytes(), range.into_bytes()])
        };
        let (mut color, mut range) = (None, None);
        match (view.outputs.color, view.outputs.range) {
            (true, true) if side == 1 => [color, range] = images(1, Output::ColorAndRange)?.map(Some),
            (has_color, has_range) => {
                if has_color {
                    color = images(side, Output::Color)?.into_iter().next();
                }
                if has_range {
                    range = images(1, Output::Range)?.into_iter().nth(1);
                }
            }
        }
        let specification = self.specification(view, scene.backend);
        let (lit, device) = (self.says_light(view), self.gpu.kind());
        let parts = ViewParts { color, range };
        Ok(frame(&lit, &self.scene, specification, device, parts, scene.into_stages()))
    }

    /// How a view is rendered by a backend.
    fn specification(&self, view: &ViewJob, visibility: Visibility) -> Specification {
        Specification {
            visibility,
            sampling: Sampling::Triangles,
            sub_samples: self.settings.sub_samples,
            effects: self.settings.effects,
            indirect: self.settings.indirect,
            reflections: view.reflections,
            exposure: self.lighting.exposure,
        }
    }

    /// Renders some pixels of a direct view. They are traced and shaded as a list, so that the cost is that of the list.
    pub(super) fn render_list(&mut self, job: &PixelJob, cancel: &Cancel) -> Result<Pixels, RenderError> {
        let side = grid_side(&Plan::direct(job.samples_per_pixel))?;
        let faces = faces_of(job.camera, checked_size(job.width, job.height)?);
        let job_scene = JobScene {
            position: job.camera.eye,
            time_secs: job.time_secs,
            lighting: None,
            light: job.state.light,
            ray_divisor: 1,
            cells: self.cells_of_samples(),
            // As views from samples, into which the pixels go.
            reflections: ReflectionLookup::probes(job.reflections),
            // Lists are traced on the CPU.
            visibility: Visibility::Cpu,
            is_shaded: true,
        };
        let mut scene = self.make_ready(job_scene, cancel)?;
        let mut images = |side, output| -> Result<[Bytes; 2], RenderError> {
            let (mut color, mut range) = (vec![0; job.pixels.len() * 3], vec![0; job.pixels.len() * 4]);
            for face in &faces {
                let parts: Vec<Part> =
                    pixel_lists(face, side, &job.pixels)?.into_iter().map(Part::Pixels).collect();
                self.render_image(&mut scene, &parts, output, cancel, |part, pixels| {
                    let Part::Pixels(list) = part else { return };
                    for (image, pixels, bytes) in
                        [(&mut color, pixels.color, 3), (&mut range, pixels.range, 4)]
                    {
                        let pixels = pixels.unwrap_or_default();
                        for (&asked, pixel) in list.asked.iter().zip(pixels.chunks_exact(bytes)) {
                            let at = asked as usize * bytes;
                            image[at..at + bytes].copy_from_slice(pixel);
                        }
                    }
                })?;
            }
            Ok([color.into(), range.into()])
        };
        let [color, range] = match side {
            1 => images(1, Output::ColorAndRange)?,
            _ => {
                let ([color, _], [_, range]) = (images(side, Output::Color)?, images(1, Output::Range)?);
                [color, range]
            }
        };
        Ok(Pixels { color, range, stages: scene.into_stages() })
    }
}

/// The size of an image, columns and rows.
///
/// # Errors
/// A size without pixels.
fn checked_size(width: u32, height: u32) -> Result<[u32; 2], InvalidField> {
    match width == 0 || height == 0 {
        true => Err(InvalidField::new("width", "width and height must be at least 1")),
        false => Ok([width, height]),
    }
}

/// How much of a view from triangles its plan has rendered.
fn detail_of(plan: &Plan) -> Detail {
    match plan {
        Plan::Direct { detail, .. } => *detail,
        Plan::Warp(_) => Detail::Full,
    }
}

/// A view's camera as the faces of a sample camera.
fn faces_of(camera: Camera, [width, height]: [u32; 2]) -> Vec<Face> {
    SampleCamera::Perspective { camera, width, height }.faces()
}
