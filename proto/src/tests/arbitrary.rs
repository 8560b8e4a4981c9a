//! Proptest strategies for every type of the vocabulary that is sent between processes.

use argus_scene::effects::{Causes, EffectKind, EffectRow, Paid};
use argus_scene::frame::{Decision, Reason};
use argus_scene::scene::NamedCamera;
use argus_scene::{
    Bounds, Camera, CellSettings, Detail, Effect, EffectPlan, FaceMask, Frame, FrameSource, Holes, Indirect,
    Light, LightEffects, LightLevel, Lighting, Limits, MapSource, MegaViews, OmniLayout, Output, Outputs,
    PathSettings, Plan, PlanRequest, Plane, PlaneData, PlaneFormat, PlaneKind, PointSettings, Prediction,
    Preset, ProbeEye, ProbeSource, Provenance, ReflectionProbeSet, Reflections, Rig, Sample, SampleCamera,
    SampleId, SampleSetInfo, Sampling, SceneHash, SceneState, Search, Served, Sky, Specification, Stage,
    SurfaceLight, Version, View, Visibility, VplSettings, Warp,
};
use bytes::Bytes;
use glam::{DVec3, Vec3};
use proptest::option;
use proptest::prelude::*;

use crate::Description;
use crate::chunks::FrameMeta;

pub(crate) fn point() -> impl Strategy<Value = DVec3> {
    prop::array::uniform3(-1e7..1e7f64).prop_map(DVec3::from)
}

fn direction() -> impl Strategy<Value = DVec3> {
    let nonzero = |v: &DVec3| v.length() > 0.1;
    prop::array::uniform3(-1.0..1.0f64)
        .prop_map(DVec3::from)
        .prop_filter("too short", nonzero)
        .prop_map(DVec3::normalize)
}

fn rgb() -> impl Strategy<Value = Vec3> {
    prop::array::uniform3(0.0..1e4f32).prop_map(Vec3::from)
}

pub(crate) fn camera() -> impl Strategy<Value = Camera> {
    (point(), point(), direction(), 0.001..179.999f64)
        .prop_map(|(eye, target, up, fov_deg)| Camera { eye, target, up, fov_deg })
        .prop_filter("valid", |camera| camera.validate().is_ok())
}

pub(crate) fn bounds() -> impl Strategy<Value = Bounds> {
    prop_oneof![Just(Bounds::EMPTY), box_with_volume(), point().prop_map(|p| Bounds { min: p, max: p }),]
}

fn box_with_volume() -> impl Strategy<Value = Bounds> {
    (point(), point()).prop_map(|(a, b)| Bounds { min: a.min(b), max: a.max(b) })
}

pub(crate) fn light() -> impl Strategy<Value = Light> {
    let range = || option::of(0.001..1e6f64);
    prop_oneof![
        (direction(), rgb(), 0.0..1.5f64).prop_map(|(direction, irradiance, angular_radius)| {
            Light::Directional { direction, irradiance, angular_radius }
        }),
        (point(), rgb(), range(), 0.0..9f64).prop_map(|(position, intensity, range, radius)| Light::Point {
            position,
            intensity,
            range,
            radius
        }),
        (point(), direction(), rgb(), range(), 0.0..0.7f64, 0.001..0.7f64, 0.0..9f64).prop_map(
            |(position, direction, intensity, range, inner_cone, more, radius)| Light::Spot {
                position,
                direction,
                intensity,
                range,
                inner_cone,
                outer_cone: inner_cone + more,
                radius
            }
        ),
    ]
}

pub(crate) fn lighting() -> impl Strategy<Value = Lighting> {
    let sky = (rgb(), rgb(), rgb()).prop_map(|(zenith, horizon, ground)| Sky {
        zenith,
        horizon,
        ground,
        map: None,
        reach: None,
    });
    (prop::collection::vec(light(), 0..5), sky, 0.001..100f32).prop_map(|(lights, sky, exposure)| Lighting {
        lights,
        sky,
        exposure,
    })
}

pub(crate) fn rig() -> impl Strategy<Value = Rig> {
    let tiles = (box_with_volume(), 1..=1024u32, 1..=1024u32, 0.1..100f64, 1..=8192u32, 1..=8192u32);
    prop_oneof![
        tiles.prop_map(|(bounds, x, z, height, w, h)| Rig::TileCorners {
            bounds,
            tiles: [x, z],
            height,
            size: [w, h]
        }),
        (point(), 0.001..1e4f64, 8..=2048u32).prop_map(|(origin, spacing, face)| Rig::Cell {
            origin,
            spacing,
            face
        }),
    ]
}

pub(crate) fn sample_camera() -> impl Strategy<Value = SampleCamera> {
    prop_oneof![
        (camera(), 1..=8192u32, 1..=8192u32).prop_map(|(camera, width, height)| SampleCamera::Perspective {
            camera,
            width,
            height
        }),
        (point(), 8..=2048u32)
            .prop_map(|(center, face)| SampleCamera::Omni { center, layout: OmniLayout::CubeFaces { face } }),
        (point(), 1..=4096u32).prop_map(|(center, side)| SampleCamera::Omni {
            center,
            layout: OmniLayout::DualParaboloid { side }
        }),
        (point(), reflection_probes()).prop_map(|(center, ReflectionProbeSet { settings, count, .. })| {
            SampleCamera::Omni { center, layout: OmniLayout::ReflectionProbes { side: settings.side, count } }
        }),
    ]
}

pub(crate) fn scene_hash() -> impl Strategy<Value = SceneHash> {
    any::<[u8; 32]>().prop_map(SceneHash)
}

fn light_level() -> impl Strategy<Value = LightLevel> {
    prop::sample::select(LightLevel::ALL.to_vec())
}

fn scene_state() -> impl Strategy<Value = SceneState> {
    (any::<u64>(), light_level()).prop_map(|(epoch, light)| SceneState { epoch, light })
}

pub(crate) fn set_info() -> impl Strategy<Value = SampleSetInfo> {
    let visibility = prop::sample::select(Visibility::ALL.to_vec());
    let effects = (0..16u32).prop_map(|bits| LightEffects::from_bits(bits).unwrap_or_default());
    let specification =
        (visibility, sampling(), sub_samples(), effects, indirect(), prop::option::of(reflection_probes()));
    (
        scene_hash(),
        [bounds(), bounds()],
        rig(),
        any::<u64>(),
        scene_state(),
        0.0..=86400.0,
        lighting(),
        specification,
    )
        .prop_map(
            |(
                scene,
                [bounds, extent],
                rig,
                number,
                state,
                epoch_secs,
                lighting,
                (visibility, sampling, sub_samples, effects, indirect, reflections),
            )| {
                // Only omni cameras support every sampling.
                let sampling = sampling.validate(&rig).map_or(Sampling::Triangles, |()| sampling);
                let effects = indirect.effects_with(effects);
                SampleSetInfo {
                    scene,
                    bounds,
                    extent,
                    rig,
                    version: Version { number, state },
                    epoch_secs,
                    lighting,
                    visibility,
                    sampling,
                    sub_samples,
                    effects,
                    indirect,
                    reflections,
                }
            },
        )
}

fn reflection_probes() -> impl Strategy<Value = ReflectionProbeSet> {
    // So few that the largest are within bounds.
    let octree = (1..=10u32).prop_map(|levels| (ProbeSource::Octree { levels }, None));
    let points = (1024..=1u32 << 27, point(), point(), 0.1..1e4f64).prop_map(|(budget, a, b, pixels)| {
        let viewpoints = Bounds { min: a.min(b), max: a.max(b) };
        (ProbeSource::Points { budget }, Some(ProbeEye { viewpoints, pixels }))
    });
    let rays = Just((ProbeSource::Rays, None));
    (4..=8u32, prop_oneof![octree, points, rays], 1..=200u32, any::<u32>()).prop_map(
        |(log_side, (source, eye), most, count)| ReflectionProbeSet {
            settings: Reflections { side: 1 << log_side, most, source },
            count: 1 + count % most,
            eye,
        },
    )
}

fn sub_samples() -> impl Strategy<Value = u32> {
    prop::sample::select(vec![1, 4, 16])
}

fn vpl_settings() -> impl Strategy<Value = VplSettings> {
    let maps = (prop::sample::select(MapSource::ALL.to_vec()), 3..=8u32, 1..=1u32 << 20, 1..=10u32);
    let numbers = (1..=1u32 << 20, 0..=1u32 << 20, 1..=4u32);
    let gathering = (1..=1u32 << 16, 0..=32u32, any::<(bool, bool)>(), 0..=256u32);
    let shares = (0.0..=1.0f64, 0.0..=1.0f64, 0.0..=64.0f64, any::<u32>());
    (numbers, maps, gathering, shares).prop_map(
        |(
            (vpls, particles, bounces),
            (maps, log_side, points, levels),
            (samples, filter, (cull, weigh), groups),
            (cutoff, clamp, bias, seed),
        )| VplSettings {
            vpls,
            particles,
            bounces,
            map_side: 1 << log_side,
            maps,
            points,
            levels,
            samples,
            filter,
            cull,
            weigh,
            groups,
            cutoff,
            clamp,
            bias,
            seed,
        },
    )
}

fn indirect() -> impl Strategy<Value = Indirect> {
    let points = (1..=10u32, 8..=256u32, 1..=16u32, 1..=4u32, any::<bool>());
    let paths = (1..=10u32, 1..=256u32, 1..=16u32, 1..=256u32);
    prop_oneof![
        Just(Indirect::Off),
        vpl_settings().prop_map(Indirect::Vpl),
        points.prop_map(|(levels, map_side, block, bounces, sharing)| Indirect::Points(PointSettings {
            levels,
            map_side,
            block,
            bounces,
            sharing
        })),
        (paths.clone(), 1..=64u32, prop::sample::select(CellSettings::RAYS.to_vec())).prop_map(
            |((level, rays, bounces, gather), pixels, cell_rays)| {
                let paths = PathSettings { level, rays, bounces, gather };
                Indirect::Cells(CellSettings { paths, pixels, rays: cell_rays })
            }
        ),
        paths.prop_map(|(level, rays, bounces, gather)| {
            Indirect::Paths(PathSettings { level, rays, bounces, gather })
        }),
    ]
}

pub(crate) fn specification() -> impl Strategy<Value = Specification> {
    set_info().prop_map(|info| info.specification())
}

fn sampling() -> impl Strategy<Value = Sampling> {
    let block = prop::sample::select(vec![1, 2, 4]);
    prop_oneof![
        Just(Sampling::Triangles),
        // Larger maps cannot have blocks of four.
        (8..=512u32, 1..=10u32, block).prop_map(|(map_side, levels, block)| Sampling::MegaViews(MegaViews {
            map_side,
            levels,
            block
        })),
    ]
}

pub(crate) fn outputs() -> impl Strategy<Value = Outputs> {
    prop::sample::subsequence(Output::ALL.to_vec(), 0..=Output::ALL.len())
        .prop_map(|members| members.into_iter().fold(Outputs::default(), Outputs::with))
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
    (camera(), 1..=8192u32, 1..=8192u32, 1..=16u32).prop_map(|(camera, width, height, side)| FrameSource {
        camera,
        width,
        height,
        samples_per_pixel: side * side,
        light: None,
    })
}

fn surface_light() -> impl Strategy<Value = Option<SurfaceLight>> {
    let cells = [true, false]
        .map(|reflected| CellSettings::RAYS.map(|rays| Some(SurfaceLight::Cells { rays, reflected })));
    prop::sample::select([vec![None, Some(SurfaceLight::Rays)], cells.concat()].concat())
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
    (camera(), any::<u32>(), any::<u32>(), outputs(), plan_request(), option::of(provenance())).prop_map(
        |(camera, width, height, outputs, plan, pin)| View { camera, width, height, outputs, plan, pin },
    )
}

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

fn image(outputs: bool, bytes: usize, seed: u64) -> Option<Bytes> {
    // Half regular, half noise: both encodings of a chunk occur.
    let byte = |i: usize| match i % 2 {
        0 => (i / 64) as u8,
        _ => ((i as u64 * 0x9e37_79b9).wrapping_mul(seed | 1) >> 17) as u8,
    };
    outputs.then(|| (0..bytes).map(byte).collect::<Vec<u8>>().into())
}

pub(crate) fn frame() -> impl Strategy<Value = Frame> {
    let wanted = outputs().prop_filter("something", |o| *o != Outputs::default());
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
                color: image(outputs.color, 3 * pixels, seed),
                range: image(outputs.range, 4 * pixels, seed),
                mask: image(outputs.mask, pixels, seed),
                source: image(outputs.source, pixels, seed),
                confidence: image(outputs.confidence, pixels, seed),
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
                Plane { kind, format, size, data: PlaneData::Host(image(true, bytes, seed).unwrap()) }
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
