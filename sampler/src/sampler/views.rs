//! Renders direct views.

use std::time::Instant;

use argus_scene::camera::Face;
use argus_scene::{
    Camera, Cancel, Detail, Frame, Images, InvalidField, Output, Outputs, Plan, RenderError, SampleCamera,
    Sampling, Specification, ViewJob, Visibility,
};

use super::gpu_sampler::{GpuSampler, Moment};
use super::ready_scene::{BetweenTiles, JobScene};
use super::slices::Slices;
use super::surface_programs::ReflectionLookup;
use crate::enlarge::enlarged;
use crate::ray_tile::RayTile;
use crate::stages::{Part, PartOutput};
use crate::tile::{Tile, tiles};
use crate::timing;
use crate::view::{Image, frame, grid_side};
use crate::view_geometry;

/// Sub-samples of a band of a view that finds its own reflections: rays of all take up to 400 MB.
const REFLECTING_SUB_SAMPLES: u32 = 1 << 20;

impl GpuSampler {
    /// Renders one direct view in its plan's detail. All images but the colours have all of their pixels.
    pub(super) fn render_view(&mut self, view: &ViewJob, cancel: &Cancel) -> Result<Frame, RenderError> {
        let (detail, size) = (detail_of(&view.plan), checked_size(view.width, view.height)?);
        let [width, height] = detail.size(size);
        let shaded = view.outputs.within(Outputs::SHADED);
        if [width, height] == size || shaded == Outputs::NONE {
            return self.render_all_pixels(view, cancel, None);
        }
        let camera = detail.camera(view.camera, size);
        let small = ViewJob { camera, width, height, outputs: shaded, ..view.clone() };
        let small = self.render_all_pixels(&small, cancel, None)?;
        let light = small.provenance.plan.light();
        let outputs = view.outputs.outside(shaded);
        let mut frame = self.render_all_pixels(&ViewJob { outputs, ..view.clone() }, cancel, None)?;
        // What lit the colours; the other images have no light.
        frame.provenance.plan = frame.provenance.plan.with_light(light);
        timing::add(&mut frame.stages, small.stages);
        let begin = Instant::now();
        frame.images.take_over(
            small
                .images
                .iter()
                .filter(|(output, _)| shaded.has(*output))
                .map(|(output, image)| (output, enlarged(image, output.format(), detail, size).into()))
                .collect(),
        );
        timing::add_since(&mut frame.stages, "enlarge", begin);
        Ok(frame)
    }

    /// Renders each pixel of a direct view. Range has one ray a pixel, through the pixel's centre. With `between`, other work runs between
    /// the view's bands.
    pub(super) fn render_all_pixels(
        &mut self,
        view: &ViewJob,
        cancel: &Cancel,
        between: Option<BetweenTiles<'_>>,
    ) -> Result<Frame, RenderError> {
        let side = grid_side(&view.plan)?;
        let tile_side = side;
        let size = checked_size(view.width, view.height)?;
        let faces = faces_of(view.camera, size);
        let lens = (!view.camera.is_pinhole())
            .then(|| view.camera.rays_of(view.rays.as_ref(), view.width, view.height));
        let job_scene = JobScene {
            position: view.camera.eye,
            moment: Moment::of(view.state, view.time_secs),
            lighting: None,
            light: view.state.light,
            ray_divisor: detail_of(&view.plan).ray_divisor(),
            cells: match between {
                Some(_) => self.cells_of_slices(view)?,
                None => self.cells_of_view(view)?,
            },
            reflections: ReflectionLookup::of_view(view.reflections),
            // Rays of other lenses are traced on the CPU.
            visibility: if lens.is_some() { Visibility::Cpu } else { view.visibility },
            is_shaded: view.outputs.has_any(Outputs::SHADED),
        };
        let mut scene = self.make_ready(job_scene, cancel)?;
        if view.outputs.has_any(Outputs::SHADED) {
            self.see_reflectors(view, (&faces, lens.as_ref()), &mut scene);
        }
        let defers = matches!(scene.reflections, ReflectionLookup::View(_));
        let mut slices = between.map(|between| Slices::new(view, between));
        let mut render = |side, outputs: Outputs| -> Result<Images, RenderError> {
            let image = |output: Output| (output, Image::new(size, output.pixel_bytes()));
            let mut images: Vec<(Output, Image)> = outputs.iter().map(image).collect();
            // Rays of reflections are in memory, a tile's at once.
            let bands =
                |tile: Tile| if defers { tile.bands(REFLECTING_SUB_SAMPLES).collect() } else { vec![tile] };
            let tiles: Vec<Tile> = tiles(&faces, side)
                .into_iter()
                .flat_map(|tile| bands_of_view(tile, view, tile_side))
                .flat_map(bands)
                .collect();
            let output = PartOutput::Pixels(outputs);
            let mut place = |part: &Part, mut pixels: Images| {
                for (output, image) in &mut images {
                    pixels[*output].take().into_iter().for_each(|pixels| image.place(part.tile(), pixels));
                }
            };
            match (&lens, &mut slices) {
                (None, Some(slices)) => {
                    slices.render(self, &mut scene, &Part::of_tiles(tiles), output, cancel, place)?;
                }
                (None, None) => {
                    self.render_image(&mut scene, &Part::of_tiles(tiles), output, cancel, place)?
                }
                // One after another, because directions take memory.
                (Some(rays), _) => {
                    for tile in tiles {
                        let part = [Part::Rays(RayTile::new(rays, tile))];
                        self.render_image(&mut scene, &part, output, cancel, &mut place)?;
                    }
                }
            }
            Ok(images.into_iter().map(|(output, image)| (output, image.into_bytes())).collect())
        };
        // Of one sub-sample a pixel, what the rays see is found once.
        let range = view.outputs.within(Outputs::only(Output::Range));
        let shaded = view.outputs.within(Outputs::SHADED);
        let passes =
            if side == 1 { vec![(1, shaded.union(range))] } else { vec![(side, shaded), (1, range)] };
        let mut images = Images::default();
        for (side, outputs) in passes.into_iter().filter(|(_, outputs)| *outputs != Outputs::NONE) {
            images.take_over(render(side, outputs)?);
        }
        let geometry = view_geometry::images(
            &mut self.visibility,
            &self.resident,
            view,
            &tiles(&faces, 1),
            lens.as_ref(),
            &mut scene.stages,
        )?;
        images.take_over(geometry);
        let specification = self.specification(view, scene.backend);
        let lit = match slices {
            Some(slices) => slices.says_light(view),
            None => self.says_light(view),
        };
        let device = self.gpu.kind();
        Ok(frame(&lit, &self.scene, specification, device, images, scene.into_stages()))
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
}

/// The size of an image, columns and rows.
///
/// # Errors
/// A size without pixels.
pub(super) fn checked_size(width: u32, height: u32) -> Result<[u32; 2], InvalidField> {
    match width == 0 || height == 0 {
        true => Err(InvalidField::new("width", "width and height must be at least 1")),
        false => Ok([width, height]),
    }
}

/// A tile of a pass of a direct view, in its bands if the view has bands. `side`: sub-samples along a side of a pixel of the view's colours.
/// Passes with fewer have higher bands.
fn bands_of_view(tile: Tile, view: &ViewJob, side: u32) -> Vec<Tile> {
    match view.band_rows {
        0 => vec![tile],
        rows => tile.rows(rows * (side / tile.side).max(1).pow(2)).collect(),
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
pub(super) fn faces_of(camera: Camera, [width, height]: [u32; 2]) -> Vec<Face> {
    SampleCamera::Perspective { camera, width, height }.faces()
}
