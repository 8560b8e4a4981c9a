//! Views of scenes whose answer is known on paper.

mod common;

use argus_scene::{Camera, Search};
use common::*;
use glam::DVec3;

fn corners(size: [u32; 2]) -> Vec<argus_scene::SampleCamera> {
    [(-8.0, -8.0), (8.0, -8.0), (-8.0, 8.0), (8.0, 8.0)]
        .map(|(x, z)| perspective(DVec3::new(x, 9.0, z), DVec3::ZERO, 75.0, size[0], size[1]))
        .to_vec()
}

#[test]
fn both_searches_show_the_garden_as_it_is() {
    let garden = Analytic::garden();
    let mut compositor = compositor(&sample_set(&garden, &corners([400, 300]), false, 1));
    for search in [Search::Splat, Search::Linear] {
        let view = job(Camera::look_at(DVec3::new(-6.0, 7.0, -9.0), DVec3::ZERO), [200, 150], search, 4);
        let frame = compose_one(&mut compositor, &view).unwrap();
        let judged = judge(&garden, &view, &frame, 0.02);
        println!("{search:?} {judged:?} {:?}", frame.stages);
    }
}
