//! MegaViews (Kol et al. 2018): maps of a scene's octree from very many viewpoints at once.
//!
//! - [`hierarchy`]: the octree of a scene's surfaces, built on the GPU;
//! - [`many_views`]: the double traversal that renders maps of the octree;
//! - [`LitOctree`]: an octree whose leaves are shaded on both sides;
//! - [`add_to`] plugs two methods into a sampler: samples that are looked up in maps (`samples.rs`, `omni_maps.rs`), and reflection
//!   probes from one traversal (`probes.rs`).

pub mod hierarchy;
mod layout;
mod lit_octree;
pub mod many_views;
mod omni_maps;
mod passes;
mod probes;
pub mod programs;
mod samples;

use std::sync::Arc;

use argus_sampler::plug::Methods;

pub use self::lit_octree::{Chunk, LitNodes, LitOctree, to_render_error};
use self::omni_maps::OmniMaps;
pub use self::passes::with_node_maps;
use self::probes::OctreeProbes;

/// Adds samples from maps, and reflection probes from an octree, to the methods of a sampler.
pub fn add_to(methods: &mut Methods) {
    methods.samples = Some(Arc::new(|scene, settings| Box::new(OmniMaps::new(scene, settings))));
    methods.probes = Some(Arc::new(|gpu, resident, g_buffer, levels| {
        Box::new(OctreeProbes::new(gpu, resident, g_buffer, levels))
    }));
}
