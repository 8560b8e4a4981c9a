//! Views of small things in wide scenes.
#![allow(clippy::unwrap_used)] // a test ends at the first thing that goes wrong

use std::sync::Arc;

use argus_scene::{Bounds, Camera, Output, SampleCamera, SampleSet, Search};
use glam::DVec3;

use crate::common::*;

/// A ball of 1 m on a ground of 1 km.
fn ball() -> Analytic {
    let spheres = vec![(DVec3::new(0.0, 1.0, 0.0), 1.0)];
    Analytic { spheres, ground: 500.0, ..Analytic::garden() }
}

/// Samples of the ball whose set has the extent of what is around it.
fn samples(subject: &Analytic, cameras: &[SampleCamera]) -> SampleSet {
    let mut set = sample_set(subject, cameras, false, 1);
    Arc::make_mut(&mut set.info).extent =
        Bounds { min: DVec3::new(-4.0, 0.0, -4.0), max: DVec3::new(4.0, 2.0, 4.0) };
    set
}

fn viewer() -> Camera {
    Camera::look_at(DVec3::new(5.0, 3.5, 5.0), DVec3::new(0.0, 0.8, 0.0))
}

#[test]
fn what_samples_saw_only_from_afar_is_unresolved() {
    let ball = ball();
    // The ball is as large as a texel of each.
    let far = [DVec3::new(62.0, 30.0, 10.0), DVec3::new(-20.0, 45.0, 62.0)];
    let set = samples(&ball, &far.map(|center| cube(center, 64)));
    let mut compositor = compositor(&set);
    for search in Search::ALL {
        let view = job(&set, viewer(), [160, 120], search);
        let frame = compose_one(&mut compositor, &view).unwrap();
        let judged = judge(&ball, &view, &frame, 0.1);
        println!("{search:?} {judged:?}");
        assert!(judged.unresolved > 0.8, "{search:?} {judged:?}");
        // The middle of the view, where the ball is.
        let mask = frame.images[Output::Mask].clone().unwrap();
        assert!(
            (40..80).all(|y| mask[y * 160 + 50..y * 160 + 110].iter().all(|&mask| mask == 255)),
            "{search:?}"
        );
    }
}

#[test]
fn what_samples_saw_from_near_is_resolved_in_a_scene_of_any_width() {
    let ball = ball();
    let near = [DVec3::new(4.0, 3.0, 4.5), DVec3::new(5.5, 3.0, 5.0)];
    let set = samples(&ball, &near.map(|center| cube(center, 256)));
    let mut compositor = compositor(&set);
    for search in Search::ALL {
        let view = job(&set, viewer(), [160, 120], search);
        let judged = judge(&ball, &view, &compose_one(&mut compositor, &view).unwrap(), 0.1);
        println!("{search:?} {judged:?}");
        // Near the horizon a texel holds tens of metres of ground.
        assert!(judged.unresolved < 0.03 && judged.bad_range < 0.05, "{search:?} {judged:?}");
    }
}

#[test]
fn a_ball_before_the_sky_is_not_taken_for_the_sky() {
    // High above the ground, so that rays cross the bounds for hundreds of metres before and behind it.
    let floating = Analytic { spheres: vec![(DVec3::new(0.0, 300.0, 0.0), 1.0)], ..ball() };
    let eye = DVec3::new(5.0, 301.0, 5.0);
    let at = DVec3::new(0.0, 300.0, 0.0);
    let mut set = sample_set(&floating, &[cube(DVec3::new(5.2, 301.1, 4.9), 128)], false, 1);
    Arc::make_mut(&mut set.info).extent = Bounds { min: at - 4.0, max: at + 4.0 };
    let mut compositor = compositor(&set);
    for search in Search::ALL {
        let view = job(&set, Camera::look_at(eye, at), [160, 120], search);
        let judged = judge(&floating, &view, &compose_one(&mut compositor, &view).unwrap(), 0.01);
        println!("{search:?} {judged:?}");
        assert!(judged.bad_range < 0.02 && judged.unresolved < 0.05, "{search:?} {judged:?}");
    }
}
