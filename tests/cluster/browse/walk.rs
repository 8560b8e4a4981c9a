//! Redraws of the page between images: how many there are, what they cost, and how near they are to what the service renders
//! at their cameras.

use std::time::{Duration, Instant};

use argus_scene::metrics;
use image::RgbImage;
use image::imageops::{FilterType, crop_imm};
use serde_json::Value;

use super::Page;
use super::chromium::{HAS_IMAGES, RESTS, chromium, takes_figures};
use super::devtools::{Browser, Tab, png};
use super::socket::{Said, Socket};
use crate::support::{Coordinator, SMALL, real_scene, say};

/// Simulated between the page and its bridge.
const LINK: &str = "40ms±20,20mbit";

const WALK: Duration = Duration::from_secs(5);

/// Keeps what the canvas shows twice a second, after the page's own drawing, and turns the viewer by `spin` radians a second.
const KEEP: &str = "globalThis.kept = []; globalThis.keeps = false; globalThis.spin = 0; (() => {
    let last = 0, before = performance.now();
    const frame = now => {
        if (spin) argus.turn(spin * (now - before) / 1000, 0);
        before = now;
        // A canvas that was not drawn in this frame is empty.
        if (keeps && now - last > 500 && argus.shown.redrawn.at(-1) === now) {
            last = now;
            const pose = argus.shown.pose;
            kept.push({ eye: [...pose.eye], target: argus.target(pose), fov: pose.fov, image: createImageBitmap(document.getElementById('view')) });
        }
        requestAnimationFrame(frame);
    };
    requestAnimationFrame(frame);
})()";

/// A kept image as the address of a PNG.
const PNG: &str = "(async kept => {
    const image = await kept.image, canvas = document.createElement('canvas');
    [canvas.width, canvas.height] = [image.width, image.height];
    canvas.getContext('2d').drawImage(image, 0, 0);
    return canvas.toDataURL('image/png');
})";

/// Redraws, images and kB, each a second.
#[derive(Debug, Clone, Copy)]
struct Rates {
    redraws: f64,
    images: f64,
    kilobytes: f64,
}

/// Walks by a key while turning, and measures.
fn walk(browser: &mut Browser, tab: &Tab, key: char, spin: f64) -> Rates {
    let counts = |browser: &mut Browser| {
        let counts = browser
            .value(tab, "[performance.now(), argus.shown.redraws, argus.shown.images, argus.link.total]");
        [0, 1, 2, 3].map(|i| counts[i].as_f64().unwrap())
    };
    let before = counts(browser);
    browser.value(tab, &format!("spin = {spin}"));
    browser.key(tab, key, true);
    std::thread::sleep(WALK);
    let after = counts(browser);
    browser.key(tab, key, false);
    browser.value(tab, "spin = 0");
    let rate = |i: usize| (after[i] - before[i]) / (after[0] - before[0]) * 1e3;
    Rates { redraws: rate(1), images: rate(2), kilobytes: rate(3) / 1e3 }
}

/// Opens the page, and waits for all light and a viewer at rest. Returns the seconds to the first image.
fn open(browser: &mut Browser, address: &str) -> (Tab, f64) {
    let begin = Instant::now();
    let tab = browser.open(address, "");
    browser.wait_until(&tab, HAS_IMAGES);
    let first = begin.elapsed().as_secs_f64();
    browser.wait_until(&tab, &format!("{RESTS} && argus.shown.about.light === 'full'"));
    browser.value(&tab, KEEP);
    (tab, first)
}

/// FLIP of each kept redraw against the view from the triangles at its camera, ascending.
fn judge(browser: &mut Browser, tab: &Tab, reference: &Page, size: &str) -> Vec<f64> {
    let count = browser.value(tab, "kept.length").as_u64().unwrap();
    let mut flips: Vec<f64> = (0..count)
        .map(|i| {
            let shown = browser.value(tab, &format!("{PNG}(kept[{i}])"));
            let shown = png(shown.as_str().unwrap());
            let query = format!(
                "(({{ eye, target, fov }}) => `eye=${{eye}}&target=${{target}}&fov_deg=${{fov}}`)(kept[{i}])"
            );
            let query = browser.value(tab, &query);
            let (status, _, image) =
                reference.get(&format!("/frame?{}&size={size}&direct", query.as_str().unwrap()));
            assert_eq!(status, 200, "{}", String::from_utf8_lossy(&image));
            let right = image::load_from_memory(&image).unwrap().to_rgb8();
            // A slow machine draws fewer pixels while the viewer moves; the browser enlarges them.
            let shown = image::imageops::resize(&shown, right.width(), right.height(), FilterType::Triangle);
            let flip = metrics::compare(&right, &shown).unwrap().flip_mean;
            if let Some(folder) = std::env::var_os("ARGUS_PICTURES").map(std::path::PathBuf::from) {
                shown.save(folder.join(format!("redraw-{i}.png"))).unwrap();
                right.save(folder.join(format!("reference-{i}.png"))).unwrap();
            }
            flip
        })
        .collect();
    flips.sort_by(f64::total_cmp);
    flips
}

fn quantile(sorted: &[f64], share: f64) -> f64 {
    sorted[((sorted.len() - 1) as f64 * share).round() as usize]
}

#[test]
fn a_walker_gets_redraws_between_images_that_are_near_the_truth() {
    if !chromium() {
        return;
    }
    let coordinator = Coordinator::start(SMALL, &[]);
    let _worker = coordinator.workers(1);
    coordinator.wait_for_workers(1);
    let page = Page::open(&coordinator.url, &["--simulate-link", LINK]);
    let reference = Page::open(&coordinator.url, &[]);
    let mut browser = Browser::start();
    let (tab, _) = open(&mut browser, &format!("http://{}/", page.address));

    // At rest, the redraw is the image: what differs is JPEG's.
    browser.value(&tab, "keeps = true; argus.turn(0.001, 0)");
    browser.wait_until(&tab, "kept.length > 1");
    browser.value(&tab, "keeps = false");
    browser.wait_until(&tab, RESTS);
    let still = browser.picture(&tab);
    browser.value(&tab, "kept = []; keeps = true");
    let rates = walk(&mut browser, &tab, 'w', 0.1);
    browser.value(&tab, "keeps = false");
    let flips = judge(&mut browser, &tab, &reference, "640x480");
    let (median, worst) = (quantile(&flips, 0.5), quantile(&flips, 0.95));
    say(&format!(
        "a walk in {SMALL}: {rates:?}, FLIP median {median:.3}, 95th percentile {worst:.3} of {}",
        flips.len()
    ));
    assert!(rates.redraws > rates.images, "{rates:?}");
    assert!(median <= 0.15 && worst <= 0.3, "{flips:?}");
    assert_eq!(still.dimensions(), (640, 480));

    // Turning on the spot within the border needs no image, and bares nothing: no redraw is black.
    browser.wait_until(&tab, RESTS);
    let images = browser.value(&tab, "argus.shown.images");
    browser.value(&tab, "argus.turn(0.01, 0)");
    browser.wait_until(&tab, "argus.shown.bound.bare === 0");
    let picture = browser.picture(&tab);
    assert!(picture.pixels().all(|pixel| pixel.0 != [0, 0, 0]), "a part of the view is bare");
    assert!(browser.value(&tab, "argus.shown.images").as_u64() <= images.as_u64().map(|images| images + 1));
}

#[test]
fn at_rest_a_redraw_is_the_image_itself() {
    if !chromium() {
        return;
    }
    let coordinator = Coordinator::start(SMALL, &[]);
    let _worker = coordinator.workers(1);
    coordinator.wait_for_workers(1);
    let page = Page::open(&coordinator.url, &[]);
    let mut browser = Browser::start();
    let (tab, _) = open(&mut browser, &format!("http://{}/?direct", page.address));
    let shown = browser.picture(&tab);
    let pose = browser.value(
        &tab,
        "(pose => `eye=${pose.eye}&target=${argus.target(pose)}&fov_deg=${pose.fov}`)(argus.shown.pose)",
    );
    let (status, _, image) = page.get(&format!("/frame?{}&size=640x480&direct", pose.as_str().unwrap()));
    assert_eq!(status, 200);
    let right = image::load_from_memory(&image).unwrap().to_rgb8();
    // Both are JPEG of the same pixels; their blocks lie elsewhere, because of the border. A pixel aside, they differ more.
    let inner = |image: &RgbImage, x: u32, y: u32| crop_imm(image, x, y, 632, 472).to_image();
    let flip = |x, y| metrics::compare(&inner(&right, x, y), &inner(&shown, 4, 4)).unwrap().flip_mean;
    let (here, aside) = (flip(4, 4), [flip(3, 4), flip(5, 4), flip(4, 3), flip(4, 5)]);
    assert!(here < 0.06 && aside.iter().all(|aside| *aside > 1.2 * here), "{here} {aside:?}");
}

/// The figures of the page on a link: `cargo test --release --test cluster redraws_of_sponza -- --nocapture`, with Chromium
/// and `ARGUS_SCENES`. Keeps its pictures in the folder `ARGUS_PICTURES`, if that is set.
#[test]
fn redraws_of_sponza_are_many_and_near_the_truth() {
    let Some(scene) = real_scene("sponza/sponza.glb").filter(|_| takes_figures()) else { return };
    let coordinator = Coordinator::start(scene.to_str().unwrap(), &[]);
    // One, since a browser that draws without a GPU takes a core.
    let _worker = coordinator.workers(1);
    coordinator.wait_for_workers(1);
    let page = Page::open(&coordinator.url, &["--simulate-link", LINK]);
    let reference = Page::open(&coordinator.url, &[]);
    let mut browser = Browser::start();
    let (tab, first) = open(&mut browser, &format!("http://{}/?size=1280x720", page.address));
    let with = walk(&mut browser, &tab, 'w', 0.0);
    browser.value(&tab, "keeps = true");
    walk(&mut browser, &tab, 's', 0.2);
    browser.value(&tab, "keeps = false");
    let flips = judge(&mut browser, &tab, &reference, "1280x720");
    let (tab, later) = open(&mut browser, &format!("http://{}/?size=1280x720&reproject=off", page.address));
    let without = walk(&mut browser, &tab, 'w', 0.0);
    say(&format!(
        "Sponza at 1280 × 720 over {LINK}: {first:.2} s to the first image of a service that has just begun, {later:.2} s \
         later on; with redraws {with:?}, without {without:?}; FLIP median {:.3}, 95th percentile {:.3} of {} redraws",
        quantile(&flips, 0.5),
        quantile(&flips, 0.95),
        flips.len()
    ));
    assert!(with.redraws > 2.0 * with.images, "{with:?}");
    assert!(with.kilobytes / with.redraws < without.kilobytes / without.redraws, "{with:?} {without:?}");
    assert!(quantile(&flips, 0.5) <= 0.15 && quantile(&flips, 0.95) <= 0.3, "{flips:?}");
}

/// One page that is drawn, and clients that speak its protocol, all walking.
#[test]
fn a_drawn_page_beside_fifteen_clients_leaves_each_its_frames() {
    let Some(scene) = real_scene("sponza/sponza.glb").filter(|_| takes_figures()) else { return };
    let coordinator = Coordinator::start(scene.to_str().unwrap(), &[]);
    // As many as `serve` starts on two cores.
    let _workers = coordinator.workers(2);
    coordinator.wait_for_workers(2);
    let page = Page::open(&coordinator.url, &["--simulate-link", LINK]);
    let mut browser = Browser::start();
    let (tab, _) = open(&mut browser, &format!("http://{}/?size=320x240", page.address));
    let camera: Value = serde_json::from_slice(&page.get("/scene").2).unwrap();
    let camera = camera["cameras"][0]["camera"].clone();
    let end = Instant::now() + 2 * WALK;
    let clients: Vec<_> = (0..15)
        .map(|i| {
            let (mut socket, camera) = (Socket::open(&page), camera.clone());
            std::thread::spawn(move || {
                let mut frames = 0_u64;
                let mut number = 0_u64;
                while Instant::now() < end {
                    number += 1;
                    let aside = 0.02 * number as f64 + 0.1 * f64::from(i);
                    let moved = |name: &str| {
                        let at = |axis: usize| camera[name][axis].as_f64().unwrap();
                        [at(0) + aside, at(1), at(2)]
                    };
                    let said = serde_json::json!({
                        "camera": number, "eye": moved("eye"), "target": moved("target"), "fov_deg": camera["fov_deg"],
                        "size": [320, 240], "deadline_ms": 80, "quality": 75,
                    });
                    socket.say(&said.to_string());
                    if let Said::Image(about, _) = socket.next() {
                        frames += 1;
                        socket.shown(about["camera_seq"].as_u64().unwrap());
                    }
                }
                frames as f64 / (2 * WALK).as_secs_f64()
            })
        })
        .collect();
    let drawn = walk(&mut browser, &tab, 'w', 0.0);
    let mut rates: Vec<f64> = clients.into_iter().map(|client| client.join().unwrap()).collect();
    rates.sort_by(f64::total_cmp);
    say(&format!(
        "beside a drawn page {drawn:?}, fifteen clients get {:.1} to {:.1} frames a second",
        rates[0], rates[14]
    ));
    // None starves; how many there are depends on the build and on how busy this machine is.
    assert!(rates[0] > 0.3 && drawn.redraws > drawn.images, "{rates:?} {drawn:?}");
}
