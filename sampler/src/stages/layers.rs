//! Layers: transparent surfaces in front of what a part's rays see, an image for those that are so many from behind.

use argus_gpu::wgpu;

use super::part::{Part, PartJob};
use crate::frame::{Frame, LightSharing};
use crate::layers::{self, LayerImage, RayLayers};
use crate::passes::{Blend, Placed, Shaded};
use crate::scratch::Targets;
use crate::visibility::write_ids;

/// Where the layers of a part are rendered, and what is behind them.
pub(super) struct LayerPlace {
    /// The part of a tile that shows layers. `None` for a list, which has the rays of its pixels alone, and for other
    /// rays.
    shown: Option<Part>,
    placed: Placed,
    behind: Targets,
    arriving: Option<wgpu::Buffer>,
}

impl LayerPlace {
    /// The images of layers, from the hindmost to the foremost.
    pub(super) fn images<'a>(&self, rays: &'a [RayLayers]) -> impl Iterator<Item = LayerImage> + 'a {
        layers::images(rays, self.placed.stride, self.placed.offset, self.placed.size)
    }
}

/// The part of a frame that shows layers.
pub(super) fn place(frame: &Frame<'_>, job: &PartJob<'_>) -> LayerPlace {
    // Rays along a texel's side: one for a sample.
    let side = frame.context.tile.side;
    let [width, height] = frame.context.tile.sub_samples();
    let (shown, offset, size) = match job.part {
        Part::Tile(tile) => {
            let shown = layers::part_of(tile, job.layers, side);
            let offset = [0, 1].map(|axis| (shown.begin[axis] - tile.begin[axis]) * side);
            (Some(Part::Tile(shown)), offset, shown.size.map(|texels| texels * side))
        }
        Part::Pixels(_) | Part::Rays(_) => (None, [0; 2], [width, height]),
    };
    let placed = Placed { size, offset, stride: width };
    LayerPlace { shown, placed, behind: frame.context.targets.clone(), arriving: frame.arriving.clone() }
}

/// The frame of an image of layers, with their visibility.
pub(super) fn begin<'a>(
    behind: &'a mut Frame<'_>,
    job: &mut PartJob<'_>,
    place: &LayerPlace,
    image: &LayerImage,
) -> Frame<'a> {
    let Frame { context, sharing, is_view, stages, .. } = behind;
    let shown = place.shown.as_ref().unwrap_or(job.part);
    let mut context =
        shown.context(context.gpu, context.resident, context.eye, job.layer_scratch, job.extras);
    if let LightSharing::Texels { side } = sharing {
        // All sub-samples of a texel see what its central ray does.
        let ids = layers::repeated(&image.ids, place.placed.size[0], *side);
        write_ids(context.gpu, &context.targets, context.tile.sub_samples(), &ids);
        context.cast_texels();
    } else {
        write_ids(context.gpu, &context.targets, place.placed.size, &image.ids);
    }
    Frame { is_view: *is_view, ..Frame::new(context, *sharing, "render layers", stages) }
}

/// Blends an image of layers over what is behind it.
pub(super) fn blend(
    layer: &mut Frame<'_>,
    job: &PartJob<'_>,
    blend: &Blend,
    place: &LayerPlace,
    image: &LayerImage,
) {
    let glossy = (!layer.is_view && job.extras.gloss).then_some(job.extras.reflectors);
    let above = Shaded { targets: &layer.context.targets, arriving: layer.arriving.as_ref() };
    let below = Shaded { targets: &place.behind, arriving: place.arriving.as_ref() };
    let gpu = layer.context.gpu;
    blend.record(gpu, &mut layer.commands, [above, below], &place.placed, &image.alphas, glossy);
}
