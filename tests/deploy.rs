//! Containers: the compose cluster, brought up for real where an engine is there, and the Kubernetes manifests.
#![allow(clippy::unwrap_used)] // a test ends at the first thing that goes wrong

mod support;

use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

use serde_json::Value;
use support::{argus, json, stderr};

const BASE: &str = "argus-test-base:bookworm";
const IMAGE: &str = "argus-test";
const PROJECT: &str = "argustest";

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn output(command: &mut Command) -> Output {
    command.stdin(Stdio::null()).output().unwrap_or_else(|error| panic!("{command:?}: {error}"))
}

fn succeed(command: &mut Command) -> String {
    let output = output(command);
    assert!(output.status.success(), "{command:?}: {}", stderr(&output));
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// Whether a program is there and works; otherwise what is missing is said, or is a failure where it must be there.
fn there(program: &str, arguments: &[&str]) -> bool {
    let answer = Command::new(program).args(arguments).stdin(Stdio::null()).output();
    let there = answer.is_ok_and(|output| output.status.success());
    if !there {
        let command = format!("{program} {}", arguments.join(" "));
        let required = std::env::var("ARGUS_REQUIRE_ENGINE").is_ok_and(|value| value == "1");
        assert!(!required, "ARGUS_REQUIRE_ENGINE=1, yet `{command}` does not answer");
        eprintln!("SKIPPED, LOUDLY: `{command}` does not answer, so the containers are not tested");
    }
    there
}

/// A base with the software driver in it.
fn base() {
    succeed(Command::new(root().join("deploy/base-image")).arg(BASE));
}

/// The cluster, taken down with its owner.
struct Compose {
    folder: tempfile::TempDir,
    port: u16,
}

impl Compose {
    /// Builds the image from the very files of this repository and the program under test, and starts the cluster.
    fn up() -> Self {
        base();
        let folder = tempfile::tempdir().unwrap();
        let tree = folder.path();
        for part in ["deploy", ".dockerignore", "Cargo.toml"] {
            succeed(Command::new("cp").arg("-r").arg(root().join(part)).arg(tree));
        }
        let binary = tree.join("deploy/bin/argus");
        std::fs::create_dir_all(binary.parent().unwrap()).unwrap();
        std::fs::copy(env!("CARGO_BIN_EXE_argus"), &binary).unwrap();
        // Debugging information is ten times the program.
        let _ = Command::new("strip").arg("--strip-debug").arg(&binary).status();
        let port = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
        let compose = Self { folder, port };
        compose.run(&["build", "coordinator"]);
        compose.run(&["up", "-d", "--no-build"]);
        compose
    }

    fn command(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new("docker-compose");
        command
            .args(["-p", PROJECT, "-f"])
            .arg(self.folder.path().join("deploy/compose.yaml"))
            .args(arguments);
        command.env("ARGUS_IMAGE", IMAGE).env("ARGUS_BASE_IMAGE", BASE).env("ARGUS_BUILD_IMAGE", BASE);
        command.env("ARGUS_SCENE", support::SMALL).env("ARGUS_PORT", self.port.to_string());
        // The old builder: newer ones are not everywhere.
        command.env("DOCKER_BUILDKIT", "0").env("COMPOSE_DOCKER_CLI_BUILD", "0");
        command
    }

    fn run(&self, arguments: &[&str]) -> String {
        succeed(&mut self.command(arguments))
    }

    fn url(&self) -> String {
        format!("http://127.0.0.1:{}", self.port)
    }

    /// Ids of the worker containers, stopped ones included.
    fn workers(&self) -> Vec<String> {
        let ids = self.run(&["ps", "-a", "-q", "worker"]);
        ids.lines().map(str::to_owned).collect()
    }

    fn wait_for_workers(&self, count: u64) -> Value {
        let deadline = Instant::now() + 2 * support::PATIENCE;
        loop {
            let answer = support::run(&["status", "--server", &self.url(), "--json"]);
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
    if !there("docker", &["info"])
        || !there("docker-compose", &["version"])
        || !there("debootstrap", &["--version"])
    {
        return;
    }
    let cluster = Compose::up();
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
    let workers = cluster.workers();
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
    assert_eq!(report["answered"], report["sent"], "{report:#}");
    assert_eq!(report["failed"], 0, "{report:#}");

    // More workers and fewer: those that are there share the roles.
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
fn the_image_is_built_from_every_part_of_the_workspace() {
    let workspace = std::fs::read_to_string(root().join("Cargo.toml")).unwrap();
    let workspace: toml::Table = workspace.parse().unwrap();
    let members = workspace["workspace"]["members"].as_array().unwrap();
    let sent = std::fs::read_to_string(root().join(".dockerignore")).unwrap();
    for member in
        members.iter().map(|member| member.as_str().unwrap()).chain(["src", "scripts", "Cargo.lock"])
    {
        assert!(sent.lines().any(|line| line == format!("!{member}")), "{member} is not in .dockerignore");
    }
}

/// Every manifest.
fn manifests() -> Vec<PathBuf> {
    let folder = root().join("deploy/kubernetes");
    let files = walkdir::WalkDir::new(folder).into_iter().map(|entry| entry.unwrap().into_path());
    files.filter(|path| path.extension().is_some_and(|extension| extension == "yaml")).collect()
}

#[test]
fn kubernetes_manifests_keep_to_the_published_schemas() {
    let cache = root().join("target/kubernetes-validate");
    let python = cache.join("bin/python");
    if !python.is_file() {
        let made = Command::new("python3").args(["-m", "venv"]).arg(&cache).stdin(Stdio::null()).output();
        let install = ["-m", "pip", "install", "--quiet", "kubernetes-validate"];
        let installed = made.is_ok_and(|output| output.status.success())
            && Command::new(&python).args(install).output().is_ok_and(|output| output.status.success());
        if !installed {
            let _ = std::fs::remove_dir_all(&cache);
            eprintln!("SKIPPED, LOUDLY: kubernetes-validate cannot be installed, so no manifest is checked");
            return;
        }
    }
    // What has no published schema of Kubernetes' own is checked by those who read it.
    let files: Vec<PathBuf> = manifests()
        .into_iter()
        .filter(|path| {
            !path.ends_with("kustomization.yaml") && !path.components().any(|part| part.as_os_str() == "keda")
        })
        .collect();
    assert!(files.len() >= 4, "{files:?}");
    let mut validate = Command::new(cache.join("bin/kubernetes-validate"));
    let checked = output(validate.arg("--strict").args(&files));
    assert!(checked.status.success(), "{}{}", String::from_utf8_lossy(&checked.stdout), stderr(&checked));
}

#[test]
fn manifests_name_only_arguments_and_files_that_exist() {
    for file in manifests() {
        let text = std::fs::read_to_string(&file).unwrap();
        let folder = file.parent().unwrap();
        for line in text.lines().map(str::trim) {
            // Resources and bases of a kustomization.
            if let Some(resource) =
                line.strip_prefix("- ").filter(|r| r.ends_with(".yaml") && !r.contains(' '))
            {
                assert!(folder.join(resource).is_file(), "{}: {resource}", file.display());
            }
            // Flags of argus, in whose help they must stand.
            let Some(flag) = line.strip_prefix("- --").filter(|_| text.contains("image: argus")) else {
                continue;
            };
            let flag = format!("--{}", flag.split('=').next().unwrap());
            let part = if text.contains("- worker\n") { "worker" } else { "coordinator" };
            let help = support::run(&[part, "--help"]);
            let help = String::from_utf8_lossy(&help.stdout).into_owned();
            assert!(help.contains(&flag), "{}: argus {part} has no {flag}", file.display());
        }
    }
}
