//! Points on the device against points on the CPU.

use std::collections::HashMap;
use std::sync::{Arc, OnceLock};

use crate::device::{PointPasses, PointsError};
use argus_gpu::{Gpu, GpuOptions};
use argus_scene::procedural::{mirrors, rooms, terrain, with_balls};
use argus_scene::{AlphaMode, Scene};
use glam::{DAffine3, DVec3};

use super::tests::{eye_of, reflectors_of};
use super::*;

pub(super) fn gpu() -> Arc<Gpu> {
    static GPU: OnceLock<Arc<Gpu>> = OnceLock::new();
    let open = || Gpu::new(&GpuOptions::default()).expect("these tests need a Vulkan driver");
    Arc::clone(GPU.get_or_init(open))
}

/// A scene whose instances are all moved.
pub(super) fn moved(scene: Scene, by: DVec3) -> Scene {
    let mut scene = scene;
    let by = DAffine3::from_translation(by);
    scene.instances.iter_mut().for_each(|instance| instance.world_from_mesh = by * instance.world_from_mesh);
    Scene { nodes: Vec::new(), animations: Vec::new(), ..scene }
}

/// Points of the CPU and of the device.
fn both(
    points: &PointScene,
    device: &PointDevice,
    eye: &Eye,
    reflectors: &[MappedReflector],
    settings: &EyePointSettings,
) -> [EyePoints; 2] {
    [points.points(eye, reflectors, settings), points.points_on(device, eye, reflectors, settings).unwrap()]
}

/// Texels that name another point, and those that only one of the two has; shares of all. Ranges of equal points are equal
/// but for rounding.
fn differences([cpu, device]: &[EyePoints; 2]) -> [f64; 2] {
    assert_eq!(cpu.maps.texels(), device.maps.texels());
    let (mut other, mut holes) = (0, 0);
    let named = |points: &EyePoints, id: u32| {
        let point = points.point(id);
        (points.pieces.all[point.piece() as usize], point.cell())
    };
    for texel in 0..cpu.maps.texels() {
        match (cpu.maps.get(texel), device.maps.get(texel)) {
            (Some((a, of_cpu)), Some((b, of_device))) => {
                let same = named(cpu, a) == named(device, b);
                other += usize::from(!same);
                assert!(
                    !same || (of_cpu / of_device - 1.0).abs() < 1e-4,
                    "texel {texel}: {of_cpu} {of_device}"
                );
            }
            (None, None) => (),
            _ => holes += 1,
        }
    }
    let texels = cpu.maps.texels() as f64;
    println!("{other} of {texels} texels name another point, {holes} are seen by one only");
    [other as f64 / texels, holes as f64 / texels]
}

fn assert_equal(scene: Scene, size: [u32; 2], moved_by: DVec3) {
    let scene = Arc::new(scene);
    let mut eye = eye_of(&scene, size);
    eye.position += moved_by;
    let scene = Arc::new(moved(Scene::clone(&scene), moved_by));
    let reflectors = reflectors_of(&scene, &eye);
    let points = PointScene::new(&scene, 0.0);
    let device = PointDevice::new(&gpu(), &points);
    for culling in [false, true] {
        let settings = EyePointSettings { culling, ..EyePointSettings::default() };
        let both = both(&points, &device, &eye, &reflectors, &settings);
        let [other, holes] = differences(&both);
        assert!(other < 1e-3 && holes <= 1e-5, "{other} {holes}");
        let again = points.points_on(&device, &eye, &reflectors, &settings).unwrap();
        assert!(again.points == both[1].points && again.maps.bits().eq(both[1].maps.bits()));
    }
}

#[test]
fn a_device_names_the_points_that_the_cpu_names_and_equal_ones_again() {
    assert_equal(with_balls(rooms(20), 5).unwrap(), [480, 360], DVec3::ZERO);
    assert_equal(mirrors(6), [320, 240], DVec3::ZERO);
}

#[test]
fn a_device_names_the_same_points_a_million_metres_from_the_origin() {
    assert_equal(with_balls(rooms(20), 5).unwrap(), [480, 360], DVec3::new(1e6, -1e6, 1e6));
}

#[test]
fn a_device_names_the_same_points_of_many_small_triangles() {
    assert_equal(with_balls(terrain(50_000), 3).unwrap(), [320, 240], DVec3::ZERO);
}

#[test]
fn a_device_sees_through_what_is_cut_out() {
    let whole = with_balls(rooms(20), 3).unwrap();
    let mut scene = whole.clone();
    let seen = whole.meshes[whole.instances[0].mesh as usize].material as usize;
    scene.materials[seen].alpha = AlphaMode::Mask(0.5);
    scene.materials[seen].base_color.w = 0.25;
    let eye = eye_of(&scene, [320, 240]);
    let reflectors = reflectors_of(&scene, &eye);
    let [whole, scene] = [whole, scene].map(|scene| PointScene::new(&Arc::new(scene), 0.0));
    assert!(scene.facets().iter().any(|facet| facet.cutout));
    let device = PointDevice::new(&gpu(), &scene);
    let both = both(&scene, &device, &eye, &reflectors, &EyePointSettings::default());
    let [other, holes] = differences(&both);
    assert!(other < 1e-3 && holes <= 1e-5, "{other} {holes}");
    let uncut = whole.points(&eye, &reflectors, &EyePointSettings::default());
    assert!((0..uncut.maps.texels()).any(|texel| uncut.maps.get(texel) != both[1].maps.get(texel)));
}

#[test]
fn no_point_of_the_cpu_is_missing_on_the_device_and_few_are_added() {
    let scene = Arc::new(with_balls(rooms(20), 5).unwrap());
    let eye = eye_of(&scene, [480, 360]);
    let reflectors = reflectors_of(&scene, &eye);
    let points = PointScene::new(&scene, 0.0);
    let device = PointDevice::new(&gpu(), &points);
    let [cpu, device] = both(&points, &device, &eye, &reflectors, &EyePointSettings::default());
    assert!(device.points.is_sorted());
    let missing = cpu.points.iter().filter(|point| device.points.binary_search(point).is_err()).count();
    assert_eq!(missing, 0);
    assert!(
        device.points.len() * 100 < cpu.points.len() * 102,
        "{} {}",
        device.points.len(),
        cpu.points.len()
    );
}

#[test]
fn no_reflector_and_sixty_five_reflectors_are_served() {
    let scene = Arc::new(with_balls(rooms(20), 65).unwrap());
    let eye = eye_of(&scene, [64, 48]);
    let reflectors = reflectors_of(&scene, &eye);
    assert_eq!(reflectors.len(), 65, "two words of bits");
    let points = PointScene::new(&scene, 0.0);
    let device = PointDevice::new(&gpu(), &points);
    let [other, holes] =
        differences(&both(&points, &device, &eye, &reflectors, &EyePointSettings::default()));
    assert!(other < 1e-3 && holes <= 1e-5, "{other} {holes}");
    let none = points.points_on(&device, &eye, &[], &EyePointSettings::default()).unwrap();
    assert_eq!((none.count(), none.maps.texels(), none.pieces.all.len()), (0, 0, 0));
}

#[test]
fn cells_larger_than_a_tile_are_divided_and_leave_no_holes() {
    let scene = Arc::new(with_balls(rooms(20), 3).unwrap());
    let eye = Eye { height: 1080, pixels: 2000.0, ..eye_of(&scene, [640, 480]) };
    let reflectors = reflectors_of(&scene, &eye);
    let points = PointScene::new(&scene, 0.0);
    let device = PointDevice::new(&gpu(), &points);
    let density = Density { reduction: 0.01, ..Density::default() };
    let settings = EyePointSettings { density, ..EyePointSettings::default() };
    let both = both(&points, &device, &eye, &reflectors, &settings);
    let mut texels_of: HashMap<u32, u32> = HashMap::new();
    (0..both[0].maps.texels())
        .filter_map(|texel| both[0].maps.get(texel))
        .for_each(|(id, _)| *texels_of.entry(id).or_default() += 1);
    assert!(texels_of.values().any(|texels| *texels > 2 * 32 * 32), "a cell covers several tiles");
    let [other, holes] = differences(&both);
    assert!(other < 1e-3 && holes <= 1e-5, "{other} {holes}");
}

#[test]
fn maps_that_exceed_an_array_are_filled_in_turns_and_points_that_do_are_an_error_with_a_name() {
    let scene = Arc::new(with_balls(rooms(20), 5).unwrap());
    let eye = eye_of(&scene, [1920, 1440]);
    let reflectors = reflectors_of(&scene, &eye);
    let points = PointScene::new(&scene, 0.0);
    let passes =
        |bytes| PointDevice::with_passes(Arc::new(PointPasses::with_arrays_of(&gpu(), bytes)), &points);
    let settings = EyePointSettings { budget: u32::MAX, ..EyePointSettings::default() };
    let whole = points.points_on(&passes(u64::MAX), &eye, &reflectors, &settings).unwrap();
    let largest_map = reflectors.iter().map(|r| 6 * 8 * u64::from(r.side).pow(2)).max().unwrap();
    let others = (whole.points.len() * 8).max(whole.pieces.all.len() * 96) as u64;
    let bytes = largest_map.max(others);
    assert!(bytes < whole.maps.bytes() as u64, "{bytes}: there are several turns");
    let in_turns = points.points_on(&passes(bytes), &eye, &reflectors, &settings).unwrap();
    assert!(in_turns.maps.bits().eq(whole.maps.bits()));
    let name = |bytes, reduction| {
        let density = Density { reduction, ..Density::default() };
        let settings = EyePointSettings { density, ..settings };
        match points.points_on(&passes(bytes), &eye, &reflectors, &settings) {
            Err(PointsError::TooLarge { what, needed, limit }) if needed > limit => what,
            other => panic!("{:?}", other.map(|points| points.count())),
        }
    };
    assert_eq!(name(1000, 1.0), "triangles");
    assert_eq!(name(2 * bytes, 16.0), "points");
    // More points than 32 bits can count.
    assert_eq!(name(2 * bytes, 4096.0), "points");
}
