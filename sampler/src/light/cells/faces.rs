//! Faces of samples, and whether they are still what rendering them anew would give.
//!
//! A face depends on what its rays of sight and of light met, on light cells, and on lights. The first is kept as a [`Trail`], so
//! that a face whose trail no mover meets, and whose cells are kept, need not be rendered again in the next pose.

use std::collections::HashMap;
use std::sync::Arc;

use argus_scene::emitters::Emitter;
use argus_scene::{FaceMask, Lighting, SampleCamera, SceneState};

use super::super::lattice::PageKey;
use super::changes::Changes;
use super::record::Record;
use super::store::Store;
use super::trail::Trail;

/// Most faces that are known: about 40 MB.
const MOST_FACES: usize = 1 << 12;
/// Most states of which it is known that they show a face alike.
const MOST_STATES: usize = 8;

/// A sample of a state of the scene.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SampleOf {
    /// The camera, and its number in the rig.
    pub(crate) camera: SampleCamera,
    pub(crate) number: u64,
    pub(crate) shows: SceneState,
}

/// Lights and emitters that a face was lit by.
#[derive(Debug, PartialEq)]
pub(in crate::light) struct FaceLights {
    pub(in crate::light) lighting: Lighting,
    pub(in crate::light) emitters: Vec<Emitter>,
}

/// What is known of a face that was rendered.
struct KnownFace {
    camera: SampleCamera,
    lights: Arc<FaceLights>,
    record: Record,
    /// The pages of light cells that it looked up, by their number.
    pages: HashMap<PageKey, u64>,
    /// The states that show it as it is in the present pose, the latest last.
    states: Vec<SceneState>,
}

/// The faces that are as they would be if they were rendered in the present pose.
#[derive(Default)]
pub(super) struct KnownFaces {
    /// By number of the camera, and of its face.
    faces: HashMap<(u64, usize), KnownFace>,
    lights: Option<Arc<FaceLights>>,
    /// Faces that were taken over from an earlier version, and those that could not be.
    pub(super) kept: u64,
    pub(super) changed: u64,
}

impl KnownFaces {
    /// Forgets all faces, but not the counts.
    pub(super) fn forget(&mut self) {
        self.faces.clear();
        self.lights = None;
    }

    /// Takes up a face that was rendered, with its whole trail.
    pub(super) fn add(&mut self, of: SampleOf, face: usize, trail: Trail, lights: FaceLights) {
        if self.faces.len() >= MOST_FACES {
            self.faces.clear();
        }
        let (record, pages) = trail.into_parts();
        let lights = self.shared(lights);
        let known = KnownFace { camera: of.camera, lights, record, pages, states: vec![of.shows] };
        self.faces.insert((of.number, face), known);
    }

    /// Keeps the faces that changes leave as they are. The store has kept its pages already.
    pub(super) fn keep_untouched(&mut self, changes: &Changes, store: &Store) {
        self.faces.retain(|_, face| {
            face.pages.iter().all(|(key, number)| store.number_of(*key) == Some(*number))
                && changes.leave(&mut face.record)
        });
    }

    /// The faces among `asked` of a sample that it has in an earlier state as it would have them if they were rendered now.
    pub(super) fn unchanged(
        &mut self,
        of: SampleOf,
        earlier: SceneState,
        asked: FaceMask,
        lights: FaceLights,
    ) -> FaceMask {
        let lights = self.shared(lights);
        let mut unchanged = FaceMask::NONE;
        for face in (0..of.camera.faces().len()).filter(|face| asked.has(*face)) {
            let is_alike = |known: &&mut KnownFace| {
                known.camera == of.camera && known.lights == lights && known.states.contains(&earlier)
            };
            let Some(known) = self.faces.get_mut(&(of.number, face)).filter(is_alike) else {
                self.changed += 1;
                continue;
            };
            if !known.states.contains(&of.shows) {
                known.states.push(of.shows);
                let excess = known.states.len().saturating_sub(MOST_STATES);
                known.states.drain(..excess);
            }
            self.kept += 1;
            unchanged = unchanged.union(FaceMask::only(face));
        }
        unchanged.of_camera(&of.camera)
    }

    /// Lights that faces share.
    fn shared(&mut self, lights: FaceLights) -> Arc<FaceLights> {
        match &self.lights {
            Some(known) if **known == lights => known.clone(),
            _ => self.lights.insert(Arc::new(lights)).clone(),
        }
    }
}
