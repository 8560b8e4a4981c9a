//! Views of which less is rendered, against the same views in full.
#![allow(clippy::unwrap_used)] // a test ends at the first thing that goes wrong

use std::sync::Arc;

use argus_sampler::{GpuSampler, SamplerSettings};
use argus_scene::metrics;
use argus_scene::procedural::terrain;
use argus_scene::{
    Camera, CellSettings, Detail, Frame, Indirect, LightEffects, Output, PathSettings, Plan, Scene,
    SurfaceLight, ViewJob,
};
use glam::DVec3;

use crate::cells::fill;
use crate::common::{direct, image_of, sampler_with, view_job};

fn lit(scene: &Arc<Scene>) -> GpuSampler {
    let indirect = Indirect::Paths(PathSettings { level: 5, ..PathSettings::default() });
    sampler_with(
        scene,
        SamplerSettings { effects: LightEffects::ALL, indirect, ..SamplerSettings::default() },
    )
}

fn view(sampler: &mut GpuSampler, camera: Camera, size: [u32; 2], detail: Detail) -> Frame {
    let plan = Plan::Direct { samples_per_pixel: 1, detail, light: None };
    direct(sampler, &ViewJob { plan, ..view_job(camera, size, 1) })
}

#[test]
fn less_detail_shows_the_same_with_more_error_and_its_plan_says_so() {
    let scene = Arc::new(terrain(3000));
    let (camera, size) = (scene.default_camera(), [97, 71]);
    let mut sampler = lit(&scene);
    let reference = image_of(&direct(&mut sampler, &view_job(camera, size, 16)));
    let mut flips = Vec::new();
    let full = view(&mut sampler, camera, size, Detail::Full);
    for detail in Detail::ALL {
        let frame = view(&mut sampler, camera, size, detail);
        assert_eq!(frame.provenance.plan, Plan::Direct { samples_per_pixel: 1, detail, light: None });
        assert_eq!([frame.width, frame.height], size);
        assert_eq!(
            frame.images[Output::Range],
            full.images[Output::Range],
            "{detail}: ranges have all pixels"
        );
        assert_eq!(
            view(&mut sampler, camera, size, detail).images[Output::Color],
            frame.images[Output::Color],
            "{detail}: it is repeatable"
        );
        flips.push(metrics::compare(&reference, &image_of(&frame)).unwrap().flip_mean);
    }
    let [whole, few, half, both, quarter] = flips[..] else { panic!("five details") };
    assert!(whole < few && whole < half && half < both.max(quarter) && both < quarter, "{flips:?}");
    assert!(quarter < 0.25, "{flips:?}");
    // Few rays of one view are no other view's.
    assert_eq!(
        view(&mut sampler, camera, size, Detail::Full).images[Output::Color],
        full.images[Output::Color]
    );
}

#[test]
fn the_smallest_views_and_the_widest_angles_have_less_detail_too() {
    let scene = Arc::new(terrain(3000));
    let wide = Camera { fov_deg: 178.0, ..Camera::look_at(DVec3::new(3.0, 60.0, 4.0), DVec3::ZERO) };
    let mut sampler = lit(&scene);
    for size in [[1, 1], [2, 5], [3, 1]] {
        for detail in Detail::ALL {
            for camera in [wide, scene.default_camera()] {
                let frame = view(&mut sampler, camera, size, detail);
                assert_eq!(
                    frame.images[Output::Color].clone().unwrap().len(),
                    (3 * size[0] * size[1]) as usize,
                    "{detail} {size:?}"
                );
            }
        }
    }
}

#[test]
fn less_detail_says_what_lit_it_and_another_sampler_repeats_it() {
    let scene = Arc::new(terrain(3000));
    let paths = PathSettings { level: 5, ..PathSettings::default() };
    let indirect = Indirect::Cells(CellSettings { paths, ..CellSettings::default() });
    let with_cells = || {
        let effects = LightEffects::ALL;
        sampler_with(&scene, SamplerSettings { effects, indirect, ..SamplerSettings::default() })
    };
    let (camera, size, mut sampler) = (scene.default_camera(), [96, 72], with_cells());
    for detail in [Detail::Half, Detail::HalfFewRays, Detail::Quarter] {
        let mut frame = view(&mut sampler, camera, size, detail);
        for _ in 0..8 {
            fill(&mut sampler);
            frame = view(&mut sampler, camera, size, detail);
        }
        let plan = frame.provenance.plan.clone();
        assert!(matches!(plan.light(), Some(SurfaceLight::Cells { .. })), "{detail}: {plan:?}");
        let pinned = ViewJob { plan, ..view_job(camera, size, 1) };
        let again = direct(&mut with_cells(), &pinned);
        assert_eq!(again.images[Output::Color], frame.images[Output::Color], "{detail}");
        let rays = Plan::Direct { samples_per_pixel: 1, detail, light: Some(SurfaceLight::Rays) };
        let rays = direct(&mut sampler, &ViewJob { plan: rays, ..view_job(camera, size, 1) });
        assert_eq!(rays.provenance.plan.light(), Some(SurfaceLight::Rays));
        assert!(rays.images[Output::Color] != frame.images[Output::Color], "{detail}: cells are other light");
    }
}
