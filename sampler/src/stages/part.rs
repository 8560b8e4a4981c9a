//! A part of a job: what is rendered in one submission, and what renders it.

use std::sync::Arc;

use argus_gpu::{Gpu, PendingReadback, Submitted, wgpu};
use argus_scene::{Cancel, Output, Outputs, Visibility};
use argus_shaders::layout::sampler::Rays;

use super::reflections::ViewReflecting;
use super::shade::SurfaceProgram;
use crate::SamplerSettings;
use crate::eye::Eye;
use crate::frame::LightSharing;
use crate::indirect::Lights;
use crate::layers::RayLayers;
use crate::passes::{Blend, PlaneBuffers, ResolveView, TileContext};
use crate::pixel_list::PixelList;
use crate::ray_tile::RayTile;
use crate::resident::Resident;
use crate::scratch::{Extras, Scratch};
use crate::tile::Tile;
use crate::visibility::VisibilityBackends;

/// What is rendered in one submission.
pub(crate) enum Part {
    /// All pixels of a tile.
    Tile(Tile),
    /// Some pixels of a tile.
    Pixels(PixelList),
    /// All pixels of a tile, by rays of their own.
    Rays(RayTile),
}

impl Part {
    /// Each tile as a part.
    pub(crate) fn of_tiles(tiles: Vec<Tile>) -> Vec<Self> {
        tiles.into_iter().map(Self::Tile).collect()
    }

    /// The tile, or the tile that the pixels lie in.
    pub(crate) fn tile(&self) -> &Tile {
        match self {
            Self::Tile(tile) => tile,
            Self::Pixels(list) => &list.tile,
            Self::Rays(cast) => &cast.tile,
        }
    }

    /// What passes of the part share.
    pub(crate) fn context<'a>(
        &self,
        gpu: &'a Arc<Gpu>,
        resident: &'a Resident,
        eye: &'a Eye,
        scratch: &mut Scratch,
        extras: Extras,
    ) -> TileContext<'a> {
        match self {
            Self::Tile(tile) => TileContext::new(gpu, resident, eye, tile, scratch, extras),
            // The listed pixels are an image of their own, with the rays of the tile.
            Self::Pixels(list) => {
                let [width, height] = list.compact.sub_samples();
                let rays = Rays { width, height, ..list.tile.rays() };
                let rays = gpu.upload("rays", &[rays], wgpu::BufferUsages::UNIFORM);
                let places = gpu.upload("places", &list.words(), wgpu::BufferUsages::STORAGE);
                let context = TileContext::new(gpu, resident, eye, &list.compact, scratch, extras);
                TileContext { rays, places: Some(places), ..context }
            }
            Self::Rays(cast) => {
                let directions = gpu.upload("directions", &cast.directions, wgpu::BufferUsages::STORAGE);
                let context = TileContext::new(gpu, resident, eye, &cast.tile, scratch, extras);
                TileContext { directions: Some(directions), ..context }
            }
        }
    }
}

/// What the passes of a tile end in.
#[derive(Clone, Copy)]
pub(crate) enum PartOutput<'a> {
    /// Texels of a sample, stored in its planes.
    Texels(&'a PlaneBuffers),
    /// Some of colour, radiance and range, each in its output's format. Range has one sub-sample a pixel.
    Pixels(Outputs),
}

impl PartOutput<'_> {
    /// Whether surfaces are shaded.
    pub(crate) fn is_shaded(self) -> bool {
        match self {
            Self::Texels(_) => true,
            Self::Pixels(outputs) => outputs.has_any(Outputs::SHADED),
        }
    }

    /// Which sub-samples of a part share light.
    pub(crate) fn sharing(self, part: &Part) -> LightSharing {
        match (self, part) {
            (Self::Texels(_), _) => LightSharing::Texels { side: part.tile().side },
            (_, Part::Tile(_) | Part::Rays(_)) => LightSharing::Image,
            (_, Part::Pixels(_)) => LightSharing::Pixels,
        }
    }
}

/// A part that was submitted.
pub(crate) struct RenderedPart {
    pub(crate) submitted: Submitted,
    /// The images that are asked for, being read back.
    pub(crate) images: Vec<(Output, PendingReadback)>,
    /// What was found of light cells, if that is not known yet: [`crate::lit_cells::CellOutcome`].
    pub(crate) outcome: Option<PendingReadback>,
    /// Ranges of pixels that show a transparent surface: index, metres.
    pub(crate) ranges: Vec<(u32, f32)>,
}

/// A part that is to be rendered, and the programs and the light of its scene.
pub(crate) struct PartJob<'a> {
    pub(crate) part: &'a Part,
    pub(crate) output: PartOutput<'a>,
    pub(crate) extras: Extras,
    /// Layers of the part's rays, and what they are shaded in.
    pub(crate) layers: &'a [RayLayers],
    pub(crate) layer_scratch: &'a mut Scratch,
    pub(crate) visibility: &'a VisibilityBackends,
    pub(crate) backend: Visibility,
    pub(crate) programs: SurfaceProgram<'a>,
    /// What finds the reflections of a view, if it does not look them up in probes.
    pub(crate) reflecting: Option<ViewReflecting<'a>>,
    pub(crate) lights: &'a mut Lights,
    pub(crate) exposure: f32,
    pub(crate) blend: Option<&'a Blend>,
    pub(crate) resolve_view: &'a ResolveView,
    pub(crate) settings: &'a SamplerSettings,
    pub(crate) cancel: &'a Cancel,
}
