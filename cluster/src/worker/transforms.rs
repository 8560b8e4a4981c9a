//! The states of the nodes' transforms that the coordinator told this worker.
//!
//! They come by the stream of assignments, and orders name them by revision. An order may overtake the message, so it waits for it.

use std::sync::Arc;
use std::time::Duration;

use argus_proto::Fault;
use argus_scene::{Revisions, Scene, Transforms};
use tokio::sync::watch;

/// Longest wait of an order for the transforms that it names.
const LONGEST_WAIT: Duration = Duration::from_secs(5);

/// The known states.
#[derive(Default)]
pub(super) struct KnownTransforms {
    states: Revisions,
    /// The newest revision; changes with every message.
    newest: watch::Sender<u64>,
}

impl KnownTransforms {
    /// Takes a state, also for the scene if it is loaded.
    pub(super) fn learn(&self, transforms: Arc<Transforms>, scene: Option<&Scene>) {
        let revision = transforms.revision;
        if let Some(scene) = scene {
            scene.revisions.add(transforms.clone());
        }
        self.states.add(transforms);
        self.newest.send_replace(revision);
    }

    /// Forgets all states. Scenes that were told keep theirs.
    pub(super) fn forget(&self) {
        self.states.clear();
    }

    /// Tells a scene all known states.
    pub(super) fn tell(&self, scene: &Scene) {
        self.states.all().into_iter().for_each(|state| scene.revisions.add(state));
    }

    /// Waits until a state is known.
    ///
    /// # Errors
    /// [`Fault::Unavailable`] if it does not come in time: another worker may know it.
    pub(super) async fn known(&self, revision: u64) -> Result<(), Fault> {
        let mut newest = self.newest.subscribe();
        let is_known = newest.wait_for(|_| self.states.get(revision).is_some());
        match tokio::time::timeout(LONGEST_WAIT, is_known).await {
            Ok(Ok(_)) => Ok(()),
            _ => Err(Fault::Unavailable(format!(
                "transforms of revision {revision} are not known to this worker; the newest are {}",
                *self.newest.borrow()
            ))),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test(start_paused = true)]
    async fn an_order_waits_for_its_transforms_and_not_for_ever() {
        let known = Arc::new(KnownTransforms::default());
        known.known(0).await.unwrap();
        let waiting = tokio::spawn({
            let known = known.clone();
            async move { known.known(7).await }
        });
        tokio::time::sleep(Duration::from_millis(10)).await;
        assert!(!waiting.is_finished());
        known.learn(Arc::new(Transforms { revision: 7, ..Transforms::default() }), None);
        waiting.await.unwrap().unwrap();
        let late = known.known(8).await.unwrap_err().to_string();
        assert!(late.contains("revision 8") && late.contains("newest are 7"), "{late}");
    }
}
