//! Views: requests of clients.

use serde::{Deserialize, Serialize};

use crate::{Camera, Detail, Holes, InvalidField, Lens, Output, Outputs, Plan, Provenance, RayList, Search};

/// A named goal for quality; the explicit settings of a [`PlanRequest`] override it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Preset {
    /// The cheapest plan, for the shortest wait.
    Interactive,
    /// The smallest error within about twice the cheapest plan's time.
    Balanced,
    /// No pixel is guessed: holes are traced and edges supersampled.
    Exact,
}

/// A client's settings of the plan; the service chooses those that are unset.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct PlanRequest {
    /// Render from the triangles.
    pub direct: bool,
    /// How much of a view from triangles is rendered; only with `direct`.
    pub detail: Option<Detail>,
    /// Search for a pixel's depth.
    pub search: Option<Search>,
    /// Linear steps, 1 to 4096.
    pub steps: Option<u32>,
    /// Sub-pixels per pixel and side, 1 to 8; the cost grows with the square.
    pub supersampling: Option<u32>,
    /// Largest number of samples, 1 to 8.
    pub samples: Option<u32>,
    /// Treatment of pixels that no sample saw.
    pub holes: Option<Holes>,
    /// A named goal for quality.
    pub preset: Option<Preset>,
    /// Largest accepted mean FLIP against the reference, above 0 and up to 1.
    pub max_error: Option<f64>,
    /// Longest rendering time in milliseconds, above 0 and up to an hour.
    pub deadline_ms: Option<f64>,
}

impl PlanRequest {
    /// A view from samples; the request waits until they are rendered.
    pub fn from_samples() -> Self {
        Self { search: Some(Search::default()), ..Self::default() }
    }

    /// Whether the service may choose between triangles and samples: the request names neither and sets no setting that
    /// only one of them has.
    pub fn leaves_way_open(&self) -> bool {
        let Self { direct, detail, search, steps, samples, holes, max_error, .. } = *self;
        let names_one = direct
            || detail.is_some()
            || search.is_some()
            || steps.is_some()
            || samples.is_some()
            || holes.is_some();
        !names_one && max_error.is_none()
    }
}

/// A client's request for an image.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct View {
    /// Viewpoint.
    pub camera: Camera,
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Images of the answer.
    pub outputs: Outputs,
    /// Settings of the plan.
    pub plan: PlanRequest,
    /// Requires exactly this provenance (its plan, epoch and specification); an error if it is not available.
    pub pin: Option<Provenance>,
    /// The camera that flow leads to; with that output alone.
    pub flow_to: Option<Camera>,
    /// The pixels' directions, of a camera of listed rays alone.
    pub rays: Option<RayList>,
}

/// The largest accepted view.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Limits {
    /// Pixels on a side.
    pub max_side: u32,
    /// Pixels in all.
    pub max_pixels: u64,
}

impl Default for Limits {
    fn default() -> Self {
        Self { max_side: 8192, max_pixels: 16 << 20 }
    }
}

impl View {
    /// The colour of a view, with nothing else.
    pub fn new(camera: Camera, [width, height]: [u32; 2], plan: PlanRequest) -> Self {
        Self { camera, width, height, outputs: Outputs::COLOR, plan, pin: None, flow_to: None, rays: None }
    }

    /// Whether the service may choose how the view is answered. Without a pinhole's image it is rendered from triangles.
    pub fn leaves_way_open(&self) -> bool {
        self.pin.is_none() && self.plan.leaves_way_open() && self.camera.is_pinhole()
    }

    /// Rejects a list of rays that is not that of the camera and the image, and a plan with several rays a pixel.
    fn check_rays(&self) -> Result<(), InvalidField> {
        let refused = |field, reason: String| Err(InvalidField::new(field, reason));
        let is_listed = matches!(self.camera.lens, Some(Lens::Rays { .. }));
        let Some(list) = &self.rays else {
            return match is_listed {
                true => refused("rays", "must be given, since the camera has no other".to_owned()),
                false => Ok(()),
            };
        };
        if !is_listed {
            return refused("rays", "must not be given: the camera has a lens of its own".to_owned());
        }
        let (pixels, rays) = (u64::from(self.width) * u64::from(self.height), list.directions().len() as u64);
        if rays != pixels {
            return refused("rays", format!("must be one for each of {pixels} pixels, not {rays}"));
        }
        let pinned = self.pin.as_ref().is_some_and(|pin| pin.plan.sub_pixels(1) > 1);
        let one_ray = "a pixel of listed rays is one ray";
        let fields = [
            ("plan.supersampling", self.plan.supersampling.is_some_and(|side| side > 1), one_ray),
            ("pin.plan", pinned, one_ray),
            ("outputs", self.outputs.has(Output::Flow), "flow is between images of pinholes"),
        ];
        let wrong = fields.into_iter().find(|(_, wrong, _)| *wrong);
        wrong.map_or(Ok(()), |(field, _, reason)| refused(field, reason.to_owned()))
    }

    /// Rejects a plan that needs a pinhole, where the camera is none.
    fn check_lens(&self) -> Result<(), InvalidField> {
        if self.camera.is_pinhole() {
            return Ok(());
        }
        let PlanRequest { search, steps, samples, holes, detail, .. } = self.plan;
        let set = [
            ("plan.search", search.is_some()),
            ("plan.steps", steps.is_some()),
            ("plan.samples", samples.is_some()),
            ("plan.holes", holes.is_some()),
            ("pin.plan", self.pin.as_ref().is_some_and(|pin| matches!(pin.plan, Plan::Warp(_)))),
        ];
        if let Some((field, _)) = set.into_iter().find(|(_, set)| *set) {
            let reason = "is of views from samples, which a camera that is no pinhole has none of: it is \
                          rendered from triangles";
            return Err(InvalidField::new(field, reason));
        }
        let pinned = self.pin.as_ref().and_then(|pin| match pin.plan {
            Plan::Direct { detail, .. } => Some(detail),
            Plan::Warp(_) => None,
        });
        let reduced = |detail: Option<Detail>| detail.is_some_and(|detail| detail.scale() > 1);
        let fields = [("plan.detail", reduced(detail)), ("pin.plan", reduced(pinned))];
        match fields.into_iter().find(|(_, reduced)| *reduced) {
            Some((field, _)) => {
                let reason = "an image of no pinhole is rendered in its own size: full or few-rays";
                Err(InvalidField::new(field, reason))
            }
            None => Ok(()),
        }
    }

    /// Rejects an invalid view by field. Code behind this check need not repeat it.
    pub fn validate(&self, limits: &Limits) -> Result<(), InvalidField> {
        self.camera.validate()?;
        InvalidField::within("width", self.width, 1..=limits.max_side)?;
        InvalidField::within("height", self.height, 1..=limits.max_side)?;
        let pixels = u64::from(self.width) * u64::from(self.height);
        if pixels > limits.max_pixels {
            let reason = format!("width × height must be at most {} pixels, not {pixels}", limits.max_pixels);
            return Err(InvalidField::new("width", reason));
        }
        match &self.flow_to {
            None if self.outputs.has(Output::Flow) => {
                return Err(InvalidField::new("flow_to", "must be given, since flow is asked for"));
            }
            Some(_) if !self.outputs.has(Output::Flow) => {
                return Err(InvalidField::new("flow_to", "must not be given, since no flow is asked for"));
            }
            Some(to) => {
                let at = |e: InvalidField| InvalidField::new("flow_to", format!("{}: {}", e.field, e.reason));
                to.validate().map_err(at)?;
                if !to.is_pinhole() {
                    return Err(InvalidField::new(
                        "flow_to",
                        "must be a pinhole: flow to other lenses is not found",
                    ));
                }
            }
            None => {}
        }
        if self.outputs == Outputs::NONE {
            return Err(InvalidField::new("outputs", "at least one output must be asked for"));
        }
        self.check_lens()?;
        self.check_rays()?;
        let within = |field, value: Option<u32>, most| {
            value.map_or(Ok(0), |value| InvalidField::within(field, value, 1..=most))
        };
        within("plan.steps", self.plan.steps, 4096)?;
        within("plan.supersampling", self.plan.supersampling, 8)?;
        within("plan.samples", self.plan.samples, 8)?;
        if self.plan.detail.is_some() && !self.plan.direct {
            return Err(InvalidField::new(
                "plan.detail",
                "is of views from triangles: ask for `direct`, too",
            ));
        }
        // Written so that NaN is refused.
        if self.plan.max_error.is_some_and(|e| !(e > 0.0 && e <= 1.0)) {
            return Err(InvalidField::new("plan.max_error", "must be a mean FLIP above 0 and up to 1"));
        }
        if self.plan.deadline_ms.is_some_and(|ms| !(ms > 0.0 && ms <= 3.6e6)) {
            return Err(InvalidField::new("plan.deadline_ms", "must be above 0 and at most an hour"));
        }
        if self.pin.as_ref().is_some_and(|pin| pin.history) {
            let reason = "began from an earlier frame of its session: it cannot be repeated";
            return Err(InvalidField::new("pin.history", reason));
        }
        let (field, per_pixel) = match self.pin.as_ref().map(|pin| &pin.plan) {
            Some(plan) => ("pin.plan", plan.sub_pixels(1)),
            None => ("plan.supersampling", u64::from(self.plan.supersampling.unwrap_or(1)).pow(2)),
        };
        if pixels.saturating_mul(per_pixel) > limits.max_pixels.saturating_mul(16) {
            let reason = "width × height × supersampling² is more than this service renders";
            return Err(InvalidField::new(field, reason));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use glam::Vec3;

    use crate::Warp;

    fn view() -> View {
        View {
            camera: Camera::look_at(DVec3::ONE, DVec3::ZERO),
            width: 200,
            height: 150,
            outputs: Outputs::COLOR,
            plan: PlanRequest::default(),
            pin: None,
            flow_to: None,
            rays: None,
        }
    }

    #[test]
    fn a_request_with_a_method_or_one_of_its_settings_leaves_no_choice() {
        let open = PlanRequest::default();
        let preset = PlanRequest { preset: Some(Preset::Balanced), deadline_ms: Some(20.0), ..open };
        let finer = PlanRequest { supersampling: Some(2), ..open };
        assert!([open, preset, finer].iter().all(PlanRequest::leaves_way_open));
        let named = [
            PlanRequest { direct: true, ..open },
            PlanRequest { detail: Some(Detail::Half), ..open },
            PlanRequest { search: Some(Search::Splat), ..open },
            PlanRequest { steps: Some(8), ..open },
            PlanRequest { samples: Some(4), ..open },
            PlanRequest { holes: Some(Holes::Trace), ..open },
            PlanRequest { max_error: Some(0.1), ..open },
        ];
        assert!(!named.iter().any(PlanRequest::leaves_way_open));
    }

    #[test]
    fn a_view_without_a_pinhole_is_rendered_from_triangles_alone() {
        let camera = Camera { lens: Some(Lens::Equirectangular), ..view().camera };
        let round = |plan| View { camera, plan, ..view() };
        let open = PlanRequest::default();
        let limits = Limits::default();
        assert!(view().leaves_way_open() && !round(open).leaves_way_open());
        for allowed in [
            open,
            PlanRequest { direct: true, supersampling: Some(2), ..open },
            PlanRequest { preset: Some(Preset::Exact), max_error: Some(0.1), ..open },
            PlanRequest { direct: true, detail: Some(Detail::FewRays), ..open },
        ] {
            round(allowed).validate(&limits).unwrap();
        }
        let field = |plan| round(plan).validate(&limits).unwrap_err().field;
        assert_eq!(field(PlanRequest { search: Some(Search::Splat), ..open }), "plan.search");
        assert_eq!(field(PlanRequest { steps: Some(8), ..open }), "plan.steps");
        assert_eq!(field(PlanRequest { samples: Some(4), ..open }), "plan.samples");
        assert_eq!(field(PlanRequest { holes: Some(Holes::Trace), ..open }), "plan.holes");
        let half = PlanRequest { direct: true, detail: Some(Detail::Half), ..open };
        assert_eq!(field(half), "plan.detail");
        let pinned = |plan| {
            let pin = Provenance::of_plan(crate::SceneHash([0; 32]), crate::SceneState::default(), plan);
            View { pin: Some(pin), ..round(open) }.validate(&limits)
        };
        pinned(Plan::direct(4)).unwrap();
        assert_eq!(pinned(Plan::Warp(Warp::default())).unwrap_err().field, "pin.plan");
        let half = Plan::Direct { samples_per_pixel: 1, detail: Detail::Half, light: None };
        assert_eq!(pinned(half).unwrap_err().field, "pin.plan");
    }

    #[test]
    fn a_list_of_rays_goes_with_its_camera_its_size_and_one_ray_a_pixel() {
        let camera = Camera { lens: Some(Lens::Rays { spacing_deg: 0.5 }), ..view().camera };
        let rays = RayList::new(vec![Vec3::X; 12]).ok();
        let listed = View { camera, width: 4, height: 3, rays, ..view() };
        let limits = Limits::default();
        listed.validate(&limits).unwrap();
        assert!(!listed.leaves_way_open());
        let finer = PlanRequest { direct: true, supersampling: Some(2), ..PlanRequest::default() };
        let pin =
            Provenance::of_plan(crate::SceneHash([0; 32]), crate::SceneState::default(), Plan::direct(4));
        let flow = Outputs::only(Output::Flow);
        for (wrong, field) in [
            (View { rays: None, ..listed.clone() }, "rays"),
            (View { camera: view().camera, ..listed.clone() }, "rays"),
            (View { height: 4, ..listed.clone() }, "rays"),
            (View { plan: finer, ..listed.clone() }, "plan.supersampling"),
            (View { pin: Some(pin), ..listed.clone() }, "pin.plan"),
            (View { outputs: flow, flow_to: Some(view().camera), ..listed.clone() }, "outputs"),
            (View { plan: PlanRequest::from_samples(), ..listed.clone() }, "plan.search"),
        ] {
            assert_eq!(wrong.validate(&limits).unwrap_err().field, field);
        }
        for spacing_deg in [0.0, -1.0, 181.0, f64::NAN] {
            let camera = Camera { lens: Some(Lens::Rays { spacing_deg }), ..camera };
            let refused = View { camera, ..listed.clone() }.validate(&limits).unwrap_err();
            assert_eq!(refused.field, "camera.listed_rays.spacing_deg", "{spacing_deg}");
        }
    }

    #[test]
    fn sizes_and_settings_outside_their_limits_are_rejected_by_name() {
        let limits = Limits::default();
        let field = |change: fn(&mut View)| {
            let mut view = view();
            change(&mut view);
            view.validate(&limits).expect_err("must be rejected").field
        };
        assert_eq!(field(|v| v.width = 0), "width");
        assert_eq!(field(|v| v.height = 0), "height");
        assert_eq!(field(|v| v.width = 8193), "width");
        assert_eq!(field(|v| (v.width, v.height) = (8192, 4096)), "width");
        assert_eq!(field(|v| v.outputs = Outputs::NONE), "outputs");
        assert_eq!(field(|v| v.outputs = Outputs::only(Output::Flow)), "flow_to");
        assert_eq!(field(|v| v.flow_to = Some(v.camera)), "flow_to");
        assert_eq!(
            field(|v| {
                v.outputs = Outputs::only(Output::Flow);
                v.flow_to = Some(Camera { fov_deg: 180.0, ..v.camera });
            }),
            "flow_to"
        );
        assert_eq!(field(|v| v.plan.steps = Some(0)), "plan.steps");
        assert_eq!(field(|v| v.plan.supersampling = Some(9)), "plan.supersampling");
        assert_eq!(field(|v| v.plan.samples = Some(0)), "plan.samples");
        assert_eq!(field(|v| v.plan.detail = Some(Detail::Half)), "plan.detail");
        for wrong in [0.0, -1.0, 1.5, f64::NAN] {
            let wish = PlanRequest { max_error: Some(wrong), ..PlanRequest::default() };
            let rejected = View { plan: wish, ..view() }.validate(&limits).unwrap_err();
            assert_eq!(rejected.field, "plan.max_error", "{wrong}");
        }
        for wrong in [0.0, -1.0, f64::INFINITY, f64::NAN] {
            let wish = PlanRequest { deadline_ms: Some(wrong), ..PlanRequest::default() };
            let rejected = View { plan: wish, ..view() }.validate(&limits).unwrap_err();
            assert_eq!(rejected.field, "plan.deadline_ms", "{wrong}");
        }
        assert_eq!(field(|v| v.camera.eye.x = f64::NAN), "camera.eye");
        let large = |v: &mut View| (v.width, v.height, v.plan.supersampling) = (4096, 4096, Some(8));
        assert_eq!(field(large), "plan.supersampling");
        let pin = |plan| {
            let scene = crate::SceneHash([0; 32]);
            Some(Provenance::of_plan(scene, crate::SceneState::default(), plan))
        };
        let direct = pin(Plan::direct(64));
        let pinned = View { width: 4096, height: 4096, pin: direct, ..view() };
        assert_eq!(pinned.validate(&limits).unwrap_err().field, "pin.plan");
        let begun = pin(Plan::direct(1)).map(|pin| Provenance { history: true, ..pin });
        assert_eq!(View { pin: begun, ..view() }.validate(&limits).unwrap_err().field, "pin.history");
        view().validate(&limits).unwrap();
    }
}
