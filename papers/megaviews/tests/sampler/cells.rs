//! Points of octree leaves are lit by the light cells that direct views are lit by.

use std::sync::Arc;

use argus_sampler::{CellSettings, Indirect, PathSettings, SamplerSettings};
use argus_scene::tone::display_from_radiance;
use argus_scene::{
    Camera, LightEffects, MegaViews, Plan, Sample, SampleJob, SampleSetInfo, Sampler as _, Sampling,
    SurfaceLight, ViewJob,
};
use glam::DVec3;

use crate::common::*;
use crate::rooms::box_of_cornell;

const FACE: u32 = 48;
/// Texels along a side of the squares whose means are compared.
const SQUARE: u32 = 8;

/// Mean colour of each square of an image of bytes, of 255.
fn squares(color: impl Fn(u32, u32) -> [u8; 3]) -> Vec<[f64; 3]> {
    let side = FACE / SQUARE;
    let mean = |square: u32| {
        let mut sum = [0.0; 3];
        for i in 0..SQUARE * SQUARE {
            let at = color(square % side * SQUARE + i % SQUARE, square / side * SQUARE + i / SQUARE);
            (0..3).for_each(|channel| sum[channel] += f64::from(at[channel]) / f64::from(SQUARE * SQUARE));
        }
        sum
    };
    (0..side * side).map(mean).collect()
}

/// Differences of two faces' squares, ascending, of 255.
fn differences(one: &[[f64; 3]], other: &[[f64; 3]]) -> Vec<f64> {
    let apart = |(a, b): (&[f64; 3], &[f64; 3])| (0..3).map(|c| (a[c] - b[c]).abs()).fold(0.0, f64::max);
    let mut apart: Vec<f64> = one.iter().zip(other).map(apart).collect();
    apart.sort_by(f64::total_cmp);
    apart
}

#[test]
fn leaves_of_an_octree_have_the_light_of_cells_that_direct_views_have() {
    let scene = box_of_cornell(DVec3::ZERO);
    let paths = PathSettings { level: 6, ..PathSettings::default() };
    let indirect = Indirect::Cells(CellSettings { paths, ..CellSettings::default() });
    let lit_by = |indirect: Indirect| {
        let effects = indirect.effects_with(LightEffects { shadows: true, ..LightEffects::NONE });
        sampler_with(
            &scene,
            SamplerSettings { sub_samples: 1, effects, indirect, ..SamplerSettings::default() },
        )
    };
    let mut sampler = lit_by(indirect);
    let sampling = Sampling::MegaViews(MegaViews { map_side: 128, levels: 7, block: 1 });
    let usual = job_around_origin(&scene, FACE);
    let job = SampleJob { info: Arc::new(SampleSetInfo { sampling, ..(*usual.info).clone() }), ..usual };
    let mapped: Sample = sample(&mut sampler, &job);
    let report = sampler.light_cells().expect("the sampler has light cells");
    let share = report.pixels_lit as f64 / report.pixels as f64;
    println!("cells lit {share:.3} of {} points of leaves", report.pixels);
    assert!(report.pixels > 10_000 && share > 0.8, "{report:?}");

    let mut without = lit_by(Indirect::Off);
    let radiance = radiance_of(&mapped);
    let (mut apart, mut apart_from_direct) = (Vec::new(), Vec::new());
    for face in mapped.camera.faces() {
        let axes = face.view_from_world.transpose();
        let eye = mapped.camera.center();
        let fov_deg = 2.0 * face.tan_half_fov.y.atan().to_degrees();
        let camera = Camera { up: axes.y_axis, fov_deg, ..Camera::look_at(eye, eye - axes.z_axis) };
        let view = view_job(camera, [FACE; 2], 1);
        let light = SurfaceLight::Cells { rays: CellSettings::FIRST_RAYS, reflected: true };
        let by_cells = ViewJob { plan: Plan::direct(1).with_light(Some(light)), ..view.clone() };
        let of_map = squares(|x, y| {
            let at = (face.offset[1] + y) * mapped.camera.size()[0] + face.offset[0] + x;
            display_from_radiance(radiance[at as usize], scene.lighting.exposure)
        });
        let of_view = |frame| {
            let image = image_of(&frame);
            squares(|x, y| image.get_pixel(x, y).0)
        };
        apart.extend(differences(&of_map, &of_view(direct(&mut sampler, &by_cells))));
        apart_from_direct.extend(differences(&of_map, &of_view(direct(&mut without, &view))));
    }
    let median = |apart: &mut Vec<f64>| {
        apart.sort_by(f64::total_cmp);
        (apart[apart.len() / 2], apart[apart.len() * 9 / 10])
    };
    let ((middle, most), (middle_off, _)) = (median(&mut apart), median(&mut apart_from_direct));
    println!(
        "squares differ by {middle:.2}, nine of ten by at most {most:.2} of 255; without cells by {middle_off:.2}"
    );
    assert!(middle < 4.0 && most < 16.0, "{middle} and {most} of 255");
    // What is compared is the light of cells: without it the faces look otherwise.
    assert!(middle_off > 4.0 * middle, "{middle_off} of 255 without cells, {middle} with them");
}
