use super::*;
use crate::light_sampling::{cosine_direction, disc_point, r2};
use crate::rgb9e5::{LARGEST, decode, encode};
use crate::shading::{sky_ambient, sky_radiance};

/// A map whose texels are a function of column and row.
fn map_of(width: u32, texel: impl Fn(u32, u32) -> Vec3) -> Environment {
    let texels = (0..width * width / 2).map(|i| texel(i % width, i / width)).collect();
    Environment::new(width, width / 2, texels).unwrap()
}

/// Directions all around, both poles among them.
fn directions() -> impl Iterator<Item = Vec3> {
    let grid =
        (0..=12).flat_map(|i| (0..24).map(move |j| (f64::from(i) / 12.0 * PI, f64::from(j) / 24.0 * TAU)));
    grid.map(|(polar, around)| {
        DVec3::new(polar.sin() * around.sin(), polar.cos(), -polar.sin() * around.cos()).as_vec3()
    })
}

#[test]
fn a_map_of_one_colour_is_the_same_constant_sky() {
    let color = Vec3::new(0.5, 0.25, 0.75);
    let constant = Sky { zenith: color, horizon: color, ground: color, map: None, reach: None };
    for width in [2, 4, 6, 64, 1000] {
        let environment = map_of(width, |_, _| color);
        assert!(environment.lights.is_empty(), "{width}");
        let sky = Sky::of_map(environment.map);
        for d in directions() {
            assert!((sky_radiance(&sky, d) - sky_radiance(&constant, d)).abs().max_element() < 1e-6, "{d}");
            let ambient = sky_ambient(&sky, d) - sky_ambient(&constant, d);
            assert!(ambient.abs().max_element() < 1e-4, "{width}, {d}: {ambient}");
        }
        assert!((sky.horizon - color).abs().max_element() < 1e-4);
    }
}

#[test]
fn a_black_map_is_black() {
    let environment = map_of(8, |_, _| Vec3::ZERO);
    assert!(environment.lights.is_empty());
    assert_eq!(Sky::of_map(environment.map.clone()), Sky { map: Some(environment.map), ..Sky::BLACK });
}

#[test]
fn the_centre_of_a_map_is_plus_z_and_a_quarter_from_the_left_is_plus_x() {
    // Red grows to the right, green downwards.
    let environment = map_of(64, |x, y| Vec3::new((x as f32 + 0.5) / 64.0, (y as f32 + 0.5) / 32.0, 0.0));
    let at = |d: Vec3| environment.map.radiance(d);
    let near = |found: Vec3, u: f32, v: f32| (found.x - u).abs() < 2e-3 && (found.y - v).abs() < 2e-3;
    assert!(near(at(Vec3::Z), 0.5, 0.5), "{}", at(Vec3::Z));
    assert!(near(at(Vec3::X), 0.25, 0.5), "{}", at(Vec3::X));
    assert!(near(at(Vec3::NEG_X), 0.75, 0.5), "{}", at(Vec3::NEG_X));
    assert!(at(Vec3::Y).y < 0.02 && at(Vec3::NEG_Y).y > 0.98);
}

#[test]
fn the_left_and_right_edges_meet_without_a_seam_at_minus_z() {
    let environment = map_of(16, |x, _| Vec3::splat(if x < 8 { 0.25 } else { 0.75 }));
    let at = |x: f32| environment.map.radiance(Vec3::new(x, 0.0, -1.0).normalize()).x;
    assert!((at(0.0) - 0.5).abs() < 1e-6 && (at(-0.0) - 0.5).abs() < 1e-6, "{}", at(0.0));
    assert!((at(1e-6) - at(-1e-6)).abs() < 1e-4);
    assert!((at(0.5) - 0.25).abs() < 1e-6 && (at(-0.5) - 0.75).abs() < 1e-6);
}

#[test]
fn the_poles_show_the_first_and_the_last_row() {
    let environment = map_of(16, |_, y| Vec3::splat((y + 1) as f32 / 8.0));
    assert_eq!(environment.map.radiance(Vec3::Y), Vec3::splat(0.125));
    assert_eq!(environment.map.radiance(Vec3::NEG_Y), Vec3::ONE);
    for d in [Vec3::new(1e-30, 1.0, 0.0), Vec3::new(0.0, 1.0, -1e-12), Vec3::new(-1e-5, 1.0, 1e-5)] {
        assert_eq!(environment.map.radiance(d), Vec3::splat(0.125), "{d}");
    }
    // Without a direction there is no right answer, but never one that is not a number.
    assert!(environment.map.radiance(Vec3::ZERO).is_finite());
    assert!(environment.map.radiance(Vec3::NAN).x <= 1.0 || environment.map.radiance(Vec3::NAN).x.is_nan());
}

#[test]
fn a_map_of_two_texels_is_two_halves_of_the_sky() {
    let environment = map_of(2, |x, _| Vec3::splat(x as f32));
    assert!(environment.lights.is_empty());
    assert_eq!(environment.map.radiance(Vec3::X), Vec3::ZERO);
    assert_eq!(environment.map.radiance(Vec3::NEG_X), Vec3::ONE);
    assert_eq!(environment.map.radiance(Vec3::Z), Vec3::splat(0.5));
    let ambient = environment.map.ambient(Vec3::NEG_X).x;
    assert!(ambient > 0.7 && ambient < 1.0, "{ambient}");
}

/// A map of 0.5 with one texel of 1e5.
fn with_sun(column: u32, row: u32) -> Environment {
    map_of(64, |x, y| Vec3::splat(if (x, y) == (column, row) { 1e5 } else { 0.5 }))
}

#[test]
fn a_very_bright_texel_becomes_a_light_and_no_energy_is_lost() {
    // At the seam, in a row of the pole, and elsewhere.
    for (column, row) in [(0, 12), (63, 31), (5, 0), (20, 9)] {
        let environment = with_sun(column, row);
        let [Light::Directional { direction, irradiance, angular_radius }] = environment.lights[..] else {
            panic!("{:?}", environment.lights)
        };
        assert!((direction + direction_of([64, 32], column, row)).length() < 1e-9);
        let rest = environment.map.brightest().x;
        assert!((1.0..=4.1).contains(&rest), "{rest}");
        let area = solid_angle([64, 32], row);
        let energy = f64::from(irradiance.x) + f64::from(rest) * area;
        assert!((energy / (1e5 * area) - 1.0).abs() < 1e-4, "{energy}");
        // A disc of the texel's solid angle.
        let disc = TAU * (1.0 - angular_radius.cos());
        assert!((disc / area - 1.0).abs() < 1e-6, "{disc}, {area}");
    }
}

#[test]
fn a_sun_of_several_texels_across_the_seam_is_one_light() {
    let environment = map_of(256, |x, y| {
        let is_sun = !(2..=253).contains(&x) && (60..64).contains(&y);
        if is_sun { Vec3::new(4e4, 3e4, 2e4) } else { Vec3::splat(0.2) }
    });
    let [Light::Directional { direction, angular_radius, irradiance }] = environment.lights[..] else {
        panic!("{:?}", environment.lights)
    };
    assert!((direction.z - 1.0).abs() < 2e-3 && direction.x.abs() < 1e-9, "{direction}");
    // 16 texels of 1.4° a side.
    assert!((0.025..0.06).contains(&angular_radius), "{angular_radius}");
    assert!(irradiance.x > irradiance.y && irradiance.y > irradiance.z);
    assert_eq!(
        environment.map.brightest().z,
        environment.map.texels().iter().map(|t| decode(*t).z).fold(0.0, f32::max)
    );
}

#[test]
fn wide_bright_regions_and_dim_maps_stay_whole() {
    // An eighth of the columns, from pole to pole: too wide for a light.
    let wide = map_of(64, |x, _| Vec3::splat(if x < 4 { 100.0 } else { 0.01 }));
    assert!(wide.lights.is_empty());
    assert!((wide.map.brightest().x / 100.0 - 1.0).abs() < 0.01);
    // Below the white of a display nothing is taken out.
    let dim = map_of(64, |x, y| Vec3::splat(if (x, y) == (9, 9) { 0.9 } else { 0.001 }));
    assert!(dim.lights.is_empty());
}

#[test]
fn at_most_eight_lights_are_taken_and_the_strongest_come_first() {
    let lamp = |x: u32, y: u32| x.is_multiple_of(6) && y == 15;
    let environment = map_of(64, |x, y| Vec3::splat(if lamp(x, y) { 1e3 * (1 + x) as f32 } else { 0.1 }));
    let strength = |light: &Light| match light {
        Light::Directional { irradiance, .. } => irradiance.x,
        _ => panic!("{light:?}"),
    };
    let strengths: Vec<f32> = environment.lights.iter().map(strength).collect();
    assert_eq!(strengths.len(), MOST_LIGHTS);
    assert!(strengths.is_sorted_by(|a, b| a > b), "{strengths:?}");
    assert!(environment.map.brightest().x > 1e3, "the weakest lamps stay in the map");
}

#[test]
fn harmonics_are_near_the_integral_and_within_the_effect_plans_bound() {
    // Twelve patches of light and darkness. The plan's constant bounds the difference by the map's contrast.
    let environment = map_of(64, |x, y| Vec3::splat(((x / 16 + y / 11) % 2) as f32));
    for n in directions().step_by(7) {
        let rays = (0..4096).map(|i| cosine_direction(n.as_dvec3(), disc_point(r2(i))).as_vec3());
        let integral = rays.map(|d| environment.map.radiance(d).x).sum::<f32>() / 4096.0;
        let ambient = environment.map.ambient(n).x;
        assert!((integral - ambient).abs() < 0.09, "{n}: {integral}, {ambient}");
    }
}

#[test]
fn no_clamped_cosine_is_further_from_its_harmonics_than_the_effect_plans_bound() {
    let harmonics = |x: f64| 0.25 + 0.5 * x + 5.0 / 32.0 * (3.0 * x * x - 1.0);
    let steps = 100_000;
    let at = |i: i32| (f64::from(i) + 0.5) / f64::from(steps) * 2.0 - 1.0;
    let whole: f64 = (0..steps).map(|i| (at(i).max(0.0) - harmonics(at(i))).abs()).sum();
    // Irradiance / π is twice the integral over the cosine; a sky differs from its mean by half of its contrast.
    let most = 2.0 * whole * 2.0 / f64::from(steps) / 2.0;
    assert!(most < 0.09, "{most}");
}

#[test]
fn patches_add_up_to_the_whole_map_whatever_its_size() {
    for width in [2, 10, 64, 200, 514] {
        let environment = map_of(width, |x, y| Vec3::splat(0.1 + ((x * 7 + y * 3) % 5) as f32 * 0.2));
        let sum: f64 = environment.map.patches([32, 16]).iter().map(|patch| patch.power.x).sum();
        let size = environment.map.size();
        let texels = environment.map.texels().iter().enumerate();
        let whole: f64 =
            texels.map(|(i, t)| f64::from(decode(*t).x) * solid_angle(size, i as u32 / width)).sum();
        let most = if width < 32 { 0.2 } else { 1e-9 };
        assert!((sum / whole - 1.0).abs() < most, "{width}: {sum}, {whole}");
    }
}

#[test]
fn radiance_is_kept_with_nine_bits() {
    let most = Vec3::splat(LARGEST);
    for color in [
        Vec3::ZERO,
        Vec3::ONE,
        Vec3::new(0.7, 1e-3, 3.9),
        Vec3::splat(1e-7),
        Vec3::new(511.9, 1.0, 0.0),
        most,
    ] {
        let kept = decode(encode(color));
        let step = color.max_element() / 256.0;
        assert!((kept - color).abs().max_element() <= step.max(6e-8), "{color}: {kept}");
    }
    assert_eq!(decode(encode(Vec3::splat(1e9))), most);
}

#[test]
fn sizes_and_texels_that_no_map_can_have_are_refused_with_the_reason() {
    let refused =
        |width: u32, height: u32, texels: Vec<Vec3>| Environment::new(width, height, texels).unwrap_err();
    assert!(refused(0, 0, Vec::new()).contains("empty"));
    assert!(refused(2, 2, vec![Vec3::ONE; 4]).contains("twice as wide as high"));
    assert!(refused(1, 2, vec![Vec3::ONE; 2]).contains("twice as wide as high"));
    assert!(refused(16384, 8192, Vec::new()).contains("at most 8192×4096"));
    assert!(refused(4, 2, vec![Vec3::ONE; 7]).contains("7 texels, not 4×2"));
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -1e-6] {
        let mut texels = vec![Vec3::ONE; 8];
        texels[6].y = bad;
        let reason = refused(4, 2, texels);
        assert!(
            reason.starts_with("texel 2, 1 is (1, ") && reason.contains("finite and not negative"),
            "{reason}"
        );
    }
}
