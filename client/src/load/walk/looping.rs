//! The walk `loop`: each viewer swings about one of the scene's viewpoints, as far as there is room.

use argus_proto::Description;
use argus_scene::Camera;
use futures::future::try_join_all;

use super::pose::Walk;
use super::surroundings::{Probe, Surroundings};
use crate::ClientError;
use crate::load::path::CameraPath;

/// Moments of a swing whose room is known.
const MOMENTS: usize = 96;
/// Moments over which the share of a swing changes at the fastest.
const SMOOTH: usize = 6;

/// Viewers who swing about the scene's viewpoints, in turn.
#[derive(Debug)]
pub(super) struct Looping {
    paths: Vec<CameraPath>,
    /// For each viewpoint, and each moment of a swing: the share of the path's displacement for which there is room.
    room: Vec<[f64; MOMENTS]>,
}

impl Looping {
    /// Asks what stands around each viewpoint.
    pub(super) async fn new(description: &Description, probe: &impl Probe) -> Result<Self, ClientError> {
        let paths: Vec<CameraPath> =
            (0..description.cameras.len() as u32).map(|index| CameraPath::new(description, index)).collect();
        let surroundings = try_join_all(paths.iter().map(|path| probe(path.viewpoint().eye))).await?;
        let room = paths.iter().zip(&surroundings).map(|(path, around)| room(path, around)).collect();
        Ok(Self { paths, room })
    }
}

impl Walk for Looping {
    fn camera(&self, viewer: u32, secs: f64) -> Camera {
        let viewpoint = viewer as usize % self.paths.len();
        let path = self.paths[viewpoint].of_client(viewer);
        let turn = path.turn(secs);
        let at = turn * MOMENTS as f64;
        let (moment, between) = (at.floor() as usize % MOMENTS, at.fract());
        let [a, b] = [moment, (moment + 1) % MOMENTS].map(|moment| self.room[viewpoint][moment]);
        path.at(turn, a + (b - a) * between)
    }
}

/// The share of a path's displacement at each moment of a swing that keeps it off surfaces.
fn room(path: &CameraPath, around: &Surroundings) -> [f64; MOMENTS] {
    let viewpoint = path.viewpoint();
    let margin = around.margin((viewpoint.target - viewpoint.eye).length());
    let shares: Vec<f64> = (0..MOMENTS)
        .map(|moment| {
            let displacement = path.at(moment as f64 / MOMENTS as f64, 1.0).eye - viewpoint.eye;
            let length = displacement.length();
            if length > 0.0 { (around.free(displacement / length, margin) / length).min(1.0) } else { 1.0 }
        })
        .collect();
    // The mean of least values nearby is at most the value itself, and has no steps.
    let nearby = |moment: usize| (0..=2 * SMOOTH).map(move |i| (moment + MOMENTS + i - SMOOTH) % MOMENTS);
    let least = |moment: usize| nearby(moment).map(|near| shares[near]).fold(1.0, f64::min);
    std::array::from_fn(|moment| nearby(moment).map(least).sum::<f64>() / (2 * SMOOTH + 1) as f64)
}
