//! Records faces of samples beside light cells, and finds those that a move left unchanged.

use argus_scene::{FaceMask, SceneState};
use glam::Vec3;

use super::blocks::Blocks;
use super::faces::{FaceLights, SampleOf};
use super::trail::Trail;
use super::{LightCells, Parts, sharing};

impl LightCells {
    /// An empty trail for rays about an eye, metres from the centre of the leaves; `None` if nothing moves.
    pub(in crate::light) fn trail(&self, parts: Parts<'_>, from_eye: Vec3) -> Option<Trail> {
        let (mut state, scene) = (self.state(), self.scene(parts));
        state.relight(parts.inputs, || sharing::content_of(&scene));
        let blocks = scene.blocks.is_some().then(|| Blocks::new(&scene.lattice))?;
        Some(Trail::new(blocks, from_eye, state.poses))
    }

    /// Takes up a face of a sample that was rendered, with its whole trail.
    pub(in crate::light) fn add_face(&self, of: SampleOf, face: usize, trail: Trail, lights: FaceLights) {
        let mut state = self.state();
        // Another pose that was shown meanwhile may have changed what the trail names.
        if trail.poses() == state.poses {
            state.faces.add(of, face, trail, lights);
        }
    }

    /// The faces among `asked` of a sample that it has in an earlier state as it would have them if they were rendered now.
    pub(in crate::light) fn unchanged_faces(
        &self,
        parts: Parts<'_>,
        of: SampleOf,
        (earlier, asked): (SceneState, FaceMask),
        lights: FaceLights,
    ) -> FaceMask {
        let (mut state, scene) = (self.state(), self.scene(parts));
        state.relight(parts.inputs, || sharing::content_of(&scene));
        state.faces.unchanged(of, earlier, asked, lights)
    }

    /// Forgets which faces are as they would be now: they would be rendered otherwise.
    pub(in crate::light) fn forget_faces(&self) {
        self.state().faces.forget();
    }
}
