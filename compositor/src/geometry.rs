//! Views and samples in each other's coordinates: combined in f64, handed to the GPU as f32 relative to the
//! view's eye, so that a scene at 10⁶ m loses nothing.

use argus_scene::camera::Face;
use argus_scene::{Bounds, Camera, SampleCamera};
use argus_shaders::layout::compositor::{CellProjection, ViewSample};
use glam::{DMat3, DVec2, DVec3, DVec4};

/// A view's camera, ready to be combined with samples'.
#[derive(Debug, Clone)]
pub(crate) struct ViewGeometry {
    /// Centre of projection.
    pub(crate) eye: DVec3,
    view_from_world: DMat3,
    half: DVec2,
    /// Image in sub-pixels: width, height.
    pub(crate) size: DVec2,
}

/// Rows that take a position in a face's axes times its inverse depth, and that inverse depth, to pixel
/// coordinates times w, and to w, the depth in the view times the same inverse depth.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PixelFromFace {
    pub(crate) x: DVec4,
    pub(crate) y: DVec4,
    pub(crate) w: DVec4,
}

impl ViewGeometry {
    /// `side` sub-pixels to a pixel's edge.
    pub(crate) fn new(camera: &Camera, width: u32, height: u32, side: u32) -> Self {
        Self {
            eye: camera.eye,
            view_from_world: camera.view_from_world(),
            half: camera.tan_half_fov(width, height),
            size: DVec2::new(f64::from(width), f64::from(height)) * f64::from(side),
        }
    }

    /// Directions, world axes at depth 1: of the image's top left corner, and their change per sub-pixel to the
    /// right and down.
    pub(crate) fn directions(&self) -> [DVec3; 3] {
        let world_from_view = self.view_from_world.transpose();
        [
            world_from_view * DVec3::new(-self.half.x, self.half.y, -1.0),
            world_from_view.x_axis * self.pixel_at_unit_depth().x,
            world_from_view.y_axis * -self.pixel_at_unit_depth().y,
        ]
    }

    /// The axis that the view looks along, unit, world axes.
    pub(crate) fn forward(&self) -> DVec3 {
        -self.view_from_world.row(2)
    }

    /// Extent of a sub-pixel at depth 1.
    pub(crate) fn pixel_at_unit_depth(&self) -> DVec2 {
        2.0 * self.half / self.size
    }

    /// Where the view has what a face of a sample with this centre sees.
    pub(crate) fn pixel_from_face(&self, center: DVec3, face: &Face) -> PixelFromFace {
        let view_from_face = self.view_from_world * face.view_from_world.transpose();
        let center_in_view = self.view_from_world * (center - self.eye);
        let row = |i: usize| view_from_face.row(i).extend(center_in_view[i]);
        let w = -row(2);
        PixelFromFace {
            x: (row(0) / self.half.x + w) * (0.5 * self.size.x),
            y: (w - row(1) / self.half.y) * (0.5 * self.size.y),
            w,
        }
    }
}

impl PixelFromFace {
    /// The same for cells of `cell` sub-pixels, and an image whose texels have directions by this factor and summand; the
    /// rest of it is taken from `about`.
    pub(crate) fn projection(
        &self,
        about: CellProjection,
        cell: u32,
        scale: DVec2,
        bias: DVec2,
    ) -> CellProjection {
        let cell = f64::from(cell);
        CellProjection {
            column: (self.x / cell).as_vec4().to_array(),
            row: (self.y / cell).as_vec4().to_array(),
            depth: self.w.as_vec4().to_array(),
            scale: scale.as_vec2().to_array(),
            bias: bias.as_vec2().to_array(),
            ..about
        }
    }
}

/// A sample as the pixels of a view with this eye look it up.
pub(crate) fn view_sample(eye: DVec3, camera: &SampleCamera, face: &Face, layer: u32) -> ViewSample {
    let [right, up, back] = [0, 1, 2].map(|i| face.view_from_world.row(i));
    let half = face.tan_half_fov;
    ViewSample {
        u_from_world: ((right / half.x - back) * 0.5).as_vec3().to_array(),
        layer,
        v_from_world: ((-up / half.y - back) * 0.5).as_vec3().to_array(),
        _pad_v: 0.0,
        w_from_world: (-back).as_vec3().to_array(),
        _pad_w: 0.0,
        eye_from_center: (eye - camera.center()).as_vec3().to_array(),
        _pad: 0.0,
    }
}

/// Share of the bounds' longest edge by which rays are followed beyond them: surfaces that lie in a face of the
/// bounds, such as level ground, are passed through rather than touched. A step of the default linear search.
const BOUNDS_MARGIN: f64 = 1.0 / 64.0;

/// The scene's bounds about an eye, somewhat widened; the eye itself where the scene is empty.
pub(crate) fn bounds_about(bounds: &Bounds, eye: DVec3) -> [[f32; 3]; 2] {
    if bounds.is_empty() {
        return [[0.0; 3]; 2];
    }
    let margin = BOUNDS_MARGIN * bounds.size().max_element();
    [(bounds.min - eye - margin).as_vec3().to_array(), (bounds.max - eye + margin).as_vec3().to_array()]
}
