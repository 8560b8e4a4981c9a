//! Points against brute force: every texel of a map is compared with its ray against every triangle.

use std::sync::Arc;

use argus_scene::Scene;
use argus_scene::procedural::{mirrors, rooms, terrain, with_balls};
use glam::{DVec3, Vec3};
use rayon::ThreadPoolBuilder;

use super::facets::Facet;
use argus_sampler::plug::{ReflectionRays, taps};

use super::*;

pub(super) fn eye_of(scene: &Scene, [width, height]: [u32; 2]) -> Eye {
    Eye::of(&scene.default_camera(), width, height, 1e-3)
}

pub(super) fn reflectors_of(scene: &Scene, eye: &Eye) -> Vec<MappedReflector> {
    let pose = scene.at(0.0);
    let reflector =
        |index: u32| curved_reflector(scene, index, &pose.instances[index as usize], eye, LARGEST_SIDE);
    scene.reflectors(4096).into_iter().filter_map(reflector).collect()
}

/// What a ray from a reflector's middle meets: facet and range, by testing every triangle (Möller and Trumbore, 1997).
pub(super) fn by_brute_force(
    facets: &[Facet],
    reflector: &MappedReflector,
    direction: DVec3,
) -> Option<(usize, f64)> {
    let mut nearest: Option<(usize, f64)> = None;
    for (index, facet) in facets.iter().enumerate() {
        if facet.instance == reflector.instance || facet.side_towards(reflector.center).is_none() {
            continue;
        }
        let [a, b, c] = facet.corners.map(|corner| corner - reflector.center);
        let (e1, e2) = (b - a, c - a);
        let p = direction.cross(e2);
        let inverse = e1.dot(p).recip();
        let beta = -a.dot(p) * inverse;
        let q = (-a).cross(e1);
        let gamma = direction.dot(q) * inverse;
        let t = e2.dot(q) * inverse;
        let is_hit = beta >= 0.0 && gamma >= 0.0 && beta + gamma <= 1.0 && t > 0.0;
        if is_hit && nearest.is_none_or(|(_, range)| t < range) {
            nearest = Some((index, t));
        }
    }
    nearest
}

/// Shares of sampled texels that are holes, show another triangle, or are off in range by more than 10⁻⁵.
fn errors(scene: &PointScene, reflectors: &[MappedReflector], points: &EyePoints, step: usize) -> [f64; 3] {
    let (mut counts, mut all) = ([0.0; 3], 0.0);
    for texel in (0..points.maps.texels()).step_by(step) {
        let (map, direction) = points.maps.direction_of(texel);
        let expected = by_brute_force(scene.facets(), &reflectors[map], direction.normalize());
        let found = points.maps.get(texel);
        all += 1.0;
        match (expected, found) {
            (Some(_), None) | (None, Some(_)) => counts[0] += 1.0,
            (Some((facet, range)), Some((id, found))) => {
                let seen = points.pieces.all[points.points[id as usize].piece() as usize].facet as usize;
                counts[1] += f64::from(u8::from(seen != facet));
                counts[2] += f64::from(u8::from((found / range - 1.0).abs() > 1e-5));
            }
            (None, None) => (),
        }
    }
    counts.map(|count| count / all)
}

#[test]
fn maps_have_no_holes_and_see_what_rays_see() {
    for (scene, step) in [(with_balls(rooms(20), 5).unwrap(), 23), (mirrors(6), 31)] {
        let scene = Arc::new(scene);
        let eye = eye_of(&scene, [480, 360]);
        let reflectors = reflectors_of(&scene, &eye);
        let points = PointScene::new(&scene, 0.0);
        for rule in [DensityRule::Eye, DensityRule::Planar, DensityRule::Map] {
            let density = Density { rule, ..Density::default() };
            let found = points.points(
                &eye,
                &reflectors,
                &EyePointSettings { density, ..EyePointSettings::default() },
            );
            let [holes, other, off] = errors(&points, &reflectors, &found, step);
            assert_eq!(holes, 0.0, "{} {rule:?}", scene.name);
            // Where two triangles meet, rounding decides.
            assert!(other < 1e-3 && off < 1e-3, "{} {rule:?}: {other} {off}", scene.name);
        }
    }
}

#[test]
fn culling_saves_a_third_of_the_points_and_leaves_no_holes() {
    let scene = Arc::new(with_balls(terrain(200_000), 3).unwrap());
    let eye = eye_of(&scene, [320, 240]);
    let reflectors = reflectors_of(&scene, &eye);
    let points = PointScene::new(&scene, 0.0);
    let [all, culled] = [false, true].map(|culling| {
        points.points(&eye, &reflectors, &EyePointSettings { culling, ..EyePointSettings::default() })
    });
    assert!(culled.points.len() * 3 < all.points.len() * 2, "{} {}", culled.points.len(), all.points.len());
    // Leaves stand alone before the sky.
    let seen = |points: &EyePoints, texel| points.maps.get(texel).is_some();
    assert!((0..all.maps.texels()).all(|texel| !seen(&all, texel) || seen(&culled, texel)));
    let budget = culled.points.len() as u32 - 1;
    let settings = EyePointSettings { culling: true, budget, ..EyePointSettings::default() };
    let fewer = points.points(&eye, &reflectors, &settings);
    assert!(fewer.points.len() <= budget as usize);
}

#[test]
fn triangles_that_are_rasterised_whole_fill_the_same_texels_as_their_points() {
    let scene = Arc::new(with_balls(rooms(20), 12).unwrap());
    let eye = eye_of(&scene, [480, 360]);
    let reflectors = reflectors_of(&scene, &eye);
    let points = PointScene::new(&scene, 0.0);
    let by_points = points.points(&eye, &reflectors, &EyePointSettings::default());
    let whole = points.rasterise(&reflectors);
    let mut other = 0;
    for texel in 0..whole.texels() {
        let (a, b) = (whole.get(texel), by_points.maps.get(texel));
        assert_eq!(a.is_some(), b.is_some(), "texel {texel}");
        if let (Some((facet, _)), Some((id, _))) = (a, b) {
            let piece = by_points.points[id as usize].piece();
            other += usize::from(by_points.pieces.all[piece as usize].facet != facet);
        }
    }
    assert!(other * 1000 < whole.texels(), "{other} of {}", whole.texels());
}

#[test]
fn traced_maps_see_what_points_see() {
    let scene = Arc::new(with_balls(rooms(20), 4).unwrap());
    let eye = eye_of(&scene, [480, 360]);
    let reflectors = reflectors_of(&scene, &eye);
    let by_points = PointScene::new(&scene, 0.0).points(&eye, &reflectors, &EyePointSettings::default());
    let (traced, _) = ReflectionRays::new(&scene, 0.0).unwrap().maps(&reflectors);
    let off = |texel: &usize| match (traced.get(*texel), by_points.maps.get(*texel)) {
        (Some((_, a)), Some((_, b))) => (a / b - 1.0).abs() > 1e-3,
        (None, None) => false,
        _ => true,
    };
    let off = (0..traced.texels()).filter(off).count();
    assert!(off * 500 < traced.texels(), "{off} of {}", traced.texels());
}

#[test]
fn bytes_do_not_depend_on_the_number_of_threads() {
    let scene = Arc::new(with_balls(rooms(20), 70).unwrap());
    let eye = eye_of(&scene, [160, 120]);
    let reflectors = reflectors_of(&scene, &eye);
    assert!(reflectors.len() > 64, "two words of bits");
    let points = PointScene::new(&scene, 0.0);
    let with_threads = |threads| {
        let pool = ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let found = points.points(&eye, &reflectors, &EyePointSettings::default());
            let pixels = pixels_on(&reflectors);
            let lookups = Lookups {
                maps: &found.maps,
                reflectors: &reflectors,
                eye: eye.position,
                pixels: &pixels,
                taps: &taps(4),
                steps: STEPS,
            };
            let shade = |id: u32| points.shading_of_point(&found, id).position.as_vec3();
            let reflected = reflect(&lookups, &scene.lighting.sky, found.points.len(), |_, id| id, shade);
            (
                found.points.clone(),
                found.maps.bits().collect::<Vec<_>>(),
                reflected.radiance,
                reflected.shades,
            )
        })
    };
    let one = with_threads(1);
    assert!(one.3 > 0);
    assert_eq!(one, with_threads(2));
    assert_eq!(one, with_threads(7));
}

/// Some pixels on each reflector.
pub(super) fn pixels_on(reflectors: &[MappedReflector]) -> Vec<ReflectivePixel> {
    let each = (0u32..).zip(reflectors).flat_map(|(number, reflector)| {
        (0..50u32).map(move |i| {
            let turn = f64::from(i) * 2.4;
            let height = f64::from(i) / 25.0 - 1.0;
            let ring = (1.0 - height * height).max(0.0).sqrt();
            let normal = DVec3::new(ring * turn.cos(), height, ring * turn.sin());
            ReflectivePixel {
                reflector: number,
                position: reflector.center + normal * reflector.radius,
                normal,
                position_steps: [DVec3::X * 0.01, DVec3::Z * 0.01],
                normal_steps: [DVec3::X * 0.02, DVec3::Z * 0.02],
            }
        })
    });
    each.collect()
}

#[test]
fn each_requested_point_is_shaded_once_and_its_shading_lies_on_its_triangle() {
    let scene = Arc::new(with_balls(rooms(20), 6).unwrap());
    let eye = eye_of(&scene, [480, 360]);
    let reflectors = reflectors_of(&scene, &eye);
    let points = PointScene::new(&scene, 0.0);
    let found = points.points(&eye, &reflectors, &EyePointSettings::default());
    let pixels = pixels_on(&reflectors);
    let lookups = Lookups {
        maps: &found.maps,
        reflectors: &reflectors,
        eye: eye.position,
        pixels: &pixels,
        taps: &taps(25),
        steps: STEPS,
    };
    let shaded = std::sync::Mutex::new(Vec::new());
    let shade = |id: u32| {
        shaded.lock().unwrap().push(id);
        let at = points.shading_of_point(&found, id);
        let weights = at.weights;
        assert!(weights[0] > -1e-6 && weights[1] > -1e-6 && weights[0] + weights[1] < 1.0 + 1e-6, "{at:?}");
        Vec3::ONE
    };
    let reflected = reflect(&lookups, &argus_scene::Sky::BLACK, found.points.len(), |_, id| id, shade);
    let mut ids = shaded.into_inner().unwrap();
    ids.sort_unstable();
    assert_eq!(ids.len(), reflected.shades);
    ids.dedup();
    assert_eq!(ids.len(), reflected.shades, "none is shaded twice");
    assert!(reflected.shades < pixels.len() * 25);
    // A closed room shows its walls everywhere, and windows show the black sky.
    let mean = reflected.radiance.iter().map(|radiance| radiance.x).sum::<f32>() / pixels.len() as f32;
    assert!(mean > 0.5 && mean <= 1.0, "{mean}");
}

#[test]
fn a_budget_is_kept_at_less_density_and_leaves_no_holes() {
    let scene = Arc::new(with_balls(rooms(20), 5).unwrap());
    let eye = eye_of(&scene, [480, 360]);
    let reflectors = reflectors_of(&scene, &eye);
    let points = PointScene::new(&scene, 0.0);
    let full = points.points(&eye, &reflectors, &EyePointSettings::default());
    assert_eq!((full.budget.reduction, full.budget.kept), (1.0, true));
    assert_eq!(full.budget.wanted, full.points.len() as u64);
    let budget = (full.points.len() as u32 + full.pieces.all.len() as u32) / 2;
    let [one, other] = [(); 2].map(|()| {
        points.points(&eye, &reflectors, &EyePointSettings { budget, ..EyePointSettings::default() })
    });
    assert!(one.budget.kept && one.budget.reduction < 1.0 && one.points.len() <= budget as usize);
    assert_eq!(one.budget.wanted, full.budget.wanted);
    assert_eq!(one.points, other.points, "the second round is deterministic");
    assert_eq!(errors(&points, &reflectors, &one, 41)[0], 0.0);
    let least =
        points.points(&eye, &reflectors, &EyePointSettings { budget: 10, ..EyePointSettings::default() });
    assert!(!least.budget.kept, "every piece has a point");
    assert_eq!(errors(&points, &reflectors, &least, 97)[0], 0.0);
}

#[test]
fn maps_and_points_are_the_same_with_a_buffer_without_one_and_with_one_for_large_points() {
    let scene = Arc::new(with_balls(terrain(50_000), 4).unwrap());
    let eye = eye_of(&scene, [320, 240]);
    let reflectors = reflectors_of(&scene, &eye);
    let points = PointScene::new(&scene, 0.0);
    for culling in [false, true] {
        let settings = EyePointSettings { culling, ..EyePointSettings::default() };
        let [one, none, some] = [Splatting::Buffered, Splatting::Bufferless, Splatting::Hybrid]
            .map(|splatting| points.points_by(&eye, &reflectors, &settings, splatting));
        assert!(one.points.len() == one.count() && none.points.is_empty());
        assert!(!some.points.is_empty() && some.points.len() < some.count(), "{}", some.points.len());
        for other in [none, some] {
            assert!(one.maps.bits().eq(other.maps.bits()));
            assert_eq!(one.count(), other.count());
            assert!((0..one.count() as u32).step_by(7).all(|id| one.point(id) == other.point(id)));
        }
    }
}

#[test]
fn no_reflector_is_no_work() {
    let scene = Arc::new(rooms(20));
    let found =
        PointScene::new(&scene, 0.0).points(&eye_of(&scene, [64, 48]), &[], &EyePointSettings::default());
    assert_eq!((found.points.len(), found.maps.texels(), found.pieces.all.len()), (0, 0, 0));
}

#[test]
fn more_than_a_thousand_reflectors_have_a_bit_each() {
    let scene = Arc::new(with_balls(rooms(20), 1025).unwrap());
    let eye = eye_of(&scene, [64, 48]);
    let reflectors = reflectors_of(&scene, &eye);
    assert_eq!(reflectors.len(), 1025);
    let walls: Vec<Facet> =
        PointScene::new(&scene, 0.0).facets().iter().filter(|facet| facet.instance < 3).copied().collect();
    let cutter =
        facets::Cutter { eye: &eye, reflectors: &reflectors, density: Density::default(), culling: false };
    let pieces = cutter.cut(&walls);
    assert_eq!(pieces.words, 17);
    let most = (0..pieces.all.len()).map(|piece| pieces.seen_by(piece).count()).max();
    assert!(most > Some(512), "{most:?}");
}
