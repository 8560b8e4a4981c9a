//! States of the transforms that clients have set, by number.

use std::collections::{BTreeMap, VecDeque};
use std::sync::{Arc, PoisonError, RwLock};

use glam::DAffine3;

/// Most revisions that a process keeps, so that views in work and pins can show them.
pub const MOST_REVISIONS: usize = 64;

/// Most transforms of all kept revisions together. The two newest revisions are always kept.
const MOST_KEPT: usize = 1 << 18;

/// The transforms that clients have set: one numbered state.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Transforms {
    /// Its number; higher is later. 0: no node has another transform than in the file.
    pub revision: u64,
    /// For each mover, by index into [`crate::Scene::nodes`], the transform from the node to its parent.
    pub parent_from_node: BTreeMap<u32, DAffine3>,
}

/// The newest states of a scene's transforms. Copies share them, so a scene and the scenes that are made of it know the same.
#[derive(Debug, Clone, Default)]
pub struct Revisions(Arc<RwLock<VecDeque<Arc<Transforms>>>>);

impl PartialEq for Revisions {
    /// Which states are known is no property of a scene.
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

impl Revisions {
    /// Adds a state, unless it is known. Old ones are forgotten beyond [`MOST_REVISIONS`].
    pub fn add(&self, transforms: Arc<Transforms>) {
        let mut kept = self.0.write().unwrap_or_else(PoisonError::into_inner);
        if kept.iter().any(|other| other.revision == transforms.revision) {
            return;
        }
        kept.push_back(transforms);
        let mut count: usize = kept.iter().map(|kept| kept.parent_from_node.len()).sum();
        while kept.len() > 2 && (kept.len() > MOST_REVISIONS || count > MOST_KEPT) {
            count -= kept.pop_front().map_or(0, |oldest| oldest.parent_from_node.len());
        }
    }

    /// Forgets all states, here and in all copies.
    pub fn clear(&self) {
        self.0.write().unwrap_or_else(PoisonError::into_inner).clear();
    }

    /// The state of a revision; `None` if it is not known, or no longer. Revision 0 is always known.
    pub fn get(&self, revision: u64) -> Option<Arc<Transforms>> {
        if revision == 0 {
            return Some(Arc::default());
        }
        let kept = self.0.read().unwrap_or_else(PoisonError::into_inner);
        kept.iter().find(|kept| kept.revision == revision).cloned()
    }

    /// The known states, oldest first, without revision 0.
    pub fn all(&self) -> Vec<Arc<Transforms>> {
        self.0.read().unwrap_or_else(PoisonError::into_inner).iter().cloned().collect()
    }
}
