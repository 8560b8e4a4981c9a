//! What a caller wants of each frame.

use argus_scene::{Camera, Distortion, Intrinsics, Lens, Outputs, PlanRequest, View};
use glam::{DVec2, DVec3};
use pyo3::prelude::*;
use serde_json::{Map, Value};

use crate::error::invalid;
use crate::images::named;

/// A view without its camera.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Wanted {
    pub(crate) width: u32,
    pub(crate) height: u32,
    pub(crate) outputs: Outputs,
    pub(crate) plan: PlanRequest,
}

impl Wanted {
    /// `size`: rows, pixels of a row. `plan`: JSON of the options that are set, by the names of [`PlanRequest`].
    ///
    /// # Errors
    /// `InvalidField` for a size without pixels, an unknown output, or an option of the plan that does not have its type.
    pub(crate) fn of(
        py: Python<'_>,
        size: (u32, u32),
        outputs: impl IntoIterator<Item = impl AsRef<str>>,
        plan: &str,
    ) -> PyResult<Self> {
        if size.0 == 0 || size.1 == 0 {
            return Err(invalid(py, "size", format!("{} × {} has no pixels", size.0, size.1)));
        }
        let mut images = Outputs::NONE;
        for output in outputs {
            images = images.with(named(py, output.as_ref())?);
        }
        Ok(Self { width: size.1, height: size.0, outputs: images, plan: plan_of(py, plan)? })
    }

    /// The view of a camera.
    pub(crate) fn view(&self, camera: Camera) -> View {
        let Self { width, height, outputs, plan } = *self;
        View { camera, width, height, outputs, plan, pin: None, flow_to: None, rays: None }
    }

    /// Pixels of a frame.
    pub(crate) fn pixels(&self) -> usize {
        self.width as usize * self.height as usize
    }
}

/// Parses the options one by one, so that an error names its option.
fn plan_of(py: Python<'_>, json: &str) -> PyResult<PlanRequest> {
    let options: Map<String, Value> =
        serde_json::from_str(json).map_err(|error| invalid(py, "plan", error.to_string()))?;
    let mut plan = PlanRequest::default();
    for (name, value) in options {
        let parsed = match name.as_str() {
            "direct" => serde_json::from_value(value).map(|value| plan.direct = value),
            "detail" => serde_json::from_value(value).map(|value| plan.detail = value),
            "search" => serde_json::from_value(value).map(|value| plan.search = value),
            "steps" => serde_json::from_value(value).map(|value| plan.steps = value),
            "supersampling" => serde_json::from_value(value).map(|value| plan.supersampling = value),
            "samples" => serde_json::from_value(value).map(|value| plan.samples = value),
            "holes" => serde_json::from_value(value).map(|value| plan.holes = value),
            "preset" => serde_json::from_value(value).map(|value| plan.preset = value),
            "max_error" => serde_json::from_value(value).map(|value| plan.max_error = value),
            "deadline_ms" => serde_json::from_value(value).map(|value| plan.deadline_ms = value),
            _ => return Err(invalid(py, &format!("plan.{name}"), "is no option of a plan")),
        };
        parsed.map_err(|error| invalid(py, &format!("plan.{name}"), error.to_string()))?;
    }
    Ok(plan)
}

/// A pose in world space (y up, metres): the eye, the direction of view, the direction up in the image.
pub(crate) type Pose = [f64; 9];

/// A lens by its kind and its numbers: `fov` degrees, `pinhole` fx fy cx cy, `opencv` and `fisheye` with their coefficients after
/// these, `equirectangular` without any. Pixels count from the image's top left corner.
pub(crate) type LensRow = (String, Vec<f64>);

/// The camera of a pose and a lens.
///
/// # Errors
/// `InvalidField` if the lens is of no such kind, or has other numbers.
pub(crate) fn camera(py: Python<'_>, pose: &Pose, (kind, numbers): &LensRow) -> PyResult<Camera> {
    let [ex, ey, ez, dx, dy, dz, ux, uy, uz] = *pose;
    let eye = DVec3::new(ex, ey, ez);
    // At a distance of the coordinates' own size, so that the direction keeps its digits far from the origin.
    let target = eye + DVec3::new(dx, dy, dz) * eye.abs().max_element().max(1.0);
    let usual = Camera { up: DVec3::new(ux, uy, uz), ..Camera::look_at(eye, target) };
    if let ("fov", [fov_deg]) = (kind.as_str(), numbers.as_slice()) {
        return Ok(Camera { fov_deg: *fov_deg, ..usual });
    }
    let lens = lens(kind, numbers);
    let known = lens.ok_or_else(|| invalid(py, "lens", format!("{kind} of {} numbers", numbers.len())))?;
    Ok(Camera { lens: Some(known), ..usual })
}

fn lens(kind: &str, numbers: &[f64]) -> Option<Lens> {
    if kind == "equirectangular" {
        return numbers.is_empty().then_some(Lens::Equirectangular);
    }
    let (&[fx, fy, cx, cy], coefficients) = numbers.split_first_chunk()?;
    let distortion = match kind {
        "pinhole" if coefficients.is_empty() => Distortion::None,
        "opencv" => Distortion::Rational(coefficients.try_into().ok()?),
        "fisheye" => Distortion::Fisheye(coefficients.try_into().ok()?),
        _ => return None,
    };
    Some(Lens::Intrinsics(Intrinsics { focal: DVec2::new(fx, fy), center: DVec2::new(cx, cy), distortion }))
}
