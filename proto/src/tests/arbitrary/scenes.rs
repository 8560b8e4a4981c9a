//! Strategies for scenes and sample sets: cameras, light, rigs, specifications.

use argus_scene::{
    Bounds, Camera, CellSettings, Distortion, Indirect, Intrinsics, Lens, Light, LightEffects, LightLevel,
    Lighting, MapSource, MegaViews, OmniLayout, PathSettings, PointSettings, ProbeEye, ProbeSource,
    ReflectionProbeSet, Reflections, Rig, SampleCamera, SampleSetInfo, Sampling, SceneHash, SceneState, Sky,
    Specification, Version, Visibility, VplSettings,
};
use glam::{DVec2, DVec3, Vec3};
use proptest::option;
use proptest::prelude::*;

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
    let lens = prop_oneof![
        (0.001..179.999f64).prop_map(|fov_deg| (fov_deg, None)),
        lens().prop_map(|lens| (Camera::USUAL_FOV_DEG, Some(lens))),
    ];
    (point(), point(), direction(), lens)
        .prop_map(|(eye, target, up, (fov_deg, lens))| Camera { eye, target, up, fov_deg, lens })
        .prop_filter("valid", |camera| camera.validate().is_ok())
}

/// A camera that samples may have.
pub(crate) fn pinhole() -> impl Strategy<Value = Camera> {
    camera().prop_filter("a pinhole", Camera::is_pinhole)
}

fn lens() -> impl Strategy<Value = Lens> {
    let distortion = prop_oneof![
        4 => Just(Distortion::None),
        1 => prop::array::uniform8(-2.0..2.0f64).prop_map(Distortion::Rational),
        1 => prop::array::uniform4(-2.0..2.0f64).prop_map(Distortion::Fisheye),
    ];
    let pair = |range: std::ops::Range<f64>| prop::array::uniform2(range).prop_map(DVec2::from);
    let intrinsics = (pair(0.1..1e5), pair(-1e5..1e5), distortion)
        .prop_map(|(focal, center, distortion)| Intrinsics { focal, center, distortion });
    let listed = (1e-3..180.0f64).prop_map(|spacing_deg| Lens::Rays { spacing_deg });
    prop_oneof![4 => intrinsics.prop_map(Lens::Intrinsics), 1 => Just(Lens::Equirectangular), 1 => listed]
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
        (pinhole(), 1..=8192u32, 1..=8192u32).prop_map(|(camera, width, height)| SampleCamera::Perspective {
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

pub(super) fn light_level() -> impl Strategy<Value = LightLevel> {
    prop::sample::select(LightLevel::ALL.to_vec())
}

pub(super) fn scene_state() -> impl Strategy<Value = SceneState> {
    (any::<u64>(), light_level(), any::<u64>()).prop_map(|(epoch, light, revision)| SceneState {
        epoch,
        light,
        revision,
    })
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
    let paths = (1..=9u32, 1..=256u32, 1..=16u32, 1..=256u32);
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
