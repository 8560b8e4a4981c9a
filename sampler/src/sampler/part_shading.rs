//! Shades what a part's rays see: the opaque surfaces, and the transparent ones in front of them.

use argus_gpu::{Commands, wgpu};
use argus_scene::{Cancel, Lighting, RenderError};

use super::GpuSampler;
use super::probes::{ReflectionLookup, SurfaceProgram, SurfacePrograms};
use super::tile_loop::{Output, Part, ReadyScene, add_light, check_wanted};
use crate::indirect::{IndirectLight, LightSharing};
use crate::layers::{self, RayLayers};
use crate::light::DirectLight;
use crate::passes::{Blend, Placed, Shaded, TileContext};
use crate::plug::ViewMaps;
use crate::scratch::{Extras, Scratch};
use crate::timing;
use crate::visibility::write_ids;
use argus_scene::Stage;

/// What shades and lights the surfaces of a part.
pub(super) struct PartShading<'a> {
    pub(super) programs: &'a mut SurfacePrograms,
    pub(super) lights: (&'a Option<DirectLight>, &'a mut Option<IndirectLight>),
    pub(super) lighting: &'a Lighting,
    pub(super) reflections: ReflectionLookup,
    pub(super) maps: Option<&'a dyn ViewMaps>,
    pub(super) blend: Option<&'a Blend>,
    pub(super) cancel: &'a Cancel,
}

/// The layers of a part's rays, and where they are shaded.
pub(super) struct Layered<'a> {
    pub(super) layers: &'a [RayLayers],
    pub(super) scratch: &'a mut Scratch,
    pub(super) extras: Extras,
}

impl PartShading<'_> {
    /// Shades the sub-samples of a view. Returns the commands that later passes are recorded into.
    ///
    /// # Errors
    /// The errors of the device.
    pub(super) fn view(
        &mut self,
        mut commands: Commands,
        context: &TileContext<'_>,
        sharing: LightSharing,
        stages: &mut Vec<Stage>,
    ) -> Result<Commands, RenderError> {
        let SurfaceProgram { shade, probe_bindings, .. } = self.programs.of(self.reflections);
        shade.record(&mut commands, context, probe_bindings);
        let SurfacePrograms { of_views, reflected, .. } = &mut *self.programs;
        let (direct, indirect) = &mut self.lights;
        if let (ReflectionLookup::View(_), Some(views), Some(reflected)) =
            (self.reflections, of_views, reflected)
        {
            let from = (&reflected.found_by, self.maps);
            let lit = ((*direct, &mut **indirect), self.lighting);
            commands = views.add(commands, context, from, lit, self.cancel, stages)?;
        }
        let lights = (*direct, &mut **indirect);
        Ok(add_light(lights, commands, context, (sharing, true), stages)?.0)
    }

    /// Shades the texels of a sample. Returns the commands that later passes are recorded into, and the direct light.
    ///
    /// # Errors
    /// The errors of the device.
    pub(super) fn texels(
        &mut self,
        mut commands: Commands,
        context: &TileContext<'_>,
        sharing: LightSharing,
        stages: &mut Vec<Stage>,
    ) -> Result<(Commands, Option<wgpu::Buffer>), RenderError> {
        let SurfaceProgram { shade_sample, probe_bindings, .. } = self.programs.of(self.reflections);
        shade_sample.record(&mut commands, context, probe_bindings);
        let lights = (self.lights.0, &mut *self.lights.1);
        add_light(lights, commands, context, (sharing, false), stages)
    }

    /// Shades the layers of a part's rays, from the hindmost to the foremost, and blends them over what `commands` shaded in
    /// `behind`: sub-samples, or texels with their direct light. Returns the commands that later passes are recorded into.
    ///
    /// # Errors
    /// [`RenderError::Cancelled`], or the errors of the device.
    pub(super) fn blend(
        &mut self,
        commands: Commands,
        (part, sharing): (&Part, LightSharing),
        (behind, arriving): (&TileContext<'_>, Option<&wgpu::Buffer>),
        over: Layered<'_>,
        stages: &mut Vec<Stage>,
    ) -> Result<Commands, RenderError> {
        let (Some(blend), Layered { layers: rays @ [_, ..], scratch, extras }) = (self.blend, over) else {
            return Ok(commands);
        };
        timing::add(stages, commands.submit().wait()?.stages);
        let (gpu, is_sample) = (behind.gpu, matches!(sharing, LightSharing::Texels { .. }));
        // Rays along a texel's side: one for a sample.
        let side = behind.tile.side;
        let [width, height] = behind.tile.sub_samples();
        let (shown, offset, size) = match part {
            Part::Tile(tile) => {
                let shown = layers::part_of(tile, rays, side);
                let offset = [0, 1].map(|axis| (shown.begin[axis] - tile.begin[axis]) * side);
                (Some(Part::Tile(shown)), offset, shown.size.map(|texels| texels * side))
            }
            // A list has the rays of its pixels alone.
            Part::Pixels(_) => (None, [0; 2], [width, height]),
        };
        let shown = shown.as_ref().unwrap_or(part);
        let glossy = (is_sample && extras.gloss).then_some(extras.reflectors);
        let placed = Placed { size, offset, stride: width };
        for image in layers::images(rays, width, (offset, size)) {
            check_wanted(self.cancel)?;
            let context = shown.context(gpu, behind.resident, behind.eye, scratch, extras);
            let mut commands = gpu.commands("render layers");
            let texels;
            let (context, found) = match is_sample {
                true => {
                    // All sub-samples of a texel see what its central ray does.
                    let sub_samples = layers::repeated(&image.ids, size[0], context.tile.side);
                    write_ids(gpu, &context.targets, context.tile.sub_samples(), &sub_samples);
                    texels = context.tile.of_texels();
                    let context = context.of_texels(&texels);
                    let found;
                    (commands, found) = self.texels(commands, &context, sharing, stages)?;
                    (context, found)
                }
                false => {
                    write_ids(gpu, &context.targets, size, &image.ids);
                    commands = self.view(commands, &context, sharing, stages)?;
                    (context, None)
                }
            };
            let layer = Shaded { targets: &context.targets, arriving: found.as_ref() };
            let below = Shaded { targets: &behind.targets, arriving };
            blend.record(gpu, &mut commands, [layer, below], &placed, &image.alphas, glossy);
            timing::add(stages, commands.submit().wait()?.stages);
        }
        Ok(gpu.commands("blend"))
    }
}

impl GpuSampler {
    /// The layers of a part's rays: of its sub-samples, or for a sample of its texels' central rays.
    pub(super) fn layers_of(
        &mut self,
        part: &Part,
        output: Output<'_>,
        scene: &mut ReadyScene,
    ) -> Vec<RayLayers> {
        if !self.visibility.has_layers() {
            return Vec::new();
        }
        let begin = std::time::Instant::now();
        let eye = scene.eye.position;
        let found = match (part, output) {
            (Part::Pixels(list), _) => self.visibility.layers_of_list(&self.resident, eye, list),
            (Part::Tile(tile), Output::Texels(_)) => {
                self.visibility.layers_of_tile(&self.resident, eye, &tile.of_texels().rays())
            }
            (Part::Tile(tile), _) => self.visibility.layers_of_tile(&self.resident, eye, &tile.rays()),
        };
        timing::add_since(&mut scene.stages, "trace layers", begin);
        found
    }
}
