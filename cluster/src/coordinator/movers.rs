//! The transforms that clients have set, and who set each node last.
//!
//! They live as long as a leadership: a coordinator that restarts shows the file's transforms again. Revisions begin at the time
//! of day, so those of the next coordinator are higher, and a pin to a frame of before is refused instead of showing something else.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::{SystemTime, UNIX_EPOCH};

use argus_scene::{Revisions, Transforms};

use crate::core::Client;

/// Who set a node last.
#[derive(Debug, Clone)]
pub(super) struct Setter {
    /// Revision since which its transform is there.
    pub(super) revision: u64,
    pub(super) client: Client,
}

/// The transforms that clients have set.
#[derive(Default)]
pub(super) struct Movers {
    present: Arc<Transforms>,
    kept: Revisions,
    setters: BTreeMap<u32, Setter>,
    /// The highest revision that was given.
    highest: u64,
}

impl Movers {
    /// The present state.
    pub(super) fn present(&self) -> &Arc<Transforms> {
        &self.present
    }

    /// The states that workers must know, oldest first. Revision 0 is not among them.
    pub(super) fn kept(&self) -> Vec<Arc<Transforms>> {
        self.kept.all()
    }

    /// Numbers of the states that can be shown, oldest first.
    pub(super) fn revisions(&self) -> Vec<u64> {
        [0].into_iter().chain(self.kept.all().iter().map(|kept| kept.revision)).collect()
    }

    /// Who set each node last, from a node on.
    pub(super) fn setters(&self, first: u32) -> impl Iterator<Item = (u32, &Setter)> {
        self.setters.range(first..).map(|(node, setter)| (*node, setter))
    }

    /// Sets the state that follows the present one: `nodes` are those that `client` sets.
    pub(super) fn set(
        &mut self,
        parent_from_node: BTreeMap<u32, glam::DAffine3>,
        nodes: impl IntoIterator<Item = u32>,
        client: &Client,
    ) -> Arc<Transforms> {
        let millis = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_millis() as u64);
        self.highest = match self.highest {
            0 => millis.max(1),
            before => before + 1,
        };
        let revision = self.highest;
        for node in nodes {
            self.setters.insert(node, Setter { revision, client: client.clone() });
        }
        self.present = Arc::new(Transforms { revision, parent_from_node });
        self.kept.add(self.present.clone());
        self.present.clone()
    }
}
