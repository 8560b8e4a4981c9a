//! The effect plan: its bounds against the reference, and its decisions.
use crate::common;

use argus_scene::effects::{COST_PIXELS, EffectCost, EffectCosts, EffectKind, SHARED_STAGE, STAGES};
use argus_scene::reference::{DirectLight, Indirect, Reflecting, Tracer};
use argus_scene::reflection::BOUNCES;
use argus_scene::{
    AlphaMode, Camera, EffectPlan, EffectRequest, Effects, Instance, Light, LightEffects, Lighting, Material,
    Mesh, PointSettings, Scene, Sky, Stage, VplSettings,
};
use common::{furnace, patch, scene, sphere, sun, texture, textured, tracer};
use glam::{DAffine3, DMat3, DQuat, DVec3, Vec3, Vec4};

const SIZE: [u32; 2] = [40, 30];

fn grey(value: f32) -> Material {
    Material { base_color: Vec4::new(value, value * 0.9, value * 0.8, 1.0), ..Material::default() }
}

/// A mesh that lies in y = `height` and looks up, scaled to `side` metres.
fn lying(height: f64, side: f64) -> DAffine3 {
    let flat = DMat3::from_quat(DQuat::from_rotation_x(-std::f64::consts::FRAC_PI_2));
    DAffine3 { matrix3: flat * (side * 0.5), translation: DVec3::Y * height }
}

/// A floor of 4 × 4 m and a roof of 1 × 1 m, 0.8 m above it.
fn roofed(lighting: Lighting, floor: Material, roof: Material) -> Scene {
    let mut scene = scene(vec![patch(1), patch(1)], vec![floor, roof], lighting);
    scene.instances[0].world_from_mesh = lying(0.0, 4.0);
    scene.instances[1].world_from_mesh = lying(0.8, 1.0);
    scene
}

fn matt(lighting: Lighting) -> Scene {
    roofed(lighting, grey(0.4), grey(0.3))
}

/// A single-sided ball, seen from outside.
fn ball(lighting: Lighting, material: Material) -> Scene {
    scene(vec![sphere(12)], vec![Material { double_sided: false, ..material }], lighting)
}

/// A sun in a black sky, with an extent.
fn wide_sun(direction: DVec3) -> Lighting {
    let irradiance = Vec3::new(2.0, 1.5, 1.0);
    let light = Light::Directional { direction: direction.normalize(), irradiance, angular_radius: 0.1 };
    Lighting { lights: vec![light], ..sun(direction) }
}

fn lamp(position: DVec3, intensity: f32, range: Option<f64>) -> Lighting {
    let light = Light::Point { position, intensity: Vec3::splat(intensity), range, radius: 0.05 };
    Lighting { lights: vec![light], ..sun(DVec3::NEG_Y) }
}

fn spot(position: DVec3) -> Lighting {
    let light = Light::Spot {
        position,
        direction: DVec3::NEG_Y,
        intensity: Vec3::splat(4.0),
        range: Some(9.0),
        inner_cone: 0.3,
        outer_cone: 0.5,
        radius: 0.0,
    };
    Lighting { lights: vec![light], ..sun(DVec3::NEG_Y) }
}

fn plan(scene: &Scene, effects: Effects) -> EffectPlan {
    let indirect = Some(argus_scene::Indirect::Off);
    EffectPlan::of(scene, &EffectRequest { effects, indirect, ..EffectRequest::default() }, None)
}

fn auto(scene: &Scene) -> EffectPlan {
    plan(scene, Effects::Auto)
}

fn lit(scene: &Scene, effects: LightEffects) -> Tracer {
    tracer(scene.clone()).with_direct_light(DirectLight { effects, rays: 16 })
}

/// Largest change of a display-linear value between two images, over two views.
fn change(scene: &Scene, off: &Tracer, on: &Tracer, indirect: Option<Indirect>) -> f64 {
    let exposure = scene.lighting.exposure;
    let mut most = 0.0f32;
    for eye in [DVec3::new(2.0, 0.5, 2.5), DVec3::new(-1.0, 3.0, 2.0)] {
        let camera = Camera { fov_deg: 70.0, ..Camera::look_at(eye, DVec3::Y * 0.2) };
        let off = off.render(&camera, SIZE[0], SIZE[1], 1, |_| {});
        let on = on.render_with(&camera, SIZE, 1, indirect, |_| {});
        let shown = |radiance: Vec3| (radiance * exposure).clamp(Vec3::ZERO, Vec3::ONE);
        for (off, on) in off.radiance.iter().zip(&on.radiance) {
            most = most.max((shown(*off) - shown(*on)).abs().max_element());
        }
    }
    f64::from(most)
}

/// Checks a measured change against the bound of a row, which must say something.
fn holds(name: &str, scene: &Scene, effect: EffectKind, change: f64) -> f64 {
    let plan = auto(scene);
    let bound = plan.row(effect).expect("every effect has a row").bound;
    assert!(bound < 1.0, "{name}: a bound of 1 says nothing");
    assert!(change <= bound + 1e-6, "{name}: {change} is more than {bound}");
    bound
}

/// Checks the bound of an effect that can be switched.
fn holds_switched(name: &str, scene: &Scene, effect: EffectKind, on: LightEffects, off: LightEffects) -> f64 {
    let change = change(scene, &lit(scene, off), &lit(scene, on), None);
    holds(name, scene, effect, change);
    change
}

const NONE: LightEffects = LightEffects::NONE;
const HARD: LightEffects = LightEffects { shadows: true, ..NONE };
const SOFT: LightEffects = LightEffects { soft_shadows: true, ..HARD };
const SKY: LightEffects = LightEffects { sky_visibility: true, ..NONE };
const EMITTERS: LightEffects = LightEffects { emitters: true, ..NONE };

#[test]
fn shadows_change_no_pixel_by_more_than_their_bound() {
    let slanted = DVec3::new(-0.5, -1.0, 0.3);
    let glossy = Material { roughness: 0.85, ..grey(0.3) };
    let mut dim = wide_sun(slanted);
    dim.exposure = 0.5;
    let scenes = [
        ("sun", matt(wide_sun(slanted))),
        ("glossy sun", roofed(dim, glossy, grey(0.3))),
        ("lamp", matt(lamp(DVec3::Y * 2.5, 3.0, Some(8.0)))),
        ("spot", matt(spot(DVec3::Y * 3.0))),
    ];
    for (name, scene) in scenes {
        let change = holds_switched(name, &scene, EffectKind::Shadows, SOFT, NONE);
        assert!(change > 0.01, "{name}: the roof casts a shadow");
    }
    let scene = matt(wide_sun(slanted));
    let change = holds_switched("penumbra", &scene, EffectKind::SoftShadows, SOFT, HARD);
    assert!(change > 0.01, "the shadow has a penumbra");
}

#[test]
fn a_body_without_casters_loses_no_more_light_to_itself_than_the_bound() {
    let level = wide_sun(DVec3::new(-1.0, -0.02, 0.2));
    let smooth = ball(level.clone(), grey(0.4));
    holds_switched("ball", &smooth, EffectKind::Shadows, SOFT, NONE);
    let mut flat = scene(vec![patch(1)], vec![grey(0.4)], level);
    flat.instances[0].world_from_mesh = lying(0.0, 4.0);
    holds_switched("floor", &flat, EffectKind::Shadows, SOFT, NONE);
    assert!(auto(&flat).row(EffectKind::Shadows).unwrap().bound < 0.1);
}

#[test]
fn emitters_and_glow_change_no_pixel_by_more_than_their_bounds() {
    let emits = Material { emissive: Vec3::new(0.9, 0.6, 0.3), ..grey(0.2) };
    let dark = Lighting { lights: Vec::new(), ..sun(DVec3::NEG_Y) };
    // The roof shines both ways.
    let near = roofed(dark.clone(), grey(0.4), emits.clone());
    let light = DirectLight { effects: EMITTERS, rays: 64 };
    let on = tracer(near.clone()).with_direct_light(light.clone());
    let changed = change(&near, &lit(&near, NONE), &on, None);
    holds("near emitter", &near, EffectKind::Emitters, changed);
    assert!(changed > 0.05);
    let mut far = near.clone();
    far.instances[1].world_from_mesh = lying(6.0, 1.0);
    let on = tracer(far.clone()).with_direct_light(light);
    let changed = change(&far, &lit(&far, NONE), &on, None);
    let bound = holds("far emitter", &far, EffectKind::Emitters, changed);
    assert!(bound < 0.02 && changed > 1e-4, "the bound falls with distance: {bound}");
    let mut black = near.clone();
    black.materials[1].emissive = Vec3::ZERO;
    let changed = change(&near, &lit(&black, NONE), &lit(&near, NONE), None);
    holds("glow", &near, EffectKind::Glow, changed);
    assert!(changed > 0.5);
}

#[test]
fn sky_visibility_changes_no_pixel_by_more_than_its_bound() {
    let dusk = Sky {
        zenith: Vec3::new(0.2, 0.3, 0.6),
        horizon: Vec3::splat(0.5),
        ground: Vec3::splat(0.1),
        map: None,
        reach: None,
    };
    let lighting = Lighting { sky: dusk, ..furnace() };
    let change = holds_switched("roof", &matt(lighting.clone()), EffectKind::SkyVisibility, SKY, NONE);
    assert!(change > 0.05, "the roof blocks the sky");
    let glossy = Material { roughness: 0.4, ..grey(0.3) };
    let glossy = roofed(lighting.clone(), glossy, grey(0.3));
    holds_switched("gloss", &glossy, EffectKind::SkyVisibility, SKY, NONE);
    let ball = ball(lighting, grey(0.4));
    holds_switched("ball", &ball, EffectKind::SkyVisibility, SKY, NONE);
    let plan = auto(&ball);
    assert!(
        plan.row(EffectKind::SkyVisibility).unwrap().bound < 0.05 && !plan.is_on(EffectKind::SkyVisibility)
    );
}

#[test]
fn lights_and_highlights_change_no_pixel_by_more_than_their_bounds() {
    let without = |scene: &Scene| {
        let mut dark = scene.clone();
        dark.lighting.lights.clear();
        dark
    };
    let lamps = [
        ("sun", EffectKind::Sun, wide_sun(DVec3::new(-0.5, -1.0, 0.3))),
        ("lamp", EffectKind::PointLights, lamp(DVec3::Y * 2.5, 3.0, None)),
        ("spot", EffectKind::SpotLights, spot(DVec3::Y * 3.0)),
    ];
    for (name, effect, lighting) in lamps {
        let scene = matt(lighting.clone());
        let changed = change(&scene, &lit(&without(&scene), NONE), &lit(&scene, NONE), None);
        holds(name, &scene, effect, changed);
        assert!(changed > 0.02, "{name}");
        // A black surface shows only the highlight.
        let black = Material { roughness: 0.8, base_color: Vec4::W, ..Material::default() };
        let mut scene = roofed(lighting, black, grey(0.0));
        scene.lighting.exposure = 0.3;
        let changed = change(&scene, &lit(&without(&scene), NONE), &lit(&scene, NONE), None);
        holds(name, &scene, EffectKind::Highlights, changed);
        assert!(changed > 1e-5, "{name}");
    }
}

#[test]
fn albedo_is_bounded_by_the_largest_texel_and_vertex_colour() {
    let mut scene = matt(wide_sun(DVec3::NEG_Y));
    scene.materials[0] = textured(Material { base_color: Vec4::ONE, ..Material::default() });
    scene.textures = vec![texture(4, |x, y| if x == y { [160, 140, 120, 255] } else { [20, 20, 20, 255] })];
    scene.meshes[0].colors = vec![Vec4::new(0.5, 0.9, 0.5, 1.0); scene.meshes[0].positions.len()];
    let change = holds_switched("texture", &scene, EffectKind::Shadows, HARD, NONE);
    let bound = auto(&scene).row(EffectKind::Shadows).unwrap().bound;
    assert!(change > 0.01 && bound < 0.2, "{change} {bound}");
}

#[test]
fn indirect_light_reflection_and_transmission_keep_their_bounds() {
    let scene = matt(wide_sun(DVec3::new(-0.5, -1.0, 0.3)));
    let indirect = Some(Indirect { paths: 16, bounces: 4 });
    let tracer_of = |scene: &Scene| lit(scene, SOFT);
    let changed = change(&scene, &tracer_of(&scene), &tracer_of(&scene), indirect);
    holds("indirect", &scene, EffectKind::Indirect, changed);
    assert!(changed > 1e-3);

    let smooth = Material { roughness: 0.1, transmission: 0.3, double_sided: false, ..grey(0.3) };
    let mut scene = matt(Lighting { exposure: 0.3, ..furnace() });
    scene.meshes.push(Mesh { material: 2, ..sphere(8) });
    scene.materials.push(smooth);
    let world_from_mesh =
        DAffine3 { matrix3: DMat3::from_diagonal(DVec3::splat(0.3)), translation: DVec3::Y * 0.3 };
    scene.instances.push(Instance { mesh: 2, node: None, world_from_mesh });
    let instances = scene.reflectors(8);
    assert_eq!(instances, [2]);
    let plain = tracer(scene.clone());
    let reflecting = tracer(scene.clone()).reflecting(Reflecting { rays: 16, bounces: BOUNCES, instances });
    let changed = change(&scene, &plain, &reflecting, None);
    let bound = holds("reflection", &scene, EffectKind::Reflection, 0.0)
        + holds("transmission", &scene, EffectKind::Transmission, 0.0);
    assert!(changed > 1e-3 && changed <= bound, "{changed} {bound}");
}

#[test]
fn a_matt_convex_scene_plans_no_shadows_and_no_rays_to_the_sky() {
    let scene = ball(Lighting::default(), grey(0.8));
    let plan = auto(&scene);
    assert_eq!(plan.light_effects(), LightEffects::NONE, "{plan:#?}");
    assert!(!plan.is_on(EffectKind::Highlights));
    let shadows = plan.row(EffectKind::Shadows).unwrap();
    assert!(shadows.causes.is_empty() && shadows.why.contains("nothing stands between"), "{shadows:?}");
    // The same ball from within, or with both sides seen, is a dark room.
    let room = common::scene(vec![sphere(12)], vec![grey(0.8)], Lighting::default());
    assert!(auto(&room).light_effects().shadows);
}

#[test]
fn two_balls_cast_shadows_only_along_the_light() {
    let two = |apart: DVec3, direction: DVec3| {
        let mut scene = ball(wide_sun(direction), grey(0.8));
        let world_from_mesh = DAffine3::from_translation(apart);
        scene.instances.push(Instance { mesh: 0, node: None, world_from_mesh });
        auto(&scene).is_on(EffectKind::Shadows)
    };
    assert!(two(DVec3::Y * 8.0, DVec3::NEG_Y) && two(DVec3::Y * 8.0, DVec3::Y));
    assert!(two(DVec3::new(5.0, 5.0, 0.0), DVec3::new(-1.0, -1.0, 0.0)));
    assert!(!two(DVec3::X * 8.0, DVec3::NEG_Y), "side by side");
    assert!(!two(DVec3::new(5.0, 5.0, 0.0), DVec3::new(1.0, -1.0, 0.0)), "side by side, at a slant");
}

#[test]
fn soft_shadows_need_a_light_with_an_extent() {
    let plan = auto(&matt(sun(DVec3::NEG_Y)));
    assert_eq!(plan.light_effects(), HARD);
    assert_eq!(auto(&matt(wide_sun(DVec3::NEG_Y))).light_effects(), SOFT);
}

#[test]
fn a_black_sky_plans_no_rays_to_the_sky() {
    assert!(!auto(&matt(sun(DVec3::NEG_Y))).is_on(EffectKind::SkyVisibility));
    assert_eq!(auto(&matt(furnace())).light_effects(), SKY);
}

#[test]
fn only_alpha_between_none_and_all_plans_transparency() {
    for (alpha, mode, expected) in [
        (0.5, AlphaMode::Blend, true),
        (1.0, AlphaMode::Blend, false),
        (0.0, AlphaMode::Blend, false),
        (0.5, AlphaMode::Mask(0.5), false),
        (0.5, AlphaMode::Opaque, false),
    ] {
        let roof =
            Material { base_color: Vec4::new(0.3, 0.3, 0.3, alpha), alpha: mode, ..Material::default() };
        let plan = auto(&roofed(sun(DVec3::NEG_Y), grey(0.4), roof));
        let row = plan.row(EffectKind::Transparency).unwrap();
        assert_eq!((row.on, row.bound > 0.0), (expected, expected), "{alpha} {mode:?}");
        assert_eq!(row.causes.materials, if expected { vec![1] } else { vec![] }, "{alpha} {mode:?}");
        let cut = plan.is_on(EffectKind::CutOuts);
        assert_eq!(cut, matches!(mode, AlphaMode::Mask(_)), "{alpha} {mode:?}");
    }
}

#[test]
fn an_effect_too_weak_to_be_seen_is_off_in_auto_and_on_in_all() {
    let mut scene = matt(lamp(DVec3::Y * 40.0, 0.01, None));
    let plan_of_auto = auto(&scene);
    assert!(!plan_of_auto.is_on(EffectKind::Shadows), "{plan_of_auto:#?}");
    assert!(plan_of_auto.row(EffectKind::Shadows).unwrap().why.contains("half a byte"));
    assert_eq!(plan(&scene, Effects::All).light_effects(), LightEffects::ALL);
    scene.lighting.exposure = 1e4;
    assert!(auto(&scene).is_on(EffectKind::Shadows));
    assert_eq!(plan(&scene, Effects::None).light_effects(), LightEffects::NONE);
    let listed = plan(&scene, "soft-shadows".parse().unwrap());
    assert_eq!(listed.light_effects(), SOFT);
}

#[test]
fn emitters_are_no_lights_where_indirect_light_counts_emission() {
    let emits = Material { emissive: Vec3::ONE, ..grey(0.2) };
    let scene = roofed(Lighting { lights: Vec::new(), ..sun(DVec3::NEG_Y) }, grey(0.4), emits);
    assert_eq!(auto(&scene).light_effects(), EMITTERS);
    let points = argus_scene::Indirect::Points(PointSettings::default());
    for indirect in [argus_scene::Indirect::Vpl(VplSettings::default()), points] {
        for effects in [Effects::Auto, Effects::All] {
            let indirect = Some(indirect);
            let request = EffectRequest { effects, indirect, ..EffectRequest::default() };
            let plan = EffectPlan::of(&scene, &request, None);
            assert!(!plan.light_effects().emitters && plan.is_on(EffectKind::Indirect));
        }
    }
}

#[test]
fn lit_surfaces_that_face_one_another_are_lit_by_paths() {
    let scene = roofed(sun(DVec3::NEG_Y), grey(0.4), grey(0.2));
    let open = EffectRequest::default();
    let plan = EffectPlan::of(&scene, &open, None);
    assert!(matches!(plan.indirect(&scene, &open), argus_scene::Indirect::Cells(_)), "{plan:#?}");
    assert!(plan.light_effects().shadows && plan.light_effects().sky_visibility);
    plan.indirect(&scene, &open).check_effects(plan.light_effects()).unwrap();
    // Neither what cannot be seen, nor what was not asked for.
    let asked = [
        EffectRequest { exposure: Some(1e-6), ..open },
        EffectRequest { effects: Effects::None, ..open },
        EffectRequest { effects: "shadows".parse().unwrap(), ..open },
        EffectRequest { indirect: Some(argus_scene::Indirect::Off), ..open },
    ];
    for request in asked {
        let plan = EffectPlan::of(&scene, &request, None);
        assert_eq!(plan.indirect(&scene, &request), argus_scene::Indirect::Off, "{plan:#?}");
    }
    // A light of interiors comes from no surface.
    let inside =
        Lighting { lights: Vec::new(), sky: Sky { reach: Some(1.0), ..Sky::DAYLIGHT }, exposure: 1.0 };
    let inside = roofed(inside, grey(0.4), grey(0.2));
    let plan = EffectPlan::of(&inside, &open, None);
    let of_sky = argus_scene::Indirect::Cells(argus_scene::CellSettings::of_sky());
    assert!(!plan.is_on(EffectKind::Indirect) && plan.is_on(EffectKind::SkyVisibility), "{plan:#?}");
    assert_eq!(plan.indirect(&inside, &open), of_sky);
    assert_eq!(of_sky.effects_with(plan.light_effects()), plan.light_effects());
    let night = Lighting { lights: Vec::new(), sky: Sky::BLACK, exposure: 1.0 };
    let unlit = roofed(night, grey(0.4), grey(0.2));
    assert_eq!(EffectPlan::of(&unlit, &open, None).indirect(&unlit, &open), argus_scene::Indirect::Off);
}

#[test]
fn a_removed_row_removes_its_pass() {
    let emits = Material { emissive: Vec3::ONE, ..grey(0.2) };
    let scene = roofed(Lighting { sky: Sky::DAYLIGHT, ..wide_sun(DVec3::NEG_Y) }, grey(0.4), emits);
    let whole = auto(&scene);
    assert_eq!(whole.light_effects(), LightEffects::ALL);
    let left = |removed: EffectKind| {
        let mut plan = whole.clone();
        plan.rows.retain(|row| row.effect != removed);
        plan.light_effects()
    };
    let all = LightEffects::ALL;
    assert_eq!(left(EffectKind::Emitters), LightEffects { emitters: false, ..all });
    assert_eq!(left(EffectKind::SkyVisibility), LightEffects { sky_visibility: false, ..all });
    assert_eq!(left(EffectKind::SoftShadows), LightEffects { soft_shadows: false, ..all });
    assert!(!left(EffectKind::Shadows).shadows);
    assert_eq!(left(EffectKind::Glow), all);
}

#[test]
fn costs_are_predicted_from_measurements_and_kept_apart_from_what_is_saved() {
    let scene = matt(wide_sun(DVec3::NEG_Y));
    let costs = EffectCosts { ms: [(EffectKind::Shadows, 3.0), (EffectKind::SkyVisibility, 5.0)].into() };
    let request = EffectRequest { indirect: Some(argus_scene::Indirect::Off), ..EffectRequest::default() };
    let mut plan = EffectPlan::of(&scene, &request, Some(&costs));
    assert_eq!(plan.row(EffectKind::Shadows).unwrap().predicted_ms, Some(3.0));
    assert_eq!(plan.row(EffectKind::Emitters).unwrap().predicted_ms, None);
    plan.measured(EffectKind::Shadows, 4.0);
    plan.measured(EffectKind::SkyVisibility, 6.0);
    let [shadows, sky] = [EffectKind::Shadows, EffectKind::SkyVisibility].map(|kind| plan.row(kind).unwrap());
    assert_eq!((shadows.measured_ms, shadows.saved_ms), (Some(4.0), None));
    assert_eq!((sky.measured_ms, sky.saved_ms), (None, Some(6.0)));
}

#[test]
fn stages_of_a_frame_are_the_costs_of_their_effects() {
    let lights = [
        Light::sun(),
        Light::sun(),
        Light::Point { position: DVec3::Y, intensity: Vec3::ONE, range: None, radius: 0.0 },
    ];
    let scene = matt(Lighting { lights: lights.to_vec(), ..Lighting::default() });
    let stage = |name: &str, ms| Stage::new(name, ms);
    let stages = [
        stage("trace shadows", 6.0),
        stage("trace penumbras", 3.0),
        stage("trace penumbras", 1.0),
        stage(SHARED_STAGE, 9.0),
        stage("light leaves: links", 5.0),
        stage("gather paths", 2.0),
        stage("shade view", 7.0),
    ];
    let costs = EffectCosts::of_stages(&scene, &stages);
    // By light: three cast shadows, two of them soft ones.
    let expected =
        [(EffectKind::Shadows, 2.0), (EffectKind::SoftShadows, 2.0), (EffectKind::Indirect, 7.0)].into();
    assert_eq!(costs, EffectCosts { ms: expected });
    let quarter = EffectCosts { ms: costs.ms.iter().map(|(effect, ms)| (*effect, ms / 4.0)).collect() };
    assert_eq!(quarter.scaled(4.0), costs);
    let request = EffectRequest { indirect: Some(argus_scene::Indirect::Off), ..EffectRequest::default() };
    let mut plan = EffectPlan::of(&scene, &request, Some(&costs));
    plan.measured_in(&stages);
    let of = |effect| plan.row(effect).map(|row| (row.predicted_ms, row.measured_ms)).unwrap();
    assert_eq!(of(EffectKind::Shadows), (Some(6.0), Some(6.0)));
    assert_eq!(of(EffectKind::SoftShadows), (Some(4.0), Some(4.0)));
    assert_eq!(of(EffectKind::SkyVisibility), (None, Some(0.0)), "it is on, and none of its stages ran");
    assert_eq!(of(EffectKind::Emitters), (None, None), "it is off");
    assert_eq!(of(EffectKind::Sun), (None, None), "it has no stage of its own");
}

#[test]
fn a_services_costs_are_scaled_to_one_size_and_a_row_without_cause_claims_none() {
    let scene = matt(Lighting { lights: vec![Light::sun(), Light::sun()], ..Lighting::default() });
    let stages = [
        ("trace shadows", 1.0),
        ("trace sky", 3.0),
        ("trace emitters", 2.0),
        ("shade view", 9.0),
        (SHARED_STAGE, 8.0),
    ]
    .map(|(name, ms)| Stage::new(name, ms));
    // A quarter of the pixels, and two lights together.
    let mut costs = EffectCost::predicted(&stages, COST_PIXELS / 4);
    costs[0].measured_ms = Some(5.0);
    let plan =
        plan(&scene, Effects::List(LightEffects { shadows: true, ..LightEffects::NONE })).with_costs(&costs);
    let of = |effect| {
        plan.row(effect).map(|row| (row.on, row.predicted_ms, row.measured_ms, row.saved_ms)).unwrap()
    };
    assert_eq!(of(EffectKind::Shadows), (true, Some(4.0), Some(5.0), None));
    assert_eq!(of(EffectKind::SkyVisibility), (false, Some(12.0), None, Some(12.0)));
    assert_eq!(of(EffectKind::Emitters), (false, None, None, None), "nothing emits");
    assert_eq!(of(EffectKind::Sun), (true, None, None, None), "it is a part of shading");
}

#[test]
fn every_stage_belongs_to_one_effect() {
    for (index, (stage, _)) in STAGES.iter().enumerate() {
        assert!(STAGES[..index].iter().all(|(other, _)| other != stage), "{stage}");
        assert_ne!(*stage, SHARED_STAGE);
    }
}

#[test]
fn requests_are_parsed_and_errors_name_the_field() {
    for (text, effects) in [
        ("auto", Effects::Auto),
        ("all", Effects::All),
        ("none", Effects::None),
        ("shadows,emitters", Effects::List(LightEffects { emitters: true, ..HARD })),
    ] {
        assert_eq!(text.parse(), Ok(effects));
        assert_eq!(effects.to_string().parse(), Ok(effects));
    }
    for text in ["", "shadow", "auto,shadows", "shadows,,emitters"] {
        let error = text.parse::<Effects>().unwrap_err();
        assert_eq!(error.field, "effects", "{text}");
    }
}

#[test]
fn scenes_that_are_empty_or_broken_have_plans() {
    let nothing = scene(Vec::new(), vec![grey(0.5)], Lighting::default());
    assert_eq!(auto(&nothing).light_effects(), LightEffects::NONE);
    let broken = Light::Point { position: DVec3::NAN, intensity: Vec3::ONE, range: None, radius: f64::NAN };
    let scene = matt(Lighting { lights: vec![broken], ..sun(DVec3::NEG_Y) });
    let plan = auto(&scene);
    assert!(plan.rows.iter().all(|row| (0.0..=1.0).contains(&row.bound)), "{plan:#?}");
}
