//! The passes, one file each. The program of `x.rs` is `shaders/sampler/x.wgsl`.

mod add_direct;
mod add_reflections;
mod alone_rays;
mod arriving_light;
mod blend;
mod blur_probes;
mod emitter_rays;
mod gather_rays;
mod look_up_cells;
mod resample_points;
mod resolve_sample;
mod resolve_view;
mod scattered_rays;
mod shade;
mod shade_points;
mod shade_sample;
mod shadow_rays;
mod sky_rays;
mod smooth_texels;
mod trace;
mod trace_cutouts;
mod visibility;

use std::sync::Arc;

use argus_gpu::{ComputeCall, Gpu, ReflectionProbes, wgpu};

use crate::eye::Eye;
use crate::resident::Resident;
use crate::scratch::{Extras, Scratch, Targets};
use crate::tile::Tile;

pub(crate) use add_direct::AddDirect;
pub(crate) use add_reflections::AddReflections;
pub(crate) use alone_rays::{AloneLight, AloneRays, smooth_cells};
pub(crate) use arriving_light::{ArrivingLight, LightParts, SkyFrom, SkyTable};
pub(crate) use blend::{Blend, Placed, Shaded};
pub use blur_probes::{BlurProbes, ProbePlanes};
pub(crate) use emitter_rays::EmitterRays;
pub(crate) use gather_rays::GatherRays;
pub(crate) use look_up_cells::LookUpCells;
pub(crate) use resample_points::ResamplePoints;
pub use resolve_sample::{PlaneBuffers, ResolveSample};
pub(crate) use resolve_view::ResolveView;
pub(crate) use scattered_rays::{ScatteredRays, Sought, Tracing};
pub(crate) use shade::Shade;
pub(crate) use shade_points::ShadePoints;
pub(crate) use shade_sample::ShadeSample;
pub(crate) use shadow_rays::{AskedLight, ShadowRays};
pub(crate) use sky_rays::{AskedSky, SkyRays};
pub(crate) use smooth_texels::SmoothTexels;
pub(crate) use trace::Trace;
pub(crate) use visibility::Rasteriser;

/// The reflection probes that shading programs bind.
pub(crate) struct ProbeBindings {
    pub(crate) probes: ReflectionProbes,
    /// For each instance 1 + the index of its probe; 0 for none.
    pub(crate) probe_of_instance: wgpu::Buffer,
}

impl ProbeBindings {
    /// Bindings without probes.
    pub(crate) fn none(gpu: &Gpu) -> Self {
        Self {
            probes: ReflectionProbes::none(gpu),
            probe_of_instance: gpu.buffer("no probes of instances", 16, wgpu::BufferUsages::STORAGE),
        }
    }
}

/// What the passes of a tile share.
pub struct TileContext<'a> {
    /// The device.
    pub gpu: &'a Arc<Gpu>,
    /// The scene on the device.
    pub resident: &'a Resident,
    /// The eye that positions are relative to.
    pub eye: &'a Eye,
    /// The tile.
    pub tile: Tile,
    /// Uniform of the tile's rays.
    pub rays: wgpu::Buffer,
    /// For a list of pixels: the position of each in the tile of the rays.
    pub places: Option<wgpu::Buffer>,
    /// For rays that are listed: the direction of each sub-sample. Then the tile's rays are not used.
    pub directions: Option<wgpu::Buffer>,
    /// What passes write.
    pub targets: Targets,
}

impl<'a> TileContext<'a> {
    /// Uploads a tile's rays and takes targets of its size.
    pub fn new(
        gpu: &'a Arc<Gpu>,
        resident: &'a Resident,
        eye: &'a Eye,
        tile: &Tile,
        scratch: &mut Scratch,
        extras: Extras,
    ) -> Self {
        let rays = gpu.upload("rays", &[tile.rays()], wgpu::BufferUsages::UNIFORM);
        let targets = scratch.targets(gpu, tile.sub_samples(), extras);
        Self { gpu, resident, eye, tile: *tile, rays, places: None, directions: None, targets }
    }

    /// Casts one ray a texel from now on, for shading what the tile's sub-samples see.
    pub(crate) fn cast_texels(&mut self) {
        self.tile = self.tile.of_texels();
        self.rays = self.gpu.upload("rays", &[self.tile.rays()], wgpu::BufferUsages::UNIFORM);
    }

    /// Binds what a program reads to shade surfaces.
    pub fn with_surfaces<'b>(&'b self, call: ComputeCall<'b>) -> ComputeCall<'b> {
        let Self { resident, eye, .. } = self;
        call.read("lighting", &eye.lighting)
            .read("lights", &eye.lights)
            .read("vertices", &resident.vertices)
            .read("attributes", &resident.attributes)
            .read("indices", &resident.indices)
            .read("meshes", &resident.meshes)
            .read("instances", &eye.instances)
            .read("materials", &resident.materials)
            .read("slots", &resident.slots)
            .read("texel_levels", &resident.texel_levels)
            .read("texels", &resident.texels)
            .read("texels_srgb", &resident.texels_srgb)
    }
}
