//! Strategies for views: outputs, plans, provenance.

use argus_scene::{
    CellSettings, Detail, FaceMask, FrameSource, Holes, Output, Outputs, Plan, PlanRequest, Preset,
    Provenance, RayList, SampleId, Search, SurfaceLight, View, Warp,
};
use glam::Vec3;
use proptest::option;
use proptest::prelude::*;

use super::scenes::{camera, pinhole, scene_hash, scene_state, specification};

pub(crate) fn outputs() -> impl Strategy<Value = Outputs> {
    prop::sample::subsequence(Output::ALL.to_vec(), 0..=Output::ALL.len())
        .prop_map(|members| members.into_iter().collect())
}

pub(crate) fn output() -> impl Strategy<Value = Output> {
    prop::sample::select(Output::ALL.to_vec())
}

fn search() -> impl Strategy<Value = Search> {
    prop::sample::select(Search::ALL.to_vec())
}

fn holes() -> impl Strategy<Value = Holes> {
    prop::sample::select(vec![Holes::Mark, Holes::Trace])
}

fn detail() -> impl Strategy<Value = Detail> {
    prop::sample::select(Detail::ALL.to_vec())
}

fn preset() -> impl Strategy<Value = Preset> {
    prop::sample::select(vec![Preset::Interactive, Preset::Balanced, Preset::Exact])
}

pub(crate) fn plan_request() -> impl Strategy<Value = PlanRequest> {
    let number = || option::of(any::<u32>());
    let real = || option::of(any::<f64>().prop_filter("comparable", |x| !x.is_nan()));
    (
        (any::<bool>(), option::of(detail()), option::of(search()), number(), number(), number()),
        (option::of(holes()), option::of(preset()), real(), real()),
    )
        .prop_map(
            |(
                (direct, detail, search, steps, supersampling, samples),
                (holes, preset, max_error, deadline_ms),
            )| {
                PlanRequest {
                    direct,
                    detail,
                    search,
                    steps,
                    supersampling,
                    samples,
                    holes,
                    preset,
                    max_error,
                    deadline_ms,
                }
            },
        )
}

pub(crate) fn sample_id() -> impl Strategy<Value = SampleId> {
    any::<(u64, u64)>().prop_map(|(version, camera)| SampleId { version, camera })
}

fn frame_source() -> impl Strategy<Value = FrameSource> {
    (pinhole(), 1..=8192u32, 1..=8192u32, 1..=16u32).prop_map(|(camera, width, height, side)| FrameSource {
        camera,
        width,
        height,
        samples_per_pixel: side * side,
        band_rows: height / side,
        light: None,
    })
}

fn surface_light() -> impl Strategy<Value = Option<SurfaceLight>> {
    let cells = [true, false]
        .map(|reflected| CellSettings::RAYS.map(|rays| Some(SurfaceLight::Cells { rays, reflected })));
    let older = [true, false]
        .map(|reflected| CellSettings::RAYS.map(|rays| Some(SurfaceLight::OlderCells { rays, reflected })));
    prop::sample::select([vec![None, Some(SurfaceLight::Rays)], cells.concat(), older.concat()].concat())
}

pub(crate) fn plan() -> impl Strategy<Value = Plan> {
    let samples = prop::collection::vec(sample_id(), 1..=8);
    prop_oneof![
        (1..=16u32, detail(), surface_light()).prop_map(|(side, detail, light)| Plan::Direct {
            samples_per_pixel: side * side,
            detail,
            light
        }),
        (search(), 1..=4096u32, 1..=8u32, samples, holes(), prop::option::of(1..=63u32)).prop_map(
            |(search, steps, supersampling, samples, holes, bits)| {
                let mask = bits.map(|bits| FaceMask::new(bits, "faces").unwrap());
                let first = samples.first().filter(|id| !id.is_reflection_probe());
                let faces = first.into_iter().filter_map(|id| Some((id.camera, mask?))).collect();
                Plan::Warp(Warp { search, steps, supersampling, samples, faces, holes, ..Warp::default() })
            }
        ),
        (search(), 1..=4096u32, 1..=8u32, prop::collection::vec(frame_source(), 1..=4), holes()).prop_map(
            |(search, steps, supersampling, frames, holes)| {
                Plan::Warp(Warp { search, steps, supersampling, frames, holes, ..Warp::default() })
            }
        ),
    ]
}

pub(crate) fn provenance() -> impl Strategy<Value = Provenance> {
    let specification = option::of(specification());
    (scene_hash(), scene_state(), plan(), specification, ".{0,20}", any::<bool>()).prop_map(
        |(scene, state, plan, specification, device, history)| Provenance {
            scene,
            state,
            plan,
            specification,
            device,
            history,
        },
    )
}

pub(crate) fn view() -> impl Strategy<Value = View> {
    let size = (any::<u32>(), any::<u32>());
    let rays = prop::collection::vec(prop::array::uniform3(-1e3..1e3f32).prop_map(Vec3::from), 1..9);
    let rays = option::of(rays.prop_map(|directions| RayList::new(directions).unwrap()));
    (camera(), size, outputs(), plan_request(), option::of(provenance()), option::of(camera()), rays)
        .prop_map(|(camera, (width, height), outputs, plan, pin, flow_to, rays)| View {
            camera,
            width,
            height,
            outputs,
            plan,
            pin,
            flow_to,
            rays,
        })
}
