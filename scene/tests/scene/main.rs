//! Loaders, and the reference ray tracer against answers that are known on paper.

mod common;
mod effect_plan;
mod environment;
mod loaders;
mod loaders_files;
mod loaders_gltf;
mod reference_images;
mod reference_light;
mod reference_ranges;
mod sight;
mod unlit;
