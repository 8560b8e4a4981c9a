use argus_scene::{
    Bounds, Camera, Effect, InvalidField, Light, Lighting, Limits, Output, Plan, PlanRequest, Provenance,
    Rig, SampleCamera, SampleId, SampleSetInfo, Search, View,
};
use glam::DVec3;
use proptest::prelude::*;
use prost::Message;

use super::*;
use crate::tests::arbitrary;

/// Converts to the wire type and its bytes, and back, as between two processes.
fn across<W: Message + Default>(wire: W) -> W {
    W::decode(wire.encode_to_vec().as_slice()).unwrap()
}

proptest! {
    #[test]
    fn every_type_survives_the_wire(
        camera in arbitrary::camera(),
        bounds in arbitrary::bounds(),
        sample_camera in arbitrary::sample_camera(),
        rig in arbitrary::rig(),
        light in arbitrary::light(),
        lighting in arbitrary::lighting(),
        info in arbitrary::set_info(),
        id in arbitrary::sample_id(),
        output in arbitrary::output(),
    ) {
        prop_assert_eq!(Camera::try_from(across(v1::Camera::from(&camera))).unwrap(), camera);
        prop_assert_eq!(Bounds::try_from(across(v1::Bounds::from(bounds))).unwrap(), bounds);
        let wire = across(v1::SampleCamera::from(&sample_camera));
        prop_assert_eq!(SampleCamera::try_from(wire).unwrap(), sample_camera);
        prop_assert_eq!(Rig::try_from(across(v1::Rig::from(&rig))).unwrap(), rig);
        prop_assert_eq!(Light::try_from(across(v1::Light::from(&light))).unwrap(), light);
        prop_assert_eq!(Lighting::try_from(across(v1::Lighting::from(&lighting))).unwrap(), lighting);
        prop_assert_eq!(SampleSetInfo::try_from(across(v1::SampleSetInfo::from(&info))).unwrap(), info);
        prop_assert_eq!(SampleId::from(across(v1::SampleId::from(id))), id);
        prop_assert_eq!(Output::from_number(output.number(), "outputs").unwrap(), output);
    }

    #[test]
    fn every_view_plan_and_description_survives_the_wire(
        view in arbitrary::view(),
        plan in arbitrary::plan(),
        request in arbitrary::plan_request(),
        provenance in arbitrary::provenance(),
        description in arbitrary::description(),
    ) {
        prop_assert_eq!(View::try_from(across(v1::View::from(&view))).unwrap(), view);
        prop_assert_eq!(Plan::try_from(across(v1::Plan::from(&plan))).unwrap(), plan);
        prop_assert_eq!(PlanRequest::try_from(across(v1::PlanRequest::from(&request))).unwrap(), request);
        let wire = across(v1::Provenance::from(&provenance));
        prop_assert_eq!(Provenance::try_from(wire).unwrap(), provenance);
        let wire = across(v1::DescribeResponse::from(&description));
        prop_assert_eq!(Description::try_from(wire).unwrap(), description);
    }
}

fn view() -> v1::View {
    v1::View::from(&View {
        camera: Camera::look_at(DVec3::ONE, DVec3::ZERO),
        width: 200,
        height: 150,
        outputs: argus_scene::Outputs::COLOR,
        plan: PlanRequest::default(),
        pin: None,
        flow_to: None,
        rays: Default::default(),
    })
}

fn rejected(change: impl FnOnce(&mut v1::View)) -> InvalidField {
    let mut wire = view();
    change(&mut wire);
    View::try_from(wire).expect_err("must be rejected")
}

#[test]
fn a_malformed_view_is_rejected_with_the_invalid_field() {
    type Change = fn(&mut v1::View);
    type CameraChange = fn(&mut v1::Camera);
    let camera: [(&str, CameraChange); 9] = [
        ("camera.eye", |c| c.eye = None),
        ("camera.eye", |c| c.eye.as_mut().unwrap().x = f64::NAN),
        ("camera.target", |c| c.target = None),
        ("camera.target", |c| c.target.as_mut().unwrap().z = f64::NEG_INFINITY),
        ("camera.target", |c| c.target = c.eye),
        ("camera.up", |c| c.up.as_mut().unwrap().y = f64::INFINITY),
        ("camera.up", |c| c.up = c.eye),
        ("camera.fov_deg", |c| c.fov_deg = Some(f64::NAN)),
        ("camera.fov_deg", |c| c.fov_deg = Some(0.0)),
    ];
    for (field, change) in camera {
        assert_eq!(rejected(|v| change(v.camera.as_mut().unwrap())).field, field);
    }
    type LensChange = fn(&mut v1::Intrinsics);
    use v1::intrinsics::Distortion::{Fisheye, Opencv};
    let lens: [(&str, LensChange); 14] = [
        ("camera.intrinsics.fx", |k| k.fx = 0.0),
        ("camera.intrinsics.fx", |k| k.fx = f64::NAN),
        ("camera.intrinsics.fx", |k| k.fx = 1e10),
        ("camera.intrinsics.fy", |k| k.fy = -100.0),
        ("camera.intrinsics.fy", |k| k.fy = f64::INFINITY),
        ("camera.intrinsics.cx", |k| k.cx = f64::NAN),
        ("camera.intrinsics.cx", |k| k.cx = f64::NEG_INFINITY),
        ("camera.intrinsics.cy", |k| k.cy = 1e7),
        ("camera.intrinsics.pixel_center", |k| k.pixel_center = Some(0.25)),
        ("camera.intrinsics.pixel_center", |k| k.pixel_center = Some(f64::NAN)),
        ("camera.intrinsics.opencv.k1", |k| {
            k.distortion = Some(Opencv(v1::OpenCvDistortion { k1: f64::NAN, ..Default::default() }));
        }),
        ("camera.intrinsics.opencv.p2", |k| {
            k.distortion = Some(Opencv(v1::OpenCvDistortion { p2: f64::INFINITY, ..Default::default() }));
        }),
        ("camera.intrinsics.opencv.k6", |k| {
            k.distortion = Some(Opencv(v1::OpenCvDistortion { k6: 1e9, ..Default::default() }));
        }),
        ("camera.intrinsics.fisheye.k4", |k| {
            k.distortion = Some(Fisheye(v1::FisheyeDistortion { k4: f64::NAN, ..Default::default() }));
        }),
    ];
    for (field, change) in lens {
        let mut changed = intrinsics();
        change(&mut changed);
        assert_eq!(rejected(|v| set_lens(v, changed)).field, field);
    }
    let both = rejected(|v| {
        set_lens(v, intrinsics());
        v.camera.as_mut().unwrap().fov_deg = Some(45.0);
    });
    assert_eq!(both.field, "camera.fov_deg");
    let other: [(&str, Change); 5] = [
        ("camera", |v| v.camera = None),
        ("outputs", |v| v.outputs.push(0)),
        ("outputs", |v| v.outputs.push(77)),
        ("plan.search", |v| v.plan.as_mut().unwrap().search = Some(12)),
        ("pin.scene_hash", |v| v.pin = Some(v1::Provenance::default())),
    ];
    for (field, change) in other {
        assert_eq!(rejected(change).field, field);
    }
    assert_eq!(rejected(|v| v.outputs.push(77)).reason, "77 is not a known value");
}

fn intrinsics() -> v1::Intrinsics {
    v1::Intrinsics { fx: 200.0, fy: 210.0, cx: 99.5, cy: 74.5, pixel_center: None, distortion: None }
}

fn set_lens(view: &mut v1::View, intrinsics: v1::Intrinsics) {
    let camera = view.camera.as_mut().unwrap();
    (camera.fov_deg, camera.lens) = (None, Some(v1::camera::Lens::Intrinsics(intrinsics)));
}

#[test]
fn a_principal_point_of_either_pixel_rule_means_the_same_place() {
    let lens = |pixel_center, at| {
        let mut wire = view();
        let intrinsics = v1::Intrinsics { pixel_center, cx: at, cy: at, ..intrinsics() };
        set_lens(&mut wire, intrinsics);
        View::try_from(wire).unwrap().camera.lens
    };
    assert_eq!(lens(Some(0.0), 99.5), lens(Some(0.5), 100.0));
    assert_eq!(lens(None, 100.0), lens(Some(0.5), 100.0));
    assert_ne!(lens(None, 100.0), lens(Some(0.0), 100.0));
}

#[test]
fn absent_fields_of_a_view_have_documented_defaults() {
    let mut wire = view();
    wire.plan = None;
    let camera = wire.camera.as_mut().unwrap();
    (camera.up, camera.fov_deg) = (None, None);
    let view = View::try_from(wire).unwrap();
    assert_eq!((view.camera.up, view.camera.fov_deg), (DVec3::Y, 45.0));
    assert_eq!(view.plan, PlanRequest::default());
    let unspecified = v1::PlanRequest { search: Some(0), ..Default::default() };
    assert_eq!(PlanRequest::try_from(unspecified).unwrap().search, None);
}

#[test]
fn an_invalid_pinned_plan_is_rejected_with_a_field_below_pin() {
    let pinned = |plan| {
        let provenance = v1::Provenance { scene_hash: vec![7; 32].into(), plan, ..Default::default() };
        rejected(|v| v.pin = Some(provenance))
    };
    let direct = |samples_per_pixel| {
        let kind = v1::plan::Kind::Direct(v1::DirectPlan { samples_per_pixel, ..Default::default() });
        Some(v1::Plan { kind: Some(kind) })
    };
    for samples_per_pixel in [0, 3, 289, u32::MAX] {
        let at = pinned(direct(samples_per_pixel));
        assert_eq!(at.field, "pin.plan");
        assert!(at.reason.contains("plan.direct.samples_per_pixel"), "{at}");
    }
    assert_eq!(pinned(None).field, "pin");
    let warp = |change: fn(&mut v1::WarpPlan)| {
        let mut plan = v1::WarpPlan {
            search: v1::Search::Linear as i32,
            steps: 8,
            supersampling: 1,
            samples: vec![SampleId { version: 0, camera: 0 }.into()],
            holes: v1::Holes::Unspecified as i32,
            faces: Vec::new(),
            frames: Vec::new(),
        };
        change(&mut plan);
        Plan::try_from(v1::Plan { kind: Some(v1::plan::Kind::Warp(plan)) })
    };
    assert!(warp(|_| ()).is_ok());
    assert!(warp(|p| (p.search, p.steps) = (v1::Search::Splat as i32, 0)).is_ok());
    let field = |change| warp(change).unwrap_err().field;
    assert_eq!(field(|p| p.steps = 0), "plan.warp.steps");
    assert_eq!(field(|p| p.supersampling = 9), "plan.warp.supersampling");
    assert_eq!(field(|p| p.samples.clear()), "plan.warp.samples");
    assert_eq!(field(|p| p.faces = vec![0]), "plan.warp.faces");
    assert_eq!(field(|p| p.faces = vec![64]), "plan.warp.faces");
    assert_eq!(field(|p| p.faces = vec![1, 1]), "plan.warp.faces");
    assert_eq!(field(|p| p.search = 0), "plan.warp.search");
    assert_eq!(field(|p| p.search = 9), "plan.warp.search");
}

#[test]
fn a_plan_whose_frames_cannot_be_rendered_is_refused_with_the_frame_and_its_field() {
    let frame = v1::FrameSource {
        camera: Some((&Camera::look_at(DVec3::ZERO, DVec3::X)).into()),
        width: 4,
        height: 3,
        samples_per_pixel: 1,
        light: 0,
        reflections_by_rays: false,
        band_rows: 0,
    };
    let refused = |frames: Vec<v1::FrameSource>, samples: Vec<v1::SampleId>| {
        let (search, steps, supersampling) = (v1::Search::Splat as i32, 0, 1);
        let plan = v1::WarpPlan { search, steps, supersampling, frames, samples, ..Default::default() };
        Plan::try_from(v1::Plan { kind: Some(v1::plan::Kind::Warp(plan)) })
    };
    assert_eq!(refused(vec![frame; 2], Vec::new()).unwrap().frames().len(), 2);
    let reason = |change: fn(&mut v1::FrameSource)| {
        let mut wrong = frame;
        change(&mut wrong);
        let at = refused(vec![frame, wrong], Vec::new()).unwrap_err();
        assert_eq!(at.field, "plan.warp.frames");
        at.reason.to_string()
    };
    assert!(reason(|f| f.camera = None).starts_with("frame 1: camera"));
    assert!(reason(|f| f.camera.as_mut().unwrap().fov_deg = Some(f64::NAN)).contains("camera.fov_deg"));
    assert!(reason(|f| f.width = 0).starts_with("frame 1: width"));
    assert!(reason(|f| f.height = 0).starts_with("frame 1: height"));
    for samples_per_pixel in [0, 3, 1024] {
        let wrong = v1::FrameSource { samples_per_pixel, ..frame };
        assert!(refused(vec![wrong], Vec::new()).unwrap_err().reason.contains("samples_per_pixel"));
    }
    assert_eq!(refused(vec![frame; 5], Vec::new()).unwrap_err().reason, "must be at most 4, not 5");
    let mixed = refused(vec![frame], vec![SampleId { version: 0, camera: 0 }.into()]).unwrap_err();
    assert_eq!(mixed.field, "plan.warp.samples");
}

#[test]
fn a_plan_of_nine_cameras_is_refused() {
    let plan = |count: u64| {
        let samples = (0..count).map(|camera| SampleId { version: 0, camera }.into()).collect();
        let (search, steps, supersampling) = (v1::Search::Splat as i32, 0, 1);
        let plan = v1::WarpPlan { search, steps, supersampling, samples, ..Default::default() };
        Plan::try_from(v1::Plan { kind: Some(v1::plan::Kind::Warp(plan)) })
    };
    assert!(plan(8).is_ok());
    let refused = plan(9).unwrap_err();
    assert_eq!((refused.field, &*refused.reason), ("plan.warp.samples", "must be 1 to 8, not 9"));
}

#[test]
fn lights_and_rigs_with_non_finite_values_are_rejected() {
    let sun = |change: fn(&mut v1::DirectionalLight)| {
        let mut light = v1::DirectionalLight {
            direction: Some(DVec3::NEG_Y.into()),
            irradiance: Some(glam::Vec3::ONE.into()),
            angular_radius: 0.0,
        };
        change(&mut light);
        Light::try_from(v1::Light { kind: Some(v1::light::Kind::Directional(light)) })
    };
    assert!(sun(|_| ()).is_ok());
    assert!(sun(|l| l.irradiance.as_mut().unwrap().g = f32::NAN).is_err());
    assert!(sun(|l| l.irradiance.as_mut().unwrap().g = -1.0).is_err());
    assert!(sun(|l| l.direction = Some(DVec3::ZERO.into())).is_err());
    let mut lighting = v1::Lighting::from(&Lighting::default());
    lighting.exposure = f32::INFINITY;
    assert_eq!(Lighting::try_from(lighting).unwrap_err().field, "lighting.exposure");
    let cell = v1::CellRig { origin: Some(DVec3::ZERO.into()), spacing: f64::NAN, face: 64 };
    let rig = v1::Rig { kind: Some(v1::rig::Kind::Cell(cell)) };
    assert_eq!(Rig::try_from(rig).unwrap_err().field, "rig.spacing");
    let half = v1::Bounds { min: Some(DVec3::ZERO.into()), max: None };
    assert_eq!(Bounds::try_from(half).unwrap_err().field, "bounds.max");
    let none = v1::Limits::from(Limits { max_side: 0, max_pixels: 1 });
    assert_eq!(Limits::try_from(none).unwrap_err().field, "limits");
    assert!(Effect::from_number(0, "effects").is_err());
    assert_eq!(Search::Linear.number(), v1::Search::Linear as i32);
}
