//! A scene in a web browser: `argus browse` over plain HTTP, over a WebSocket, and in Chromium.

mod bridge;
mod chromium;
mod devtools;
mod hosted;
mod socket;
mod walk;

use std::io::{Read, Write};
use std::net::TcpStream;
use std::process::Stdio;
use std::time::Instant;

use crate::support::{Coordinator, PATIENCE, Process, SMALL, argus, run, stderr};
use argus_scene::metrics;
use serde_json::Value;

/// A running `argus browse`, and the address of its page.
struct Page {
    address: String,
    process: Process,
}

/// Status, head and body of a response.
type Answer = (u16, String, Vec<u8>);

impl Page {
    fn open(server: &str, more: &[&str]) -> Self {
        let mut command = argus(&["browse", "--server", server, "--listen", "127.0.0.1:0", "--json"]);
        command.args(more).stdout(Stdio::piped());
        let mut process = Process::start(command);
        let mut objects = serde_json::Deserializer::from_reader(process.take_stdout()).into_iter::<Value>();
        let announced = objects.next().unwrap().unwrap();
        let address = announced["url"].as_str().unwrap().strip_prefix("http://").unwrap().to_owned();
        Self { address, process }
    }

    fn get(&self, path: &str) -> Answer {
        self.get_as(path, &self.address)
    }

    /// A request for `path` with the host name `host`.
    fn get_as(&self, path: &str, host: &str) -> Answer {
        get_from(&self.address, path, host)
    }
}

/// The answer of an address to a request for `path` with the host name `host`.
fn get_from(address: &str, path: &str, host: &str) -> Answer {
    let mut stream = TcpStream::connect(address).unwrap();
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    write!(stream, "GET {path} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n").unwrap();
    let mut answer = Vec::new();
    stream.read_to_end(&mut answer).unwrap();
    let end = answer.windows(4).position(|bytes| bytes == b"\r\n\r\n").unwrap();
    let head = String::from_utf8(answer[..end].to_vec()).unwrap();
    assert!(!head.contains("chunked"), "answers are whole: {head}");
    let status = head.split(' ').nth(1).unwrap().parse().unwrap();
    (status, head, answer[end + 4..].to_vec())
}

fn field(head: &str, name: &str) -> String {
    let line = head.lines().find(|line| line.to_ascii_lowercase().starts_with(name));
    line.unwrap_or_else(|| panic!("no {name} in {head}")).split_once(": ").unwrap().1.to_owned()
}

#[test]
fn a_browser_walks_through_a_scene() {
    let coordinator = Coordinator::start(SMALL, &[]);
    let _worker = coordinator.workers(1);
    coordinator.wait_for_workers(1);
    let mut page = Page::open(&coordinator.url, &[]);
    for (path, kind) in [("/", "text/html"), ("/main.js", "text/javascript"), ("/page.css", "text/css")] {
        let (status, head, text) = page.get(path);
        assert_eq!((status, field(&head, "content-type").starts_with(kind)), (200, true), "{head}");
        // The page loads everything from its own server.
        assert!(!String::from_utf8(text).unwrap().contains("://"));
    }

    let (status, _, about) = page.get("/scene");
    let about: Value = serde_json::from_slice(&about).unwrap();
    assert_eq!((status, about["name"].as_str()), (200, Some(SMALL)), "{about}");
    let camera = &about["cameras"][0]["camera"];
    let place = |name: &str| {
        let parts: Vec<String> = camera[name].as_array().unwrap().iter().map(Value::to_string).collect();
        format!("{name}={}", parts.join(","))
    };
    let asked =
        format!("/frame?{}&{}&fov_deg={}&size=160x120", place("eye"), place("target"), camera["fov_deg"]);
    let [from_samples, direct] = [asked.clone(), format!("{asked}&direct")].map(|path| {
        let (status, head, image) = page.get(&path);
        assert_eq!((status, field(&head, "content-type").as_str()), (200, "image/jpeg"), "{head}");
        let made: Value = serde_json::from_str(&field(&head, "argus-frame")).unwrap();
        assert!(!path.ends_with("direct") || made["search"] == "direct", "{made}");
        assert!(made["rendering_ms"].as_f64().unwrap() > 0.0, "{made}");
        image::load_from_memory(&image).unwrap().to_rgb8()
    });
    assert_eq!(direct.dimensions(), (160, 120));
    let differ = metrics::compare(&direct, &from_samples).unwrap().flip_mean;
    assert!(differ < 0.15, "{differ}");

    for (path, word) in [
        ("/frame?eye=1,2", "eye"),
        ("/frame?size=0x100", "width"),
        ("/frame?eye=NaN,0,0", "eye"),
        ("/frame?size=99999x99999", "width"),
        ("/frame?zoom=2", "zoom"),
    ] {
        let (status, _, text) = page.get(path);
        let text = String::from_utf8(text).unwrap();
        assert!(status == 400 && text.contains(word), "{path}: {status} {text}");
    }
    assert_eq!(page.get("/elsewhere").0, 404);
    // A foreign host name that resolves to this machine.
    for path in ["/", "/scene", "/cells", "/frame", "/session"] {
        assert_eq!(page.get_as(path, "example.org").0, 421, "{path}");
    }
    assert!(page.process.stop().success());
}

#[test]
fn a_page_is_local_by_default_and_a_missing_service_is_an_error() {
    let refused = run(&["browse", "--listen", "0.0.0.0:0"]);
    assert_eq!(refused.status.code(), Some(2), "{}", stderr(&refused));
    assert!(stderr(&refused).contains("--insecure"), "{}", stderr(&refused));
    let nobody = run(&["browse", "--listen", "127.0.0.1:0", "--server", "http://127.0.0.1:9"]);
    assert_eq!(nobody.status.code(), Some(1), "{}", stderr(&nobody));
    assert!(stderr(&nobody).contains("127.0.0.1:9"), "{}", stderr(&nobody));
}

#[test]
fn the_page_the_status_and_metrics_show_light_cells() {
    let coordinator = Coordinator::start(SMALL, &["--indirect=cells", "--refining-share=0", "--exposure=0"]);
    let _worker = coordinator.workers(1);
    coordinator.wait_for_workers(1);
    let page = Page::open(&coordinator.url, &[]);
    let read = |bytes: &[u8]| serde_json::from_slice::<Value>(bytes).unwrap();
    let began = Instant::now();
    let shown = loop {
        assert_eq!(page.get("/frame?size=160x120&direct").0, 200);
        let (status, _, cells) = page.get("/cells");
        let cells = read(&cells);
        assert!(status == 200 && began.elapsed() < 2 * PATIENCE, "{status} {cells}");
        if cells["lit_share"].as_f64() > Some(0.0) {
            break cells;
        }
    };
    assert!(shown["pages"].as_u64() > Some(0) && shown["fill_ms"].as_f64() > Some(0.0), "{shown}");
    let status = |more: &[&str]| run(&[&["status", "--server", &coordinator.url], more].concat()).stdout;
    let (table, status) = (String::from_utf8(status(&[])).unwrap(), read(&status(&["--json"])));
    assert!(table.contains("light cells") && table.contains("s of filling"), "{table}");
    let worker = &status["workers"][0];
    let count =
        |name: &str| worker["light_cells"][name].as_u64().unwrap_or_else(|| panic!("no {name}: {worker}"));
    assert!(count("bytes") > 0 && count("cells") >= count("pages") && count("filled") > 0, "{worker}");
    assert!(count("pixels") >= count("pixels_lit") && count("waiting") < 1 << 30, "{worker}");
    for (url, metric) in [
        (coordinator.url.as_str(), "argus_worker_light_cells_lit_share{"),
        (worker["address"].as_str().unwrap(), "argus_worker_light_cell_pixels_total{light=\"cells\"}"),
    ] {
        let address = url.strip_prefix("http://").unwrap();
        let text = String::from_utf8(get_from(address, "/metrics", address).2).unwrap();
        let row =
            text.lines().find(|row| row.starts_with(metric)).unwrap_or_else(|| panic!("no {metric}: {text}"));
        assert!(row.rsplit(' ').next().unwrap().parse::<f64>().unwrap() > 0.0, "{row}");
    }
}
