//! Strategies for answers: frames, samples, descriptions.

use argus_scene::effects::{Causes, EffectKind, EffectRow, Paid};
use argus_scene::frame::{Decision, Reason};
use argus_scene::scene::NamedCamera;
use argus_scene::{
    Camera, Effect, EffectPlan, FaceMask, Frame, Limits, Outputs, Plane, PlaneData, PlaneFormat, PlaneKind,
    Prediction, ReflectionProbeSet, Reflections, Rig, Sample, SampleId, SampleSetInfo, Served, Stage,
};
use bytes::Bytes;
use glam::DVec3;
use proptest::option;
use proptest::prelude::*;

use super::scenes::{bounds, camera, light_level, rig, scene_hash, set_info};
use super::views::{outputs, plan_request, provenance};
use crate::Description;
use crate::chunks::FrameMeta;

pub(crate) fn stages() -> impl Strategy<Value = Vec<Stage>> {
    let stage = ("[a-z ]{1,12}", 0.0..1e4f64).prop_map(|(name, ms)| Stage::new(name, ms));
    prop::collection::vec(stage, 0..4)
}

fn effect_row() -> impl Strategy<Value = EffectRow> {
    let indices = || prop::collection::vec(any::<u32>(), 0..4);
    let causes = (indices(), indices(), indices(), indices(), any::<bool>()).prop_map(
        |(materials, lights, nodes, instances, sky)| Causes { materials, lights, nodes, instances, sky },
    );
    let paid = prop::sample::subsequence(vec![Paid::Sample, Paid::View, Paid::Epoch, Paid::Pose], 0..=4);
    let ms = || option::of(0.0..1e5f64);
    let effect = prop::sample::select(EffectKind::ALL.to_vec());
    (effect, causes, paid, 0.0..=1.0f64, any::<bool>(), ".{0,12}", (ms(), ms(), ms())).prop_map(
        |(effect, causes, paid, bound, on, why, (predicted_ms, measured_ms, saved_ms))| EffectRow {
            effect,
            causes,
            paid,
            predicted_ms,
            bound,
            on,
            why,
            measured_ms,
            saved_ms,
        },
    )
}

pub(crate) fn description() -> impl Strategy<Value = Description> {
    let effects = vec![
        Effect::AlphaCutout,
        Effect::Emission,
        Effect::Specular,
        Effect::Transmission,
        Effect::NormalMap,
        Effect::PunctualLights,
        Effect::Sky,
        Effect::Animation,
    ];
    let cameras = (".{0,8}", camera()).prop_map(|(name, camera)| NamedCamera { name, camera });
    let limits =
        (1..=u32::MAX, 1..=u64::MAX).prop_map(|(max_side, max_pixels)| Limits { max_side, max_pixels });
    (
        (".{0,12}", scene_hash(), bounds(), any::<u64>(), 0.0..=86400.0, light_level()),
        (prop::sample::subsequence(effects, 0..=8), prop::collection::vec(effect_row(), 0..4)),
        prop::collection::vec(cameras, 1..4),
        limits,
        rig(),
        plan_request(),
    )
        .prop_map(
            |(
                (scene_name, scene_hash, bounds, triangles, epoch_secs, first_light),
                (effects, rows),
                cameras,
                limits,
                rig,
                defaults,
            )| {
                Description {
                    epoch_secs,
                    first_light,
                    light: format!("sky: {scene_name}"),
                    scenes: vec![scene_name.clone(), format!("{scene_name}-2")],
                    scene_name,
                    scene_hash,
                    bounds,
                    triangles,
                    effects,
                    effect_plan: EffectPlan { rows },
                    cameras,
                    limits,
                    rig,
                    defaults,
                }
            },
        )
}

fn image(bytes: usize, seed: u64) -> Bytes {
    // Half regular, half noise: both encodings of a chunk occur.
    let byte = |i: usize| match i % 2 {
        0 => (i / 64) as u8,
        _ => ((i as u64 * 0x9e37_79b9).wrapping_mul(seed | 1) >> 17) as u8,
    };
    (0..bytes).map(byte).collect()
}

pub(crate) fn frame() -> impl Strategy<Value = Frame> {
    let wanted = outputs().prop_filter("something", |o| *o != Outputs::NONE);
    let predicted =
        option::of((0.0..=1.0f64, 0.0..1e5f64)).prop_map(|p| p.map(|(error, ms)| Prediction { error, ms }));
    let served = any::<[u32; 4]>().prop_map(|counts| {
        let [warped, other_sample, traced, unresolved] = counts.map(u64::from);
        Served { warped, other_sample, traced, unresolved }
    });
    let reason = prop::sample::select(Reason::ALL.to_vec());
    let decision = (reason, 0.0..1e5f64, 0.0..1e5f64, -1.0..=1.0f64)
        .prop_map(|(reason, wait_ms, render_ms, excess)| Decision { reason, wait_ms, render_ms, excess });
    let sure = (0.0..=1.0f64, served, predicted, option::of(decision));
    (1..70u32, 1..50u32, wanted, sure, provenance(), stages(), any::<u64>()).prop_map(
        |(width, height, outputs, sure, provenance, stages, seed)| {
            let (unresolved_fraction, served, predicted, decision) = sure;
            let pixels = (width * height) as usize;
            Frame {
                width,
                height,
                images: outputs
                    .iter()
                    .map(|output| (output, image(output.pixel_bytes() * pixels, seed)))
                    .collect(),
                unresolved_fraction,
                served,
                predicted,
                decision,
                provenance,
                stages,
            }
        },
    )
}

pub(crate) fn frame_meta() -> impl Strategy<Value = FrameMeta> {
    ("[a-z0-9]{0,12}", "[a-z0-9]{0,12}", 0.0..1e5f64).prop_map(|(view_id, worker, age_ms)| FrameMeta {
        view_id,
        worker,
        age_ms,
        digest: argus_scene::FrameDigest::default(),
    })
}

/// A set of small omni samples and one of its samples, with or without the planes for specular and reflections.
/// Some of the samples are reflection probes.
pub(crate) fn sample() -> impl Strategy<Value = (SampleSetInfo, Sample)> {
    (set_info(), 8..24u32, any::<(bool, bool)>(), any::<u64>(), stages()).prop_map(
        |(info, face, (glossy, of_rig), seed, stages)| {
            let rig = Rig::Cell { origin: DVec3::ONE, spacing: 2.0, face };
            // A few small probes.
            let small = |probes: ReflectionProbeSet| ReflectionProbeSet {
                settings: Reflections { side: 16, ..probes.settings },
                count: probes.count.min(3),
                eye: probes.eye,
            };
            let info = SampleSetInfo { rig, reflections: info.reflections.map(small), ..info };
            let at = DVec3::splat((seed % 1000) as f64);
            let nearest = rig.nearest(&Camera::look_at(at, at + DVec3::X), 1)[0];
            let of_rig = of_rig || info.reflections.is_none();
            let index = if of_rig { nearest } else { SampleId::REFLECTION_PROBES };
            let camera = info.camera(index).unwrap();
            let plane = |kind, format: PlaneFormat| {
                let size = Plane::size_of(kind, &camera);
                let bytes = size[0] as usize * size[1] as usize * format.texel_bytes();
                Plane { kind, format, size, data: PlaneData::Host(image(bytes, seed)) }
            };
            let mut planes = vec![
                plane(PlaneKind::Radiance, PlaneFormat::Rgb9e5Ufloat),
                plane(PlaneKind::InverseRange, PlaneFormat::R32Float),
            ];
            if !of_rig {
                planes.push(plane(PlaneKind::ProbeSphere, PlaneFormat::R32Float));
            } else if glossy {
                planes.push(plane(PlaneKind::Normal, PlaneFormat::Rg16Snorm));
                planes.push(plane(PlaneKind::Specular, PlaneFormat::Rgba8Unorm));
                planes.extend(info.reflections.map(|_| plane(PlaneKind::Reflector, PlaneFormat::R32Uint)));
                let effects = info.effects.any().then_some(PlaneKind::LightVisibility);
                planes.extend(effects.map(|kind| plane(kind, PlaneFormat::Rgba8Unorm)));
            }
            let id = SampleId { version: info.version.number, camera: index };
            let faces = FaceMask::new(1 + seed as u32 % 63, "faces").unwrap().of_camera(&camera);
            (info, Sample { id, camera, faces, planes, stages })
        },
    )
}
