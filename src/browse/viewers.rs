//! Where the viewers of a page's server are who want to be seen.

use std::collections::BTreeMap;

use argus_scene::Camera;
use serde_json::{Value, json};
use tokio::sync::watch;

/// The viewers who want to be seen, by a number of each. Whoever is seen sees the others.
pub(super) struct Viewers(watch::Sender<BTreeMap<u64, Camera>>);

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
    pub(super) fn is_at(&self, number: u64, camera: Option<Camera>) {
        self.0.send_if_modified(|seen| match camera {
            Some(camera) => seen.insert(number, camera) != Some(camera),
            None => seen.remove(&number).is_some(),
        });
    }

    /// Follows where viewers are.
    pub(super) fn follow(&self) -> watch::Receiver<BTreeMap<u64, Camera>> {
        self.0.subscribe()
    }
}

/// All viewers but one, for its page.
pub(super) fn others(seen: &BTreeMap<u64, Camera>, number: u64) -> Value {
    let others = seen.iter().filter(|(other, _)| **other != number);
    others
        .map(|(other, camera)| {
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
        let camera = Camera::look_at(DVec3::ONE, DVec3::ZERO);
        viewers.is_at(one, Some(camera));
        assert!(follow.has_changed().unwrap());
        assert_eq!(others(&follow.borrow_and_update(), one), json!([]));
        assert_eq!(others(&follow.borrow(), two)[0]["eye"], json!([1.0, 1.0, 1.0]));
        // Standing still is no news, and neither is leaving twice.
        viewers.is_at(one, Some(camera));
        viewers.is_at(two, None);
        assert!(!follow.has_changed().unwrap());
        viewers.is_at(one, None);
        assert!(follow.has_changed().unwrap());
        assert_eq!(others(&follow.borrow_and_update(), two), json!([]));
    }
}
