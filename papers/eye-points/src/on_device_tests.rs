//! Cutting and lookups of the device against the CPU's.

use std::collections::HashMap;
use std::sync::Arc;

use argus_sampler::plug::taps;
use argus_scene::procedural::{mirrors, rooms, terrain, with_balls};
use argus_scene::{AlphaMode, Scene};
use glam::DVec3;

use super::compute_tests::{gpu, moved};
use super::device::{PointPasses, PointsError};
use super::tests::{eye_of, pixels_on, reflectors_of};
use super::*;

/// A scene with its triangles on the device, an eye and reflectors.
struct Setting {
    scene: Arc<Scene>,
    points: PointScene,
    device: PointDevice,
    eye: Eye,
    reflectors: Vec<MappedReflector>,
}

impl Setting {
    fn new(scene: Scene, size: [u32; 2], by: DVec3) -> Self {
        let eye = eye_of(&scene, size);
        let eye = Eye { position: eye.position + by, ..eye };
        let scene = Arc::new(moved(scene, by));
        let reflectors = reflectors_of(&scene, &eye);
        let points = PointScene::new(&scene, 0.0);
        let device = PointDevice::new(&gpu(), &points);
        Self { scene, points, device, eye, reflectors }
    }

    fn rooms(balls: u32, size: [u32; 2]) -> Self {
        Self::new(with_balls(rooms(20), balls).unwrap(), size, DVec3::ZERO)
    }

    fn of_cpu(&self, settings: &EyePointSettings) -> EyePoints {
        self.points.points(&self.eye, &self.reflectors, settings)
    }

    fn filled(&self, settings: &EyePointSettings) -> DevicePoints {
        self.points.fill_on(&self.device, &self.eye, &self.reflectors, settings).unwrap()
    }

    fn of_device(&self, settings: &EyePointSettings) -> EyePoints {
        let filled = self.filled(settings);
        self.points.read_points(&self.device, filled, &self.reflectors).unwrap()
    }
}

/// Checks that pieces of the device are those of the CPU but for a few at which rounding decides.
fn assert_pieces_alike(cpu: &EyePoints, device: &EyePoints) {
    type Key = (u32, Side, [[u64; 3]; 3]);
    let key = |piece: &Piece| -> Key {
        let bits = |corner: DVec3| corner.to_array().map(f64::to_bits);
        (piece.facet, piece.side, piece.corners.map(bits))
    };
    let keys: Vec<Key> = device.pieces.all.iter().map(key).collect();
    let index: HashMap<&Key, usize> = keys.iter().zip(0..).collect();
    assert_eq!((cpu.pieces.words, index.len()), (device.pieces.words, keys.len()));
    let (mut alike, mut other_bits, mut before) = (0, 0, 0);
    let mut disordered = 0;
    for (number, piece) in cpu.pieces.all.iter().enumerate() {
        let Some(&at) = index.get(&key(piece)) else { continue };
        let found = &device.pieces.all[at];
        let ratio = found.grid.density / piece.grid.density;
        assert!((ratio - 1.0).abs() < 1e-3, "piece {number}: {ratio}");
        assert_eq!(found.whole_cell, piece.whole_cell, "piece {number}");
        other_bits += usize::from(cpu.pieces.bits(number) != device.pieces.bits(at));
        disordered += usize::from(at < before);
        before = at;
        alike += 1;
    }
    let [of_cpu, of_device] = [cpu, device].map(|points| points.pieces.all.len());
    println!(
        "{alike} of {of_cpu} pieces are alike, {other_bits} with other bits; the device has {of_device}"
    );
    assert_eq!(disordered, 0, "pieces have the CPU's order");
    assert!((of_cpu - alike) * 500 <= of_cpu && of_device.abs_diff(alike) * 500 <= of_device);
    assert!(other_bits * 1000 <= of_cpu, "{other_bits}");
}

/// Shares of texels that see another triangle, or another range by more than 10⁻⁴, and that only one of the two has.
fn differences(cpu: &EyePoints, device: &EyePoints) -> [f64; 2] {
    assert_eq!(cpu.maps.texels(), device.maps.texels());
    let facet = |points: &EyePoints, id: u32| points.pieces.all[points.point(id).piece() as usize].facet;
    let (mut other, mut holes) = (0, 0);
    for texel in 0..cpu.maps.texels() {
        match (cpu.maps.get(texel), device.maps.get(texel)) {
            (Some((a, of_cpu)), Some((b, of_device))) => {
                let is_other = facet(cpu, a) != facet(device, b) || (of_cpu / of_device - 1.0).abs() > 1e-4;
                other += usize::from(is_other);
            }
            (None, None) => (),
            _ => holes += 1,
        }
    }
    let texels = cpu.maps.texels() as f64;
    println!("{other} of {texels} texels see something else, {holes} are seen by one only");
    [other as f64 / texels, holes as f64 / texels]
}

fn assert_alike(setting: &Setting, settings: &EyePointSettings) {
    assert_alike_within(setting, settings, 1e-5);
}

/// `most` is the largest share of texels that only one of the two sees.
fn assert_alike_within(setting: &Setting, settings: &EyePointSettings, most: f64) {
    let (cpu, device) = (setting.of_cpu(settings), setting.of_device(settings));
    assert_pieces_alike(&cpu, &device);
    let [other, holes] = differences(&cpu, &device);
    assert!(other < 1e-3 && holes <= most, "{other} {holes}");
    let again = setting.of_device(settings);
    assert!(again.points == device.points && again.maps.bits().eq(device.maps.bits()));
}

#[test]
fn triangles_that_the_device_cuts_have_the_pieces_and_fill_the_maps_of_the_cpu() {
    let setting = Setting::rooms(5, [480, 360]);
    for rule in [DensityRule::Eye, DensityRule::Planar, DensityRule::Map, DensityRule::Shadow] {
        let density = Density { rule, ..Density::default() };
        assert_alike(&setting, &EyePointSettings { density, ..EyePointSettings::default() });
    }
    let dense = Density { scale: 4.0, ..Density::default() };
    assert_alike(&setting, &EyePointSettings { density: dense, ..EyePointSettings::default() });
    assert_alike(&Setting::new(mirrors(6), [320, 240], DVec3::ZERO), &EyePointSettings::default());
}

#[test]
fn triangles_are_cut_alike_a_million_metres_from_the_origin() {
    let scene = with_balls(rooms(20), 5).unwrap();
    assert_alike(&Setting::new(scene, [480, 360], DVec3::new(1e6, -1e6, 1e6)), &EyePointSettings::default());
}

#[test]
fn small_triangles_are_culled_alike_and_those_that_stand_alone_are_kept() {
    let setting = Setting::new(with_balls(terrain(50_000), 3).unwrap(), [320, 240], DVec3::ZERO);
    for culling in [false, true] {
        assert_alike(&setting, &EyePointSettings { culling, ..EyePointSettings::default() });
    }
    let all = setting.of_device(&EyePointSettings::default());
    let culled = setting.of_device(&EyePointSettings { culling: true, ..EyePointSettings::default() });
    assert!(culled.points.len() < all.points.len());
}

#[test]
fn what_is_cut_out_is_open_in_maps_of_the_device() {
    let mut scene = with_balls(rooms(20), 3).unwrap();
    let seen = scene.meshes[scene.instances[0].mesh as usize].material as usize;
    scene.materials[seen].alpha = AlphaMode::Mask(0.5);
    scene.materials[seen].base_color.w = 0.25;
    let setting = Setting::new(scene, [320, 240], DVec3::ZERO);
    assert!(setting.points.facets().iter().any(|facet| facet.cutout));
    assert_alike(&setting, &EyePointSettings::default());
}

#[test]
fn planar_mirrors_see_what_lies_before_them_only() {
    let mut setting = Setting::new(mirrors(6), [320, 240], DVec3::ZERO);
    let planar = |index: u32| {
        let instance = &setting.scene.instances[index as usize];
        planar_reflector(&setting.scene, index, instance, &setting.eye)
    };
    let found: Vec<MappedReflector> = (0..setting.scene.instances.len() as u32)
        .filter_map(planar)
        .take(2)
        .map(|reflector| MappedReflector { side: 96, ..reflector })
        .collect();
    assert!(!found.is_empty());
    setting.reflectors = found;
    // Rounding decides where something touches the mirror's plane.
    assert_alike_within(&setting, &EyePointSettings::default(), 1e-4);
}

#[test]
fn an_eye_within_a_reflector_gets_finite_densities_of_the_device() {
    let mut setting = Setting::rooms(3, [160, 120]);
    setting.eye = Eye { position: setting.reflectors[1].center, ..setting.eye };
    assert_alike(&setting, &EyePointSettings::default());
}

/// Rooms with balls of which only the reflections count: balls are not splatted into one another's maps.
fn walls_among(balls: u32, size: [u32; 2]) -> Setting {
    let mut setting = Setting::rooms(balls, size);
    setting.points.facets.retain(|facet| facet.instance < 3);
    setting.device = PointDevice::new(&gpu(), &setting.points);
    setting
}

#[test]
fn no_reflector_and_sixty_five_and_more_than_a_thousand_are_served() {
    let setting = walls_among(65, [64, 48]);
    assert_eq!(setting.reflectors.len(), 65, "two words of 64 bits");
    assert_alike(&setting, &EyePointSettings::default());
    let none = Setting { reflectors: Vec::new(), ..setting };
    let found = none.of_device(&EyePointSettings::default());
    assert_eq!((found.count(), found.maps.texels(), found.pieces.all.len()), (0, 0, 0));
    let mut many = walls_among(1025, [16, 12]);
    assert_eq!(many.reflectors.len(), 1025);
    // Small maps: only the pieces are compared.
    many.reflectors.iter_mut().for_each(|reflector| reflector.side = 8);
    let sparse = Density { reduction: 0.02, ..Density::default() };
    let settings = EyePointSettings { density: sparse, ..EyePointSettings::default() };
    let (cpu, device) = (many.of_cpu(&settings), many.of_device(&settings));
    assert_eq!(device.pieces.words, 17);
    assert_pieces_alike(&cpu, &device);
}

#[test]
fn a_budget_is_kept_on_the_device_and_leaves_no_holes() {
    let setting = Setting::rooms(5, [480, 360]);
    let full = setting.of_device(&EyePointSettings::default());
    assert_eq!((full.budget.reduction, full.budget.kept), (1.0, true));
    let budget = (full.points.len() as u32 + full.pieces.all.len() as u32) / 2;
    let some = EyePointSettings { budget, ..EyePointSettings::default() };
    let found = setting.of_device(&some);
    assert!(found.budget.kept && found.budget.reduction < 1.0 && found.points.len() <= budget as usize);
    assert_eq!(found.budget.wanted, full.points.len() as u64);
    let [_, holes] = differences(&setting.of_cpu(&some), &found);
    assert!(holes <= 1e-5, "{holes}");
    let least = setting.of_device(&EyePointSettings { budget: 10, ..EyePointSettings::default() });
    assert!(!least.budget.kept, "every piece has a point");
}

#[test]
fn arrays_that_exceed_a_binding_are_divided_and_no_byte_changes() {
    let setting = Setting::rooms(5, [640, 480]);
    // Maps are not divided, so they are small.
    let small = |reflector: &MappedReflector| MappedReflector { side: 48, ..*reflector };
    let reflectors: Vec<MappedReflector> = setting.reflectors.iter().map(small).collect();
    let density = Density { scale: 4.0, ..Density::default() };
    let settings = EyePointSettings { density, ..EyePointSettings::default() };
    let found = |passes: PointPasses| {
        let device = PointDevice::with_passes(Arc::new(passes), &setting.points);
        let filled = setting.points.fill_on(&device, &setting.eye, &reflectors, &settings).unwrap();
        let numbers = [filled.parts.len(), filled.turns.len()];
        (setting.points.read_points(&device, filled, &reflectors).unwrap(), numbers)
    };
    let (one, numbers) = found(PointPasses::new(&gpu()));
    assert_eq!(numbers, [1, 1]);
    // Nor is a triangle divided: an array holds the points of each, their pieces, and a map.
    let mut most = [0; 2];
    for piece in one.pieces.all.chunk_by(|a, b| a.facet == b.facet) {
        let points: u64 = piece.iter().map(|piece| piece.rows().cells()).sum();
        most = [most[0].max(points), most[1].max(piece.len() as u64)];
    }
    let limit = (9 * most[0]).max(96 * most[1]).max(6 * 8 * 48 * 48);
    let (divided, [parts, turns]) = found(PointPasses::with_arrays_of(&gpu(), limit));
    let [pieces, points] = [one.pieces.all.len(), one.points.len()];
    println!("arrays of {limit} bytes: {pieces} pieces, {points} points in {parts} parts, {turns} turns");
    assert!(parts > 1 && turns > 1);
    assert_eq!(one.points, divided.points);
    assert_eq!(one.pieces.visible, divided.pieces.visible);
    assert!(one.maps.bits().eq(divided.maps.bits()));
}

#[test]
fn a_triangle_with_more_points_than_an_array_is_an_error_with_a_name() {
    let setting = walls_among(2, [160, 120]);
    let density = Density { reduction: 64.0, ..Density::default() };
    let settings = EyePointSettings { density, budget: u32::MAX, culling: false };
    let device =
        PointDevice::with_passes(Arc::new(PointPasses::with_arrays_of(&gpu(), 1 << 20)), &setting.points);
    match setting.points.fill_on(&device, &setting.eye, &setting.reflectors, &settings) {
        Err(PointsError::TooLarge { what, needed, limit }) => {
            assert!(needed > limit, "{what}: {needed} {limit}");
            assert!(what.contains("point") || what.contains("pieces") || what.contains("cells"), "{what}");
        }
        other => panic!("{other:?}"),
    }
}

/// Lookups of the device in its own maps, which are read back for the CPU.
#[test]
fn the_device_meets_what_the_cpu_meets_and_lists_each_point_once() {
    let setting = Setting::rooms(6, [480, 360]);
    let pixels = pixels_on(&setting.reflectors);
    let taps = taps(25);
    let (eye, reflectors) = (setting.eye.position, &setting.reflectors[..]);
    let limits = [u64::MAX, setting.reflectors.iter().map(|r| 48 * u64::from(r.side).pow(2)).max().unwrap()];
    let mut all_met = Vec::new();
    for limit in limits {
        let passes = PointPasses::with_arrays_of(&gpu(), limit);
        let device = PointDevice::with_passes(Arc::new(passes), &setting.points);
        let settings = EyePointSettings::default();
        let filled = setting.points.fill_on(&device, &setting.eye, reflectors, &settings).unwrap();
        let lookups = DeviceLookups { reflectors, eye, pixels: &pixels, taps: &taps, steps: STEPS };
        let rays = lookups.upload(&device).unwrap();
        let requested = device.passes.request(&filled.turns, &rays, STEPS, filled.count()).unwrap();
        let met = device.passes.met_ids(&rays, &requested).unwrap();
        let slots = device.passes.slots(&rays, &requested).unwrap();
        let ids = device.passes.requested_ids(&requested).unwrap();
        // Lists follow exactly from what was met.
        let mut expected: Vec<u32> = met.iter().filter_map(|id| id.checked_sub(1)).collect();
        expected.sort_unstable();
        expected.dedup();
        assert_eq!(ids, expected);
        let slot = |id: &u32| id.checked_sub(1).map_or(0, |id| 1 + ids.binary_search(&id).unwrap() as u32);
        assert_eq!(slots, met.iter().map(slot).collect::<Vec<_>>());
        let listed = setting.points.requested_points(&device, &filled, &requested).unwrap();
        let found = setting.points.read_points(&device, filled, reflectors).unwrap();
        for (id, point) in ids.iter().zip(&listed) {
            assert_eq!(*point, setting.points.shading_of_point(&found, *id));
        }
        // What is met is what the CPU meets in the same maps, but where rounding decides.
        let of_cpu =
            Lookups { maps: &found.maps, reflectors, eye, pixels: &pixels, taps: &taps, steps: STEPS };
        let by_cpu = pixels.iter().flat_map(|pixel| taps.iter().map(move |tap| (pixel, *tap)));
        let others = by_cpu.zip(&met).filter(|((pixel, tap), met)| {
            found.maps.get(of_cpu.texel(pixel, *tap).0).map_or(0, |(id, _)| id + 1) != **met
        });
        let others = others.count();
        println!("{others} of {} lookups meet another point", met.len());
        assert!(others * 200 < met.len(), "{others} of {}", met.len());
        all_met.push(met);
    }
    assert_eq!(all_met[0], all_met[1], "arrays of a binding's size change nothing");
}

#[test]
fn reflections_of_the_device_are_those_of_the_cpu_under_a_gradient_and_an_environment() {
    let setting = Setting::rooms(6, [480, 360]);
    let pixels = pixels_on(&setting.reflectors);
    let taps = taps(25);
    let (eye, reflectors) = (setting.eye.position, &setting.reflectors[..]);
    let filled = setting.filled(&EyePointSettings::default());
    let lookups = DeviceLookups { reflectors, eye, pixels: &pixels, taps: &taps, steps: STEPS };
    let shade = |at: &SurfacePoint| at.position.as_vec3().abs().fract() + 0.1;
    let texels: Vec<Vec3> = (0..32).map(|texel| Vec3::new(1.0, 2.0, texel as f32)).collect();
    let map = argus_scene::Environment::new(8, 4, texels).unwrap().map;
    let gradient = argus_scene::Sky::DAYLIGHT;
    let mapped = argus_scene::Sky { map: Some(map), ..argus_scene::Sky::BLACK };
    let found = setting.filled(&EyePointSettings::default());
    let found = setting.points.read_points(&setting.device, found, reflectors).unwrap();
    let of_cpu = Lookups { maps: &found.maps, reflectors, eye, pixels: &pixels, taps: &taps, steps: STEPS };
    for sky in [&gradient, &mapped] {
        let device = setting.points.reflect_on(&setting.device, &filled, &lookups, sky, shade).unwrap();
        let by_id = |id: u32| shade(&setting.points.shading_of_point(&found, id));
        let cpu = reflect(&of_cpu, sky, found.count(), |_, id| id, by_id);
        assert!(device.shades.abs_diff(cpu.shades) * 100 < cpu.shades, "{} {}", device.shades, cpu.shades);
        let off = |(a, b): &(&Vec3, &Vec3)| (**a - **b).abs().max_element() > 1e-4;
        let others = device.radiance.iter().zip(&cpu.radiance).filter(off).count();
        println!("{others} of {} pixels differ", pixels.len());
        assert!(others * 10 < pixels.len(), "{others} of {}", pixels.len());
        let mean = |all: &[Vec3]| all.iter().sum::<Vec3>() / all.len() as f32;
        assert!((mean(&device.radiance) - mean(&cpu.radiance)).abs().max_element() < 1e-3);
    }
}
