//! Transforms between views and samples. They are combined in f64 and uploaded as f32 relative to the view's eye, so that
//! a scene at 10⁶ m loses no precision.

use argus_scene::camera::Face;
use argus_scene::{Bounds, Camera, FaceMask, ImagePlane, SampleCamera};
use argus_shaders::layout::compositor::{CellProjection, ViewSample};
use glam::{DMat3, DVec2, DVec3, DVec4};

/// A view's camera.
#[derive(Debug, Clone)]
pub(crate) struct ViewGeometry {
    /// Centre of projection, metres, world space.
    pub(crate) eye: DVec3,
    view_from_world: DMat3,
    plane: ImagePlane,
    /// Width and height of the image, sub-pixels.
    pub(crate) size: DVec2,
}

/// Rows of the transform from a face to homogeneous pixel coordinates. It takes (position × inverse depth, inverse depth)
/// in the face's axes; w is the depth in the view times that inverse depth.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PixelFromFace {
    pub(crate) x: DVec4,
    pub(crate) y: DVec4,
    pub(crate) w: DVec4,
}

impl ViewGeometry {
    /// The geometry of a view with `side` sub-pixels along the edge of a pixel.
    pub(crate) fn new(camera: &Camera, width: u32, height: u32, side: u32) -> Self {
        Self {
            eye: camera.eye,
            view_from_world: camera.view_from_world(),
            plane: camera.plane(width, height),
            size: DVec2::new(f64::from(width), f64::from(height)) * f64::from(side),
        }
    }

    /// Directions in world axes at depth 1: the image's top left corner, the step to the next sub-pixel right, and the
    /// step down.
    pub(crate) fn directions(&self) -> [DVec3; 3] {
        let world_from_view = self.view_from_world.transpose();
        let ImagePlane { half, center } = self.plane;
        [
            world_from_view * DVec3::new(center.x - half.x, half.y - center.y, -1.0),
            world_from_view.x_axis * self.pixel_at_unit_depth().x,
            world_from_view.y_axis * -self.pixel_at_unit_depth().y,
        ]
    }

    /// Unit direction of view, world axes.
    pub(crate) fn forward(&self) -> DVec3 {
        -self.view_from_world.row(2)
    }

    /// Extent of a sub-pixel at depth 1.
    pub(crate) fn pixel_at_unit_depth(&self) -> DVec2 {
        2.0 * self.plane.half / self.size
    }

    /// The transform from a face of a sample with this centre to pixels of the view.
    pub(crate) fn pixel_from_face(&self, center: DVec3, face: &Face) -> PixelFromFace {
        let view_from_face = self.view_from_world * face.view_from_world.transpose();
        let center_in_view = self.view_from_world * (center - self.eye);
        let row = |i: usize| view_from_face.row(i).extend(center_in_view[i]);
        let w = -row(2);
        let ImagePlane { half, center } = self.plane;
        // Of the middle of the image.
        let off = DVec2::ONE - center / half;
        PixelFromFace {
            x: (row(0) / half.x + w * off.x) * (0.5 * self.size.x),
            y: (w * off.y - row(1) / half.y) * (0.5 * self.size.y),
            w,
        }
    }
}

impl PixelFromFace {
    /// The transform to cells of `cell` sub-pixels, from an image whose texels have direction `scale` × texel + `bias`.
    /// The other fields are those of `about`.
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

/// A sample as the shaders look it up for a view with this eye.
pub(crate) fn view_sample(
    eye: DVec3,
    camera: &SampleCamera,
    face: &Face,
    (layer, mask): (u32, FaceMask),
) -> ViewSample {
    let [right, up, back] = [0, 1, 2].map(|i| face.view_from_world.row(i));
    let half = face.tan_half_fov;
    let off = DVec2::ONE - face.tan_center / half;
    ViewSample {
        u_from_world: ((right / half.x - back * off.x) * 0.5).as_vec3().to_array(),
        layer,
        v_from_world: ((-up / half.y - back * off.y) * 0.5).as_vec3().to_array(),
        faces: mask.bits(),
        w_from_world: (-back).as_vec3().to_array(),
        _pad_w: 0.0,
        eye_from_center: (eye - camera.center()).as_vec3().to_array(),
        _pad: 0.0,
    }
}

/// Margin of the bounds, as a share of their longest edge: one step of the default linear search. Without it, rays would
/// end on surfaces that lie in a face of the bounds, such as level ground.
const BOUNDS_MARGIN: f64 = 1.0 / 64.0;

/// The scene's bounds relative to an eye, widened by [`BOUNDS_MARGIN`]. Zero for an empty scene.
pub(crate) fn bounds_about(bounds: &Bounds, eye: DVec3) -> [[f32; 3]; 2] {
    if bounds.is_empty() {
        return [[0.0; 3]; 2];
    }
    let margin = BOUNDS_MARGIN * bounds.size().max_element();
    [(bounds.min - eye - margin).as_vec3().to_array(), (bounds.max - eye + margin).as_vec3().to_array()]
}
