//! The page's WebSocket, tested without a browser.

use std::process::Stdio;
use std::time::{Duration, Instant};

use serde_json::Value;

use super::Page;
use super::socket::{Said, Socket};
use crate::support::{Coordinator, PATIENCE, Process, SMALL, argus, run, stderr};

/// Longer than an expected answer takes; the wait for an answer that must not come.
const MOMENT: Duration = Duration::from_secs(1);

#[test]
fn the_newest_camera_wins_and_at_most_two_images_are_unacknowledged() {
    let coordinator = Coordinator::start(SMALL, &[]);
    let _worker = coordinator.workers(1);
    coordinator.wait_for_workers(1);
    let page = Page::open(&coordinator.url, &[]);
    let mut socket = Socket::open(&page);
    // Programs are compiled before the test begins.
    socket.camera(1);
    assert_eq!(socket.image(), (1, (160, 120)));
    socket.shown(1);

    (2..=60).for_each(|number| socket.camera(number));
    let mut numbers = vec![];
    while numbers.last() != Some(&60) {
        let (number, _) = socket.image();
        assert!(numbers.last().is_none_or(|last| *last < number), "{number} after {numbers:?}");
        numbers.push(number);
        socket.shown(number);
    }
    assert!(numbers.len() < 30, "of 59 cameras at once hardly any is of use: {numbers:?}");

    for number in 61..=62 {
        socket.camera(number);
        assert_eq!(socket.image().0, number);
    }
    for number in 63..=80 {
        socket.camera(number);
        std::thread::sleep(Duration::from_millis(20));
    }
    assert_eq!(socket.next_within(MOMENT), Said::Nothing, "a third image is on its way");
    // An acknowledgement covers the images before it; the next image is of the newest camera.
    socket.shown(62);
    assert_eq!(socket.image().0, 80);
}

#[test]
fn an_image_states_its_plan_and_cost() {
    let coordinator = Coordinator::start(SMALL, &[]);
    let _worker = coordinator.workers(1);
    coordinator.wait_for_workers(1);
    let mut page = Page::open(&coordinator.url, &[]);
    let mut socket = Socket::open(&page);
    socket.camera(7);
    let Said::Image(about, _) = socket.next() else { panic!("no image") };
    assert_eq!((about["camera_seq"].as_u64(), about["way"].as_str()), (Some(7), Some("direct")), "{about}");
    for name in ["rendering_ms", "age_ms", "bridge_ms", "jpeg_ms"] {
        assert!(about[name].as_f64().is_some_and(|ms| ms > 0.0), "{name}: {about}");
    }
    assert!(about["stages"].as_array().is_some_and(|stages| !stages.is_empty()), "{about}");
    assert!(about["plan"].is_object(), "{about}");
    // An open page does not keep the process from stopping.
    let begin = Instant::now();
    assert!(page.process.stop().success());
    assert!(begin.elapsed() < Duration::from_secs(4), "it took {:?}", begin.elapsed());
    // On a busy machine the process may end before the page has read that it goes away.
    assert!(matches!(socket.next(), Said::Closed(1001 | 1006, _)));
}

#[test]
fn an_invalid_message_is_answered_by_its_field_and_the_connection_stays() {
    let coordinator = Coordinator::start(SMALL, &[]);
    let _worker = coordinator.workers(1);
    coordinator.wait_for_workers(1);
    let page = Page::open(&coordinator.url, &[]);
    let mut socket = Socket::open(&page);
    socket.camera(5);
    assert_eq!(socket.image().0, 5);
    socket.shown(5);
    for (text, field) in [
        ("", "message"),
        ("nonsense", "message"),
        ("[[[[[[[[[[", "message"),
        (r#"{"camera": 6, "zoom": 2}"#, "message"),
        (r#"{"eye": [0, 0, 0]}"#, "camera"),
        (r#"{"camera": 5}"#, "camera"),
        (r#"{"camera": 6, "eye": [0, 0]}"#, "eye"),
        (r#"{"camera": 6, "eye": [0, 0, 0], "target": [0, 0, 0]}"#, "target"),
        (r#"{"camera": 6, "fov_deg": 720}"#, "fov_deg"),
        (r#"{"camera": 6, "size": [0, 100]}"#, "width"),
        (r#"{"camera": 6, "size": [99999, 99999]}"#, ""),
        (r#"{"shown": -1}"#, "shown"),
    ] {
        socket.say(text);
        let Said::Text(answer) = socket.next() else { panic!("{text} is not answered by text") };
        let named = answer["refused"]["field"].as_str().unwrap();
        assert!(named.contains(field), "{text}: {answer}");
        assert!(!answer["refused"]["reason"].as_str().unwrap().is_empty(), "{text}: {answer}");
    }
    socket.say_bytes(&[0xff; 100]);
    assert!(matches!(socket.next(), Said::Text(_)));
    // An acknowledgement of an image that was not sent is harmless.
    socket.shown(u64::MAX);
    socket.camera(6);
    assert_eq!(socket.image().0, 6);

    socket.say(&" ".repeat(5000));
    let Said::Closed(code, reason) = socket.next() else { panic!("a message of 5000 bytes is taken") };
    assert!(code == 1009 && reason.contains("4096"), "{code} {reason}");
    let mut socket = Socket::open(&page);
    socket.camera(1);
    assert_eq!(socket.image().0, 1);
}

#[test]
fn only_the_own_page_opens_websockets_and_only_a_limited_number() {
    let coordinator = Coordinator::start(SMALL, &[]);
    let page = Page::open(&coordinator.url, &[]);
    for origin in ["http://example.org", "null", "http://127.0.0.1:1"] {
        assert_eq!(Socket::open_as(&page, Some(origin)).err(), Some(403), "{origin}");
    }
    assert_eq!(page.get("/session").0, 400, "not every request is one for a WebSocket");
    let own = format!("http://{}", page.address);
    let mut open: Vec<Socket> = (0..16).map(|_| Socket::open_as(&page, Some(&own)).unwrap()).collect();
    let Said::Closed(code, reason) = Socket::open(&page).next() else { panic!("there is room for a 17th") };
    assert!(code == 1013 && reason.contains("16 pages"), "{code} {reason}");
    open.pop();
    let deadline = Instant::now() + PATIENCE;
    while Socket::open(&page).next_within(MOMENT) != Said::Nothing {
        assert!(Instant::now() < deadline, "a page that is gone leaves no room");
    }
}

#[test]
fn after_a_restart_of_the_service_the_newest_camera_is_answered() {
    let mut coordinator = Coordinator::start(SMALL, &[]);
    let mut workers = coordinator.workers(1);
    coordinator.wait_for_workers(1);
    let page = Page::open(&coordinator.url, &[]);
    let mut socket = Socket::open(&page);
    socket.camera(1);
    assert_eq!(socket.image().0, 1);
    socket.shown(1);

    coordinator.process.kill();
    workers.iter_mut().for_each(Process::kill);
    socket.camera(2);
    let Said::Text(trouble) = socket.next() else { panic!("the page gets no message") };
    assert!(trouble["trouble"].as_str().is_some_and(|reason| !reason.is_empty()), "{trouble}");
    socket.camera(3);

    let address = coordinator.url.strip_prefix("http://").unwrap();
    let mut command = argus(&["coordinator", "--listen", address, "--scene", SMALL]);
    command.stdout(Stdio::null());
    let _again = Process::start(command);
    let _worker = coordinator.workers(1);
    let deadline = Instant::now() + PATIENCE;
    loop {
        match socket.next() {
            Said::Image(about, _) => break assert_eq!(about["camera_seq"], 3),
            Said::Text(_) => assert!(Instant::now() < deadline, "there is no image"),
            other => panic!("{other:?}"),
        }
    }
}

#[test]
#[cfg(target_os = "linux")]
fn a_page_that_never_reads_does_not_grow_memory() {
    let coordinator = Coordinator::start(SMALL, &[]);
    let _worker = coordinator.workers(1);
    coordinator.wait_for_workers(1);
    let page = Page::open(&coordinator.url, &[]);
    let resident_kib = || {
        let status = std::fs::read_to_string(format!("/proc/{}/status", page.process.pid())).unwrap();
        let line = status.lines().find(|line| line.starts_with("VmRSS:")).unwrap().to_owned();
        line.split_whitespace().nth(1).unwrap().parse::<u64>().unwrap()
    };
    let mut reads = Socket::open(&page);
    reads.camera(1);
    assert_eq!(reads.image().0, 1);
    reads.shown(1);
    let before = resident_kib();

    let mut never_reads = Socket::open(&page);
    let end = Instant::now() + Duration::from_secs(4);
    let mut said = 0;
    while Instant::now() < end {
        said += 1;
        let camera = format!(r#"{{"camera": {said}, "size": [640, 480], "direct": true}}"#);
        // Each of the second, invalid messages is answered, until there is no room for answers either.
        if !never_reads.try_say(&camera) || !never_reads.try_say(r#"{"camera": "one"}"#) {
            break;
        }
    }
    assert!(said > 1000, "{said} messages");
    let grown = resident_kib().saturating_sub(before);
    assert!(grown < 48 << 10, "it grew by {grown} KiB");
    // A page that reads is answered as before.
    reads.camera(2);
    assert_eq!(reads.image().0, 2);
}

#[test]
fn an_image_with_a_reach_comes_with_its_relief() {
    let coordinator = Coordinator::start(SMALL, &[]);
    let _worker = coordinator.workers(1);
    coordinator.wait_for_workers(1);
    let page = Page::open(&coordinator.url, &[]);
    let mut socket = Socket::open(&page);
    let ask = |socket: &mut Socket, number: u64, reach: f64| {
        socket
            .say(&format!(r#"{{"camera": {number}, "size": [320, 240], "direct": true, "reach": {reach}}}"#));
        let Said::Image(about, bytes) = socket.next() else { panic!("no image") };
        socket.shown(number);
        let jpeg = about["jpeg_bytes"].as_u64().unwrap() as usize;
        let image = image::load_from_memory(&bytes[..jpeg]).unwrap();
        assert_eq!((image.width(), image.height()), (320, 240));
        (about["relief"].clone(), bytes.len() - jpeg)
    };
    let (near, near_bytes) = ask(&mut socket, 1, 0.5);
    let (far, far_bytes) = ask(&mut socket, 2, 50.0);
    let figure =
        |relief: &Value, name: &str| relief[name].as_f64().unwrap_or_else(|| panic!("no {name}: {relief}"));
    // Half a pixel at a focal length of 240 / 2 / tan 22.5° pixels, after the reach.
    let focal = 120.0 / (45.0_f64 / 2.0).to_radians().tan();
    for (relief, reach) in [(&near, 0.5), (&far, 50.0)] {
        let pixels = figure(relief, "residual") * focal * reach;
        let widened = f64::from(1_u32 << (figure(relief, "smallest").log2() as u32));
        assert!(pixels > 0.0 && pixels <= 0.5001 * widened, "{pixels} pixels: {relief}");
        assert!(figure(relief, "median") > 0.0 && figure(relief, "jumps") > 0.0, "{relief}");
    }
    assert!(figure(&near, "leaves") < figure(&far, "leaves"), "{near} {far}");
    assert!(0 < near_bytes && near_bytes < far_bytes, "{near_bytes} {far_bytes}");
}

#[test]
fn viewers_who_are_seen_see_one_another_until_they_leave() {
    let coordinator = Coordinator::start(SMALL, &[]);
    let page = Page::open(&coordinator.url, &[]);
    let [mut one, mut two] = [(), ()].map(|()| Socket::open(&page));
    let told = |socket: &mut Socket| match socket.next() {
        Said::Text(text) => text["viewers"].as_array().unwrap_or_else(|| panic!("{text}")).clone(),
        other => panic!("{other:?}"),
    };
    let seen = |x: f64| format!(r#"{{"seen": {{"eye": [{x}, 1, 2], "target": [0, 0, 0], "fov_deg": 60}}}}"#);
    one.say(&seen(1.0));
    assert!(told(&mut one).is_empty());
    two.say(&seen(2.0));
    assert_eq!(told(&mut two)[0]["eye"][0], 1.0);
    let two_of_one = told(&mut one);
    assert_eq!((two_of_one.len(), &two_of_one[0]["eye"][0]), (1, &2.0.into()));
    one.say(&seen(3.0));
    assert_eq!(told(&mut two)[0]["eye"][0], 3.0);
    drop(two);
    // What one does itself is no news, so the next message is about the leaving.
    while !told(&mut one).is_empty() {}
    one.say(r#"{"seen": {"eye": [0, 0, 0], "target": [0, 0, 0], "fov_deg": 60}}"#);
    let Said::Text(refused) = one.next() else { panic!("a view without a direction is taken") };
    assert!(refused["refused"]["field"].as_str().unwrap().contains("target"), "{refused}");
}

#[test]
fn a_simulated_link_takes_its_time_and_wrong_ones_are_refused() {
    let coordinator = Coordinator::start(SMALL, &[]);
    let _worker = coordinator.workers(1);
    coordinator.wait_for_workers(1);
    let page = Page::open(&coordinator.url, &["--simulate-link", "400ms±20"]);
    let mut socket = Socket::open(&page);
    for number in 1..=3 {
        let begin = Instant::now();
        socket.camera(number);
        let Said::Image(about, _) = socket.next() else { panic!("no image") };
        let spent: f64 = ["bridge_ms", "jpeg_ms"].map(|name| about[name].as_f64().unwrap()).iter().sum();
        let way = begin.elapsed().as_secs_f64() * 1e3 - spent;
        assert!(way >= 380.0, "{way} ms on the way");
        socket.shown(number);
    }
    let refused = run(&["browse", "--simulate-link", "20ms±40"]);
    assert_eq!(refused.status.code(), Some(2));
    assert!(stderr(&refused).contains("jitter"), "{}", stderr(&refused));
}
