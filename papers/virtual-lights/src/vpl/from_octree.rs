//! Renders the maps of all VPLs from an octree of the scene.

use std::f64::consts::{FRAC_PI_2, PI};
use std::sync::Arc;

use argus_gpu::Gpu;
use argus_megaviews::hierarchy::{Octree, OctreeBuilder, RootCube, Triangle};
use argus_megaviews::many_views::{ManyViews, Settings, ViewList, ViewPoint};
use argus_scene::{Bounds, RenderError};
use glam::Vec3;

use super::paths::Vpl;
use argus_megaviews::to_render_error;
use argus_sampler::plug::Surfaces;
use argus_scene::indirect::{MapSource, VplSettings};

/// Builds the octree of a scene's surfaces.
pub(crate) fn octree(
    gpu: &Arc<Gpu>,
    surfaces: &Surfaces,
    bounds: Bounds,
    levels: u32,
) -> Result<Arc<Octree>, RenderError> {
    let triangles = surfaces.triangles().map(|corners| Triangle { corners, color: Vec3::ONE });
    let octree = OctreeBuilder::new(gpu).build(RootCube::around(&bounds), levels, triangles);
    octree.map(Arc::new).map_err(to_render_error)
}

/// Renders the maps of VPLs (half space in front of the surface) and of particles (all directions).
pub(crate) fn render(
    gpu: &Arc<Gpu>,
    octree: &Arc<Octree>,
    vpls: &[Vpl],
    settings: &VplSettings,
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
    let params = Settings {
        side: settings.map_side,
        sharing: settings.maps == MapSource::MegaViews,
        ..Settings::default()
    };
    let mut many = ManyViews::new(gpu, Arc::clone(octree), params).map_err(to_render_error)?;
    many.render(&list).map_err(to_render_error)?;
    Ok(many)
}
