//! Scene to sample sets: visibility, then shading.
//!
//! [`GpuSampler`] holds a scene on the device and renders samples and direct views from its triangles. Each image is cut
//! into tiles that bound its memory. A tile's visibility buffer has the instance and triangle of each sub-sample.
//!
//! A direct view shades every sub-sample and averages those of a pixel. A texel of a sample shows one surface: the one
//! that covers most of its sub-samples. Each triangle of that surface is shaded once, in the middle of the sub-samples
//! that see it, so a texel inside one triangle costs one shading. The same code shades both.

mod backend_timing;
mod bvh;
mod draws;
mod enlarge;
mod eye;
mod frame;
mod index_maps;
mod indirect;
mod layers;
mod light;
mod light_meter;
mod light_rays;
mod lit_cells;
mod lit_leaves;
mod lit_scene;
mod lit_tile;
mod mixed;
mod packets;
mod pass_plan;
mod passes;
mod pixel_list;
pub mod plug;
mod point_shading;
mod probe_renderer;
mod ray_tile;
mod ray_timing;
mod ray_watch;
mod reflected_light;
mod resident;
mod sampler;
mod scratch;
mod settings;
mod sight;
mod stages;
mod surfaces;
mod tile;
mod timing;
mod view;
mod view_geometry;
mod view_reflections;
mod visibility;
mod wide;

pub use argus_scene::indirect::{
    CellSettings, Indirect, MapSource, PathSettings, PointSettings, VplSettings,
};
pub use light::PathReport;
#[cfg(feature = "fuzzing")]
pub use light::fuzzing::{pages as fuzzed_pages, read_page};
pub use light_meter::ResolvedLight;
pub use pass_plan::PassPlan;
pub use ray_timing::{
    DeviceRayBatch, DeviceRayTimes, DeviceRays, RayCost, RayKind, RayTracer, RayWork, device_ray_costs,
    ray_costs,
};
pub use sampler::{GpuSampler, PreparedSampler};
pub use settings::{LightSettings, LightTracer, RadianceFormat, SamplerSettings};
pub use sight::PacketSight;
