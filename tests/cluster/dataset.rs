//! Data sets: rendered by a service, stopped, gone on with, and repeated.

use std::collections::BTreeMap;
use std::path::Path;
use std::process::{Output, Stdio};
use std::time::{Duration, Instant};

use serde_json::Value;

use crate::support::{Coordinator, Process, SMALL, argus, run, stderr};

/// Light that two services have alike.
const FIXED: [&str; 8] = ["--effects", "all", "--indirect", "off", "--exposure", "0", "--visibility", "cpu"];
const OUTPUTS: &str = "color,depth,normal,instance";

/// A file of `count` cameras that look at the middle of the scene from all around.
fn transforms(folder: &Path, count: usize, side: u32, k1: f64) -> String {
    let frames: Vec<Value> = (0..count)
        .map(|i| {
            let turn = i as f64 / count as f64 * std::f64::consts::TAU;
            let (s, c) = turn.sin_cos();
            let rows =
                [[c, 0.0, s, 60.0 * s], [0.0, 1.0, 0.0, 25.0], [-s, 0.0, c, 60.0 * c], [0.0, 0.0, 0.0, 1.0]];
            serde_json::json!({"file_path": format!("./images/{i:04}"), "transform_matrix": rows})
        })
        .collect();
    let file = serde_json::json!({
        "camera_model": "OPENCV", "fl_x": side, "w": side, "h": side, "k1": k1, "frames": frames,
    });
    let path = folder.join("transforms.json");
    std::fs::write(&path, file.to_string()).unwrap();
    path.to_str().unwrap().to_owned()
}

/// All files of a folder but the journal, whose lines are in the order of the answers.
fn files(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let all = walkdir::WalkDir::new(folder).into_iter().map(Result::unwrap);
    let all = all.filter(|entry| entry.file_type().is_file() && entry.file_name() != "argus-dataset.jsonl");
    all.map(|entry| {
        let name = entry.path().strip_prefix(folder).unwrap().to_str().unwrap().to_owned();
        (name, std::fs::read(entry.path()).unwrap())
    })
    .collect()
}

fn arguments<'a>(server: &'a str, cameras: &'a str, out: &'a str) -> Vec<&'a str> {
    vec!["dataset", "--connect", server, "--cameras", cameras, "--out", out, "--outputs", OUTPUTS, "--json"]
}

fn report(output: &Output) -> Value {
    assert!(output.status.success(), "{}", stderr(output));
    serde_json::from_slice(&output.stdout).unwrap()
}

fn finished(out: &Path) -> usize {
    let journal = std::fs::read_to_string(out.join("argus-dataset.jsonl")).unwrap_or_default();
    journal.lines().count().saturating_sub(1)
}

#[test]
fn a_killed_data_set_goes_on_and_ends_with_the_bytes_of_an_undisturbed_one() {
    const FRAMES: usize = 40;
    let folder = tempfile::tempdir().unwrap();
    let cameras = transforms(folder.path(), FRAMES, 64, -0.05);
    let (killed, whole) = (folder.path().join("killed"), folder.path().join("whole"));
    let [at_killed, at_whole] = [&killed, &whole].map(|path| path.to_str().unwrap());
    let coordinator = Coordinator::start(SMALL, &FIXED);
    let _workers = coordinator.workers(1);
    coordinator.wait_for_workers(1);

    let mut command = argus(&arguments(&coordinator.url, &cameras, at_killed));
    let mut child = command.stdin(Stdio::null()).stdout(Stdio::null()).spawn().unwrap();
    let until = Instant::now() + Duration::from_secs(60);
    while finished(&killed) < 5 && Instant::now() < until {
        std::thread::sleep(Duration::from_millis(2));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    let before = finished(&killed);
    assert!((5..FRAMES).contains(&before), "{before} frames were finished when it was killed");

    let resumed = report(&run(&arguments(&coordinator.url, &cameras, at_killed)));
    let (verified, rendered) = (resumed["verified"].as_u64().unwrap(), resumed["rendered"].as_u64().unwrap());
    assert!(verified >= 5 && verified + rendered == FRAMES as u64, "{resumed}");
    let undisturbed = report(&run(&arguments(&coordinator.url, &cameras, at_whole)));
    assert_eq!(
        (undisturbed["rendered"].as_u64(), undisturbed["failed"].as_u64()),
        (Some(FRAMES as u64), Some(0))
    );
    let (first, second) = (files(&killed), files(&whole));
    assert_eq!(first.len(), 4 * FRAMES + 1, "{:?}", first.keys());
    assert!(first.contains_key("depth/0003.png") && first.contains_key("normal/0003.exr"));
    assert!(first == second, "the data sets differ");

    // A file that changed since is rendered again, and no other.
    std::fs::write(whole.join("depth/0003.png"), "damaged").unwrap();
    std::fs::remove_file(whole.join("images/0007.png")).unwrap();
    let again = report(&run(&arguments(&coordinator.url, &cameras, at_whole)));
    assert_eq!((again["rendered"].as_u64(), again["verified"].as_u64()), (Some(2), Some(FRAMES as u64 - 2)));
    assert!(files(&whole) == second, "the frames were not made again");
}

#[test]
fn a_data_set_of_a_local_service_is_the_same_by_its_record() {
    let folder = tempfile::tempdir().unwrap();
    let cameras = transforms(folder.path(), 3, 48, 0.0);
    let out = folder.path().join("set");
    let at = [
        "dataset",
        "--cameras",
        &cameras,
        "--out",
        out.to_str().unwrap(),
        "--json",
        "--outputs",
        "color,flow",
    ];
    let done = report(&run(&[&at[..], &["--scene", SMALL, "--workers", "1"], &FIXED].concat()));
    assert_eq!((done["frames"].as_u64(), done["rendered"].as_u64()), (Some(3), Some(3)), "{done}");
    let journal = std::fs::read_to_string(out.join("argus-dataset.jsonl")).unwrap();
    let line: Value = serde_json::from_str(journal.lines().nth(1).unwrap()).unwrap();
    let record = folder.path().join("record.json");
    std::fs::write(&record, line["record"].to_string()).unwrap();
    let coordinator = Coordinator::start(SMALL, &FIXED);
    let _worker: Process = coordinator.worker(&[]);
    coordinator.wait_for_workers(1);
    let again = folder.path().join("again");
    let replay =
        ["replay", record.to_str().unwrap(), "--server", &coordinator.url, "--out", again.to_str().unwrap()];
    let replayed = run(&replay);
    assert_eq!(String::from_utf8_lossy(&replayed.stdout), "equal\n", "{}", stderr(&replayed));
}

#[test]
fn wrong_requests_of_a_data_set_are_refused_in_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let cameras = transforms(folder.path(), 1, 48, -0.05);
    let out = folder.path().to_str().unwrap();
    let bad = folder.path().join("bad.json");
    std::fs::write(&bad, r#"{"fl_x": 1, "w": 1, "h": 1, "frames": [{"file_path": "../../x"}]}"#).unwrap();
    let bad = bad.to_str().unwrap();
    let nowhere = "http://127.0.0.1:1";
    for (arguments, code, word) in [
        (vec!["--cameras", bad, "--out", out, "--server", nowhere], 2, "leave --out"),
        (vec!["--cameras", "none.json", "--out", out, "--server", nowhere], 2, "none.json"),
        (vec!["--cameras", &cameras, "--out", out, "--server", nowhere], 1, "argus serve"),
        (vec!["--cameras", &cameras, "--out", out, "--visibility", "cpu"], 2, "--scene"),
        (
            vec!["--cameras", &cameras, "--out", out, "--scene", "none.glb", "--workers", "1"],
            1,
            "before it served",
        ),
    ] {
        let output = run(&[&["dataset"], &arguments[..]].concat());
        let message = stderr(&output);
        assert_eq!(output.status.code(), Some(code), "{arguments:?}: {message}");
        assert!(message.lines().last().is_some_and(|line| line.contains(word)), "{word}: {message}");
    }
    // The folder holds the file of cameras, which no run may write over.
    let coordinator = Coordinator::start(SMALL, &FIXED);
    let output = run(&["dataset", "--cameras", &cameras, "--out", out, "--server", &coordinator.url]);
    assert!(stderr(&output).contains("not empty"), "{}", stderr(&output));
    assert_eq!(output.status.code(), Some(2));
}
