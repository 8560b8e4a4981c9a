//! Positions and directions of views.

use std::sync::OnceLock;

use argus_gpu::wgpu::{Buffer, BufferUsages};
use argus_scene::InvalidField;
use glam::DVec3;

use super::view_depth::Spread;
use crate::hierarchy::RootCube;
use argus_gpu::Gpu;

/// A viewpoint. Its map covers all directions; nodes outside its field of view may be missing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ViewPoint {
    /// World space, metres.
    pub position: DVec3,
    /// Axis of its field of view, not zero. Ignored for omnidirectional views.
    pub direction: DVec3,
    /// Half the field of view, radians: π/2 for a point on a surface, π for all directions.
    pub half_fov: f64,
}

/// Views on the GPU.
#[derive(Debug)]
pub struct ViewList {
    pub(super) buffer: Buffer,
    pub(super) count: u32,
    /// Root cube of the views, in edges of the scene's root.
    pub(super) origin: DVec3,
    pub(super) edge: f64,
    /// Whether any view is not omnidirectional.
    pub(super) look: bool,
    /// Positions, in edges of the scene's root cube.
    places: Vec<DVec3>,
    /// Computed on demand.
    spread: OnceLock<Spread>,
}

impl ViewPoint {
    /// An omnidirectional view.
    pub fn everywhere(position: DVec3) -> Self {
        Self { position, direction: DVec3::X, half_fov: std::f64::consts::PI }
    }

    /// Checks that all fields are finite and in range.
    ///
    /// # Errors
    /// The invalid field and the reason.
    pub fn validate(&self) -> Result<(), InvalidField> {
        if !self.position.is_finite() {
            return Err(InvalidField::new("view.position", format!("must be finite, not {}", self.position)));
        }
        if !(self.half_fov > 0.0) {
            return Err(InvalidField::new(
                "view.half_fov",
                format!("must be above 0, not {}", self.half_fov),
            ));
        }
        let looks_somewhere = self.direction.is_finite() && self.direction.length() > 0.0;
        if self.half_fov < std::f64::consts::PI && !looks_somewhere {
            let reason = format!("must be finite and have a length, not {}", self.direction);
            return Err(InvalidField::new("view.direction", reason));
        }
        Ok(())
    }
}

impl ViewList {
    /// Uploads views relative to the scene's root cube. Their octree uses the same root cube if it contains them,
    /// otherwise the smallest cube that contains both.
    ///
    /// # Errors
    /// A view that [`ViewPoint::validate`] rejects, or an empty list.
    pub fn new(gpu: &Gpu, root: &RootCube, views: &[ViewPoint]) -> Result<Self, InvalidField> {
        if views.is_empty() || views.len() > u32::MAX as usize / 64 {
            let reason = format!("must be 1 to {}, not {}", u32::MAX / 64, views.len());
            return Err(InvalidField::new("views", reason));
        }
        let mut data = Vec::with_capacity(views.len() * 2);
        let mut places = Vec::with_capacity(views.len());
        let (mut least, mut most) = (DVec3::ZERO, DVec3::ONE);
        for view in views {
            view.validate()?;
            let unit = root.unit_from_world(view.position);
            least = least.min(unit);
            most = most.max(unit);
            places.push(unit);
            let p = unit.as_vec3();
            let d = if view.half_fov >= std::f64::consts::PI {
                glam::Vec3::X
            } else {
                (view.direction / view.direction.abs().max_element()).normalize().as_vec3()
            };
            data.push([p.x, p.y, p.z, view.half_fov as f32]);
            data.push([d.x, d.y, d.z, 0.0]);
        }
        let inside = least == DVec3::ZERO && most == DVec3::ONE;
        let edge = if inside { 1.0 } else { (most - least).max_element() * (1.0 + 1.0 / 1024.0) };
        Ok(Self {
            buffer: gpu.upload("views", &data, BufferUsages::STORAGE),
            count: views.len() as u32,
            origin: if inside { DVec3::ZERO } else { (least + most) * 0.5 - 0.5 * edge },
            edge,
            look: views.iter().any(|view| view.half_fov < std::f64::consts::PI),
            places,
            spread: OnceLock::new(),
        })
    }

    /// Levels of the view octree for a scene's octree of `depth` levels.
    pub(super) fn depth_for(&self, scene_depth: u32) -> u32 {
        let in_cube = |place: &DVec3| (*place - self.origin) / self.edge;
        let spread =
            self.spread.get_or_init(|| Spread::of(&self.places.iter().map(in_cube).collect::<Vec<_>>()));
        spread.depth((-f64::from(scene_depth)).exp2() / self.edge)
    }

    /// Edge of the views' root cube, in edges of the scene's.
    pub fn edge(&self) -> f64 {
        self.edge
    }

    /// Two rows of four floats a view: its position in the scene's root cube and half its field of view, and its direction.
    pub fn buffer(&self) -> &Buffer {
        &self.buffer
    }

    /// Number of views, as programs count them.
    pub fn count(&self) -> u32 {
        self.count
    }

    /// Number of views.
    pub fn len(&self) -> usize {
        self.count as usize
    }

    /// Always false: [`ViewList::new`] refuses an empty list.
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }
}
