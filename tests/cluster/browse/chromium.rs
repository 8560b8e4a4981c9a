//! The page in Chromium (`apt-get install chromium` on Debian). With `ARGUS_REQUIRE_CHROMIUM=1`, a missing Chromium is a
//! failure.

use std::time::{Duration, Instant};

use serde_json::Value;

use super::Page;
use super::devtools::{Browser, Tab};
use crate::support::{Coordinator, SMALL, real_scene, say, there};

const WALK: Duration = Duration::from_secs(5);

/// Whether Chromium is installed.
fn chromium() -> bool {
    there("ARGUS_REQUIRE_CHROMIUM", "chromium", &["--version"])
}

const HAS_IMAGES: &str = "typeof shown !== 'undefined' && shown.images > 0";

/// Walks ahead; returns the number of images shown meanwhile.
fn walk(browser: &mut Browser, tab: &Tab) -> u64 {
    let images = |browser: &mut Browser| browser.value(tab, "shown.images").as_u64().unwrap();
    let before = images(browser);
    browser.key(tab, 'w', true);
    std::thread::sleep(WALK);
    let after = images(browser);
    browser.key(tab, 'w', false);
    after - before
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
    let start = numbers(&browser.value(&tab, "viewer.eye"));

    let images = walk(&mut browser, &tab);
    let told = browser
        .value(&tab, "`${shown.size} pixels, ${shown.age.toFixed(0)} ms old, ${at('rate').textContent}`");
    say(&format!("Chromium: {images} images in {WALK:?} of walking; at last {}", told.as_str().unwrap()));
    // A page once got two images in six seconds. The number depends on this machine's load.
    assert!(images >= 15, "{images} images in {WALK:?}");
    let end = numbers(&browser.value(&tab, "viewer.eye"));
    assert_ne!(start, end);

    // At rest: one image of full size, and no more.
    browser
        .wait_until(&tab, "asked.size === 0 && shown.size[0] === 640 && performance.now() - movedAt > 500");
    let still = browser.value(&tab, "shown.images");
    std::thread::sleep(Duration::from_secs(1));
    assert_eq!(browser.value(&tab, "shown.images"), still);
    assert_eq!(browser.value(&tab, "at('error').textContent"), "");
    assert!(browser.value(&tab, "at('way').textContent").as_str().unwrap().contains("triangles"));
    // The canvas shows more than one colour.
    let colours = "new Set(new Uint32Array(paint.getImageData(0, 0, 640, 480).data.buffer)).size";
    assert!(browser.value(&tab, colours).as_u64().unwrap() > 100);

    // The address holds the view: it opens at the same viewpoint.
    let shared = browser.value(&tab, "location.href");
    let tab = browser.open(shared.as_str().unwrap(), "");
    browser.wait_until(&tab, HAS_IMAGES);
    for (there, here) in numbers(&browser.value(&tab, "viewer.eye")).iter().zip(&end) {
        assert!((there - here).abs() < 0.5, "{shared}: {there} in place of {here}");
    }
    let tab = browser.open(&format!("{address}#eye=1,2"), "");
    browser.wait_until(&tab, HAS_IMAGES);
    assert!(browser.value(&tab, "at('error').textContent").as_str().unwrap().contains("eye"));
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
    assert_eq!(browser.value(&tab, "byRequests"), true);
    let images = walk(&mut browser, &tab);
    assert!(images >= 10, "{images} images in {WALK:?}");
}

/// The figures of the page, in a release build: `cargo test --release --test cluster the_page_walks_through_sponza -- --nocapture`,
/// with Chromium and `ARGUS_SCENES`.
#[test]
fn the_page_walks_through_sponza_by_default_without_a_pause() {
    let Some(scene) = real_scene("sponza/sponza.glb").filter(|_| chromium()) else { return };
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
    let [cold, warm] = [(), ()].map(|()| walk(&mut browser, &tab) as f64 / WALK.as_secs_f64());
    say(&format!(
        "Sponza in Chromium: {first_secs:.2} s to the first image, then {cold:.1} and {warm:.1} images a second"
    ));
    // How many there are depends on the build and on how busy this machine is; none was the failure.
    assert!(cold >= 1.0 && warm >= 1.0, "{cold} and {warm} images a second");
}
