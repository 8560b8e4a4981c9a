use glam::DVec3;

use super::*;

#[test]
fn timed_views_are_spread_over_the_walk() {
    let job = |i: u32| ViewJob::new(Camera::look_at(DVec3::ZERO, DVec3::X), [i, 1], Plan::direct(1));
    let taken =
        |count| -> Vec<u32> { every((0..12).map(job).collect(), count).iter().map(|j| j.width).collect() };
    assert_eq!(taken(3), [3, 7, 11]);
    assert_eq!(taken(12).len(), 12);
    assert_eq!(taken(99).len(), 12);
    assert!(every(Vec::new(), 3).is_empty());
}
