//! Where the viewers of a page's server are who want to be seen.

use std::collections::BTreeMap;

use argus_scene::{Camera, SceneHash};
use serde_json::{Value, json};
use tokio::sync::watch;

/// A viewer who wants to be seen: in which scene, and where.
pub(super) type Seen = (SceneHash, Camera);

/// The viewers who want to be seen, by a number of each. Whoever is seen sees the others of the same scene.
pub(super) struct Viewers(watch::Sender<BTreeMap<u64, Seen>>);

impl Default for Viewers {
    fn default() -> Self {
        Self(watch::Sender::new(BTreeMap::new()))
    }
}

impl Viewers {
    /// Another viewer, not seen yet.
    pub(super) fn enter(&self) -> u64 {
        use std::sync::atomic::{AtomicU64, Ordering};
        static NEXT: AtomicU64 = AtomicU64::new(1);
        NEXT.fetch_add(1, Ordering::Relaxed)
    }

    /// Sets where a viewer is; `None`: it is no longer seen.
    pub(super) fn is_at(&self, number: u64, place: Option<Seen>) {
        self.0.send_if_modified(|seen| match place {
            Some(place) => seen.insert(number, place) != Some(place),
            None => seen.remove(&number).is_some(),
        });
    }

    /// Follows where viewers are.
    pub(super) fn follow(&self) -> watch::Receiver<BTreeMap<u64, Seen>> {
        self.0.subscribe()
    }
}

/// All viewers of a scene but one, for its page.
pub(super) fn others(seen: &BTreeMap<u64, Seen>, number: u64, scene: SceneHash) -> Value {
    let others = seen.iter().filter(|(other, (of, _))| **other != number && *of == scene);
    others
        .map(|(other, (_, camera))| {
            json!({
                "name": format!("viewer {other}"),
                "eye": camera.eye,
                "target": camera.target,
                "fov_deg": camera.fov_deg,
            })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    #[test]
    fn viewers_see_the_others_until_they_leave() {
        let viewers = Viewers::default();
        let [one, two] = [(), ()].map(|()| viewers.enter());
        let mut follow = viewers.follow();
        let (scene, camera) = (SceneHash([1; 32]), Camera::look_at(DVec3::ONE, DVec3::ZERO));
        let place = Some((scene, camera));
        viewers.is_at(one, place);
        assert!(follow.has_changed().unwrap());
        assert_eq!(others(&follow.borrow_and_update(), one, scene), json!([]));
        assert_eq!(others(&follow.borrow(), two, scene)[0]["eye"], json!([1.0, 1.0, 1.0]));
        assert_eq!(others(&follow.borrow(), two, SceneHash([2; 32])), json!([]), "in another scene");
        // Standing still is no news, and neither is leaving twice.
        viewers.is_at(one, place);
        viewers.is_at(two, None);
        assert!(!follow.has_changed().unwrap());
        viewers.is_at(one, None);
        assert!(follow.has_changed().unwrap());
        assert_eq!(others(&follow.borrow_and_update(), two, scene), json!([]));
    }
}
