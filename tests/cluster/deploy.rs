//! Containers: the compose cluster, started with a real container engine.

use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use crate::support::{argus, json, run, stderr, succeed, there};
use serde_json::Value;

const BASE: &str = "argus-test-base:bookworm";
const IMAGE: &str = "argus-test";
const PROJECT: &str = "argustest";

/// One cluster at a time: cores are few, and the names of image and project are fixed.
static TURN: Mutex<()> = Mutex::new(());

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// Whether a container engine is available; CI requires it.
fn engine() -> bool {
    let all = [("docker", "info"), ("docker-compose", "version"), ("debootstrap", "--version")];
    all.iter().all(|(program, argument)| there("ARGUS_REQUIRE_ENGINE", program, &[argument]))
}

/// Builds a base image with the software driver.
fn base() {
    succeed(Command::new(root().join("deploy/base-image")).arg(BASE));
}

/// The compose cluster; it is taken down when dropped.
struct Compose {
    folder: tempfile::TempDir,
    port: u16,
    /// Its compose files, below `deploy/`.
    files: &'static [&'static str],
    _turn: MutexGuard<'static, ()>,
}

impl Compose {
    /// Builds the image from this repository's files and the program under test, and starts the cluster.
    fn up(files: &'static [&'static str], workers: &str) -> Self {
        let turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
        base();
        let folder = tempfile::tempdir().unwrap();
        let tree = folder.path();
        for part in ["deploy", ".dockerignore", "Cargo.toml"] {
            succeed(Command::new("cp").arg("-r").arg(root().join(part)).arg(tree));
        }
        let binary = tree.join("deploy/bin/argus");
        std::fs::create_dir_all(binary.parent().unwrap()).unwrap();
        std::fs::copy(env!("CARGO_BIN_EXE_argus"), &binary).unwrap();
        // Debugging information is ten times the size of the program.
        let _ = Command::new("strip").arg("--strip-debug").arg(&binary).status();
        let port = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
        let compose = Self { folder, port, files, _turn: turn };
        compose.run(&["build", "coordinator"]);
        compose.run(&["up", "-d", "--no-build", "--scale", &format!("worker={workers}")]);
        compose
    }

    fn command(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new("docker-compose");
        command.args(["-p", PROJECT]);
        for file in self.files {
            command.arg("-f").arg(self.folder.path().join("deploy").join(file));
        }
        command.args(arguments);
        command.env("ARGUS_IMAGE", IMAGE).env("ARGUS_BASE_IMAGE", BASE).env("ARGUS_BUILD_IMAGE", BASE);
        command.env("ARGUS_SCENE", crate::support::SMALL).env("ARGUS_PORT", self.port.to_string());
        // The old builder: newer ones are not available everywhere.
        command.env("DOCKER_BUILDKIT", "0").env("COMPOSE_DOCKER_CLI_BUILD", "0");
        command
    }

    fn run(&self, arguments: &[&str]) -> String {
        succeed(&mut self.command(arguments))
    }

    fn url(&self) -> String {
        format!("http://127.0.0.1:{}", self.port)
    }

    /// Ids of a service's containers, including stopped ones.
    fn containers(&self, service: &str) -> Vec<String> {
        let ids = self.run(&["ps", "-a", "-q", service]);
        ids.lines().map(str::to_owned).collect()
    }

    fn wait_for_workers(&self, count: u64) -> Value {
        self.wait_for(count, &["--server", &self.url()])
    }

    /// Waits for `count` workers in the status that a client with these flags reads.
    fn wait_for(&self, count: u64, how: &[&str]) -> Value {
        let deadline = Instant::now() + 2 * crate::support::PATIENCE;
        loop {
            let answer = run(&[&["status", "--json"], how].concat());
            let status = serde_json::from_slice::<Value>(&answer.stdout).unwrap_or_default();
            if status["processes"] == count {
                return status;
            }
            let logs = || self.run(&["logs", "--tail", "20"]);
            assert!(Instant::now() < deadline, "not {count} workers: {status:#}\n{}", logs());
            std::thread::sleep(Duration::from_millis(250));
        }
    }
}

impl Drop for Compose {
    fn drop(&mut self) {
        let _ = self.command(&["down", "-v", "-t", "3"]).output();
    }
}

fn docker(arguments: &[&str]) {
    succeed(Command::new("docker").args(arguments));
}

#[test]
fn a_compose_cluster_loses_no_frame_while_workers_are_killed_paused_and_cut_off() {
    if !engine() {
        return;
    }
    let cluster = Compose::up(&["compose.yaml"], "3");
    cluster.wait_for_workers(3);
    let folder = tempfile::tempdir().unwrap();
    let picture = folder.path().join("view.png");
    let view =
        ["view", "--server", &cluster.url(), "--eye", "0,200,300", "--target", "0,0,0", "--json", "--out"];
    let seen = json(&[&view[..], &[picture.to_str().unwrap()]].concat());
    assert!(picture.is_file(), "{seen:#}");

    let load = |seconds: &str| {
        let mut command =
            argus(&["load", "--server", &cluster.url(), "--clients", "3", "--rate", "4", "--json"]);
        command.args(["--size", "96x72", "--seconds", seconds, "--timeout", "30"]).stdout(Stdio::piped());
        command.spawn().unwrap()
    };
    let under_load = load("20");
    let workers = cluster.containers("worker");
    let network = format!("{PROJECT}_default");
    let pause = |secs| std::thread::sleep(Duration::from_secs(secs));
    pause(3);
    docker(&["kill", &workers[0]]);
    pause(3);
    docker(&["pause", &workers[1]]);
    pause(8);
    docker(&["unpause", &workers[1]]);
    pause(1);
    docker(&["network", "disconnect", "-f", &network, &workers[2]]);
    let report = under_load.wait_with_output().unwrap();
    let report: Value = serde_json::from_slice(&report.stdout).unwrap();
    // One worker is left for some seconds. On a slow machine the service may then refuse a view because of overload, and says so.
    let count = |name: &str| report[name].as_u64().unwrap();
    assert_eq!(count("answered") + count("rejected"), count("sent"), "{report:#}");
    assert!(count("rejected") <= count("sent") / 10, "{report:#}");

    // With more or fewer workers, the present ones share the roles.
    docker(&["network", "connect", &network, &workers[2]]);
    cluster.run(&["up", "-d", "--no-build", "--scale", "worker=4"]);
    let status = cluster.wait_for_workers(4);
    assert!(
        status["samplers"].as_u64() >= Some(1) && status["compositors"].as_u64() >= Some(1),
        "{status:#}"
    );
    cluster.run(&["up", "-d", "--no-build", "--scale", "worker=1"]);
    let status = cluster.wait_for_workers(1);
    assert_eq!(
        (status["samplers"].as_u64(), status["compositors"].as_u64()),
        (Some(1), Some(1)),
        "{status:#}"
    );
}

#[test]
fn a_compose_cluster_by_tls_serves_only_clients_with_a_token() {
    if !engine() {
        return;
    }
    let cluster = Compose::up(&["compose.yaml", "compose.tls.yaml"], "1");
    let certs = tempfile::tempdir().unwrap();
    let made = format!("{}:/certs/.", cluster.containers("coordinator")[0]);
    docker(&["cp", &made, certs.path().to_str().unwrap()]);
    let file = |name: &str| certs.path().join(name).to_str().unwrap().to_owned();
    assert!(!Path::new(&file("ca.key")).exists(), "whoever has the authority's key can join");

    let url = format!("https://localhost:{}", cluster.port);
    cluster.wait_for(1, &["--server", &url, "--config", &file("argus.toml")]);
    let picture = file("view.png");
    let view = ["view", "--size", "96x72", "--eye", "0,200,300", "--target", "0,0,0", "--out", &picture];
    let (ca, token) = (file("ca.pem"), file("view.token"));
    json(&[&view[..], &["--server", &url, "--ca", &ca, "--token-file", &token, "--json"]].concat());
    assert!(Path::new(&picture).is_file());
    let plain = cluster.url();
    for (how, reason) in [
        (&["--server", &url, "--ca", &ca][..], "a token is required"),
        (&["--server", &plain], "is not an Argus server"),
    ] {
        let refused = run(&[&view[..], how].concat());
        assert!(!refused.status.success() && stderr(&refused).contains(reason), "{}", stderr(&refused));
    }
}
