//! The page in Chromium (`apt-get install chromium` on Debian). With `ARGUS_REQUIRE_CHROMIUM=1`, a missing Chromium is a
//! failure.

use std::time::{Duration, Instant};

use serde_json::Value;

use super::Page;
use super::devtools::{Browser, Tab};
use crate::support::{Coordinator, SMALL, real_scene, say, there};

const ERROR: &str = "document.getElementById('error').textContent";

const WALK: Duration = Duration::from_secs(5);
/// A busy machine may take so long to answer a walker.
const LONG_WALK: Duration = Duration::from_secs(60);

/// Whether Chromium is installed.
pub(super) fn chromium() -> bool {
    there("ARGUS_REQUIRE_CHROMIUM", "chromium", &["--version"])
}

/// Whether the page's figures can be taken here: Chromium is installed, and this is a release build. In another one, images come too
/// late for a walker.
pub(super) fn takes_figures() -> bool {
    if cfg!(debug_assertions) {
        say(
            "SKIPPED: figures of the page are those of a release build: cargo test --release --test cluster browse",
        );
        return false;
    }
    chromium()
}

pub(super) const HAS_IMAGES: &str = "globalThis.argus?.shown.images > 0";

/// Nothing is asked for, and the viewer rests.
pub(super) const RESTS: &str = "argus.link.asked.size === 0 && argus.restedFor(performance.now()) > 1500";

/// Walks ahead for some seconds, and until so many images and redraws were shown. Returns their numbers.
fn walk(browser: &mut Browser, tab: &Tab, wanted: [u64; 2]) -> [u64; 2] {
    let counts = |browser: &mut Browser| {
        let counts = browser.value(tab, "[argus.shown.images, argus.shown.redraws]");
        [0, 1].map(|i| counts[i].as_u64().unwrap())
    };
    let (begin, before) = (Instant::now(), counts(browser));
    browser.key(tab, 'w', true);
    let counted = loop {
        std::thread::sleep(WALK / 10);
        let after = counts(browser);
        let counted = [0, 1].map(|i| after[i] - before[i]);
        let (took, has_all) = (begin.elapsed(), counted[0] >= wanted[0] && counted[1] >= wanted[1]);
        if took >= WALK && has_all || took >= LONG_WALK {
            break counted;
        }
    };
    browser.key(tab, 'w', false);
    counted
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|number| number.as_f64().unwrap()).collect()
}

#[test]
fn a_viewer_walks_through_the_scene_in_chromium() {
    if !chromium() {
        return;
    }
    let coordinator = Coordinator::start(SMALL, &[]);
    let _worker = coordinator.workers(1);
    coordinator.wait_for_workers(1);
    let page = Page::open(&coordinator.url, &["--direct"]);
    let mut browser = Browser::start();
    let address = format!("http://{}/", page.address);
    let tab = browser.open(&address, "");
    browser.wait_until(&tab, HAS_IMAGES);
    let start = numbers(&browser.value(&tab, "argus.viewer.eye"));

    let wanted = [3, 15];
    let [images, redraws] = walk(&mut browser, &tab, wanted);
    let told =
        browser.value(&tab, "`${argus.shown.size} pixels, ${document.getElementById('rate').textContent}`");
    say(&format!(
        "Chromium: {images} images and {redraws} redraws of walking; at last {}",
        told.as_str().unwrap()
    ));
    // How many there are a second depends on this machine's load.
    assert!(images >= wanted[0] && redraws >= wanted[1], "{images} images and {redraws} redraws");
    let end = numbers(&browser.value(&tab, "argus.viewer.eye"));
    assert_ne!(start, end);

    // At rest: one image of full size, and no more.
    browser.wait_until(&tab, &format!("{RESTS} && argus.shown.size[0] >= 640"));
    let still = browser.value(&tab, "argus.shown.images");
    std::thread::sleep(Duration::from_secs(1));
    assert_eq!(browser.value(&tab, "argus.shown.images"), still);
    assert_eq!(browser.value(&tab, ERROR), "");
    assert!(
        browser
            .value(&tab, "document.getElementById('way').textContent")
            .as_str()
            .unwrap()
            .contains("triangles")
    );
    // The canvas shows more than one colour.
    let picture = browser.picture(&tab);
    assert_eq!(picture.dimensions(), (640, 480));
    let colours: std::collections::BTreeSet<_> = picture.pixels().map(|pixel| pixel.0).collect();
    assert!(colours.len() > 100, "{}", colours.len());

    // The address holds the view: it opens at the same viewpoint.
    let shared = browser.value(&tab, "location.href");
    let tab = browser.open(shared.as_str().unwrap(), "");
    browser.wait_until(&tab, HAS_IMAGES);
    for (there, here) in numbers(&browser.value(&tab, "argus.viewer.eye")).iter().zip(&end) {
        assert!((there - here).abs() < 0.5, "{shared}: {there} in place of {here}");
    }
    let tab = browser.open(&format!("{address}#eye=1,2"), "");
    browser.wait_until(&tab, HAS_IMAGES);
    assert!(browser.value(&tab, ERROR).as_str().unwrap().contains("eye"));
}

#[test]
fn a_page_without_websockets_requests_one_image_after_another() {
    if !chromium() {
        return;
    }
    let coordinator = Coordinator::start(SMALL, &[]);
    let _worker = coordinator.workers(1);
    coordinator.wait_for_workers(1);
    let page = Page::open(&coordinator.url, &["--direct"]);
    let mut browser = Browser::start();
    // Like a proxy without support for WebSockets.
    let none = "WebSocket = class extends WebSocket { constructor() { super('ws://127.0.0.1:1'); } }";
    let tab = browser.open(&format!("http://{}/", page.address), none);
    browser.wait_until(&tab, HAS_IMAGES);
    assert_eq!(browser.value(&tab, "argus.link.byRequests"), true);
    let [images, redraws] = walk(&mut browser, &tab, [3, 3]);
    // Without their relief, images are redrawn only as if they were infinitely far.
    assert!(images >= 3 && redraws >= 3, "{images} images and {redraws} redraws");
}

/// The figures of the page, in a release build: `cargo test --release --test cluster the_page_walks_through_sponza -- --nocapture`,
/// with Chromium and `ARGUS_SCENES`.
#[test]
fn the_page_walks_through_sponza_by_default_without_a_pause() {
    let Some(scene) = real_scene("sponza/sponza.glb").filter(|_| takes_figures()) else { return };
    let coordinator = Coordinator::start(scene.to_str().unwrap(), &[]);
    let _workers = coordinator.workers(2);
    coordinator.wait_for_workers(2);
    let page = Page::open(&coordinator.url, &[]);
    let mut browser = Browser::start();
    let began = Instant::now();
    let tab = browser.open(&format!("http://{}/", page.address), "");
    browser.wait_until(&tab, HAS_IMAGES);
    let first_secs = began.elapsed().as_secs_f64();
    // The second walk is that of a service whose programs and samples are there.
    let [cold, warm] = [(), ()].map(|()| walk(&mut browser, &tab, [0, 0])[0] as f64 / WALK.as_secs_f64());
    say(&format!(
        "Sponza in Chromium: {first_secs:.2} s to the first image, then {cold:.1} and {warm:.1} images a second"
    ));
    // How many there are depends on the build and on how busy this machine is; none was the failure.
    assert!(cold >= 0.5 && warm >= 0.5, "{cold} and {warm} images a second");
}
