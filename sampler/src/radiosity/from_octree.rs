//! Maps of VPLs from an octree of the scene, all at once.

use std::f64::consts::{FRAC_PI_2, PI};
use std::sync::Arc;

use argus_gpu::Gpu;
use argus_gpu::hierarchy::{Octree, OctreeBuilder, RootCube, Triangle};
use argus_gpu::many_views::{Knobs, ManyViews, ViewList, ViewPoint};
use argus_scene::{Bounds, RenderError};
use glam::Vec3;

use super::Vpl;
use super::surfaces::Surfaces;
use crate::lit_octree::refused;
use crate::{MapSource, VplKnobs};

/// The octree of a scene's surfaces.
pub(crate) fn octree(
    gpu: &Arc<Gpu>,
    surfaces: &Surfaces,
    bounds: Bounds,
    levels: u32,
) -> Result<Arc<Octree>, RenderError> {
    let triangles = surfaces.triangles().map(|corners| Triangle { corners, color: Vec3::ONE });
    let octree = OctreeBuilder::new(gpu).build(RootCube::around(&bounds), levels, triangles);
    octree.map(Arc::new).map_err(refused)
}

/// The maps of VPLs, each a view of the half space before its surface, and of particles, which have none.
pub(crate) fn render(
    gpu: &Arc<Gpu>,
    octree: &Arc<Octree>,
    vpls: &[Vpl],
    knobs: &VplKnobs,
) -> Result<ManyViews, RenderError> {
    let views: Vec<ViewPoint> = vpls
        .iter()
        .map(|vpl| ViewPoint {
            position: vpl.position,
            direction: vpl.normal.as_dvec3(),
            half_fov: if vpl.normal == Vec3::ZERO { PI } else { FRAC_PI_2 },
        })
        .collect();
    let list = ViewList::new(gpu, &octree.root, &views)?;
    let told =
        Knobs { side: knobs.map_side, sharing: knobs.maps == MapSource::MegaViews, ..Knobs::default() };
    let mut many = ManyViews::new(gpu, Arc::clone(octree), told).map_err(refused)?;
    many.render(&list).map_err(refused)?;
    Ok(many)
}
