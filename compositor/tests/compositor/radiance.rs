//! Radiance of views from samples.

use argus_scene::tone::display_from_radiance;
use argus_scene::{Camera, Cancel, Compositor as _, Output, Outputs, Plan, Search, ViewJob};
use glam::{DVec3, Vec3};

use crate::common::*;
use crate::views::corners;

#[test]
fn radiance_is_what_colour_shows_and_changes_no_other_image() {
    let garden = Analytic::garden();
    for glossy in [false, true] {
        let set = sample_set(&garden, &corners(DVec3::ZERO, [100, 75]), glossy, 1);
        let mut compositor = compositor(&set);
        let exposure = set.info.lighting.exposure;
        for (search, supersampling) in Search::ALL.into_iter().flat_map(|search| [(search, 1), (search, 3)]) {
            let camera = Camera::look_at(DVec3::new(-6.0, 7.0, -9.0), DVec3::ZERO);
            let mut plain = job(&set, camera, [50, 40], search);
            if let Plan::Warp(warp) = &mut plain.plan {
                warp.supersampling = supersampling;
            }
            let with = ViewJob { outputs: plain.outputs.with(Output::Radiance), ..plain.clone() };
            let only = ViewJob { outputs: Outputs::only(Output::Radiance), ..plain.clone() };
            // In one batch, in an order in which no view is beside its radiance.
            let views = [with, plain, only];
            let frames = compositor.compose(&views, &Cancel::new());
            let [with, plain, only] = &frames.into_iter().map(Result::unwrap).collect::<Vec<_>>()[..] else {
                panic!("three frames")
            };
            let what = format!("{search:?} ×{supersampling}, glossy: {glossy}");
            let same = with.images.iter().filter(|(output, _)| *output != Output::Radiance);
            assert!(same.eq(plain.images.iter()), "{what}");
            assert_eq!(only.images.iter().count(), 1, "{what}");
            assert_eq!(only.images[Output::Radiance], with.images[Output::Radiance], "{what}");
            assert_eq!(with.served, plain.served);
            let radiance = with.images[Output::Radiance].as_ref().unwrap().as_chunks::<12>().0;
            let colors = with.images[Output::Color].as_ref().unwrap().as_chunks::<3>().0;
            assert_eq!((radiance.len(), colors.len()), (2000, 2000));
            let far = radiance.iter().zip(colors).filter(|(radiance, color)| {
                let number = |i: usize| f32::from_le_bytes(radiance[4 * i..4 * i + 4].try_into().unwrap());
                let shown = display_from_radiance(Vec3::new(number(0), number(1), number(2)), exposure);
                // The samples' display plane has 8 bits, and its texels are filtered.
                shown.iter().zip(*color).any(|(a, b)| a.abs_diff(*b) > 4)
            });
            let far = far.count();
            assert!(far <= 2000 / 50, "{what}: {far} pixels");
        }
    }
}
