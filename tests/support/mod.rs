//! Starts and stops the processes under test; no child outlives its test.
#![allow(dead_code)] // each test binary uses its own part

pub(crate) mod wire;

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStderr, ChildStdout, Command, ExitStatus, Output, Stdio};
use std::time::{Duration, Instant};

use serde_json::Value;

/// A small generated scene, so that no test needs a file: quick to sample, yet with every effect.
pub(crate) const SMALL: &str = "terrain:20000";
/// Longest wait for a quick operation; generous, since tests share few cores.
pub(crate) const PATIENCE: Duration = Duration::from_secs(60);

/// The program under test: `argus`, or in the tests of the experiments `argus-lab`, which has its subcommands too.
const PROGRAM: &str = match (option_env!("CARGO_BIN_EXE_argus"), option_env!("CARGO_BIN_EXE_argus-lab")) {
    (Some(program), _) | (_, Some(program)) => program,
    _ => panic!("cargo names the program under test"),
};

/// The program under test, with the arguments given.
pub(crate) fn argus(arguments: &[&str]) -> Command {
    let mut command = Command::new(PROGRAM);
    // Several renderers share few cores: one thread of the software driver each.
    command
        .args(arguments)
        .env("LP_NUM_THREADS", "1")
        .env_remove("ARGUS_SERVER")
        .env_remove("ARGUS_CONFIG")
        .env_remove("ARGUS_LOG");
    command
}

/// Runs the program to its end.
pub(crate) fn run(arguments: &[&str]) -> Output {
    argus(arguments).stdin(Stdio::null()).output().expect("argus starts")
}

/// Runs the program to its end, which must be a success, and returns its single JSON object.
pub(crate) fn json(arguments: &[&str]) -> Value {
    let output = run(arguments);
    assert!(output.status.success(), "argus {arguments:?}: {}", stderr(&output));
    serde_json::from_slice(&output.stdout).unwrap_or_else(|error| {
        panic!("argus {arguments:?} printed no JSON ({error}): {}", String::from_utf8_lossy(&output.stdout))
    })
}

/// Standard error of a process, as text.
pub(crate) fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// Prints a line even if the test passes, where `eprintln!` is captured.
pub(crate) fn say(line: &str) {
    let _ = writeln!(std::io::stderr(), "{line}");
}

/// Prints why a test is skipped; fails if this variable is 1.
pub(crate) fn skip(required_by: &str, why: &str) {
    let required = std::env::var(required_by).is_ok_and(|value| value == "1");
    assert!(!required, "{required_by}=1, yet {why}");
    say(&format!("SKIPPED: {why}"));
}

/// Whether a program is installed and works; if not, prints that, or fails if this variable is 1.
pub(crate) fn there(required_by: &str, program: &str, arguments: &[&str]) -> bool {
    let answer = Command::new(program).args(arguments).stdin(Stdio::null()).output();
    let there = answer.is_ok_and(|output| output.status.success());
    if !there {
        skip(required_by, &format!("`{program} {}` does not answer", arguments.join(" ")));
    }
    there
}

/// Standard output of a command, which must succeed.
pub(crate) fn succeed(command: &mut Command) -> String {
    let output = command.stdin(Stdio::null()).output().unwrap_or_else(|error| panic!("{command:?}: {error}"));
    let printed = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(output.status.success(), "{command:?}: {printed}{}", stderr(&output));
    printed
}

/// Checks the report of an `argus load --json`: every view that it sent was answered.
pub(crate) fn all_answered(load: Child) {
    let output = load.wait_with_output().unwrap();
    let text = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "argus load failed: {text}");
    let report: Value = serde_json::from_str(&text).unwrap();
    assert!(report["sent"].as_u64().unwrap() > 0, "{report:#}");
    assert_eq!(report["answered"], report["sent"], "{report:#}");
}

/// A child process that ends when dropped.
pub(crate) struct Process(Child);

impl Process {
    /// Starts a service that runs until its standard input closes, which the end of this test also does.
    pub(crate) fn start(mut command: Command) -> Self {
        command.arg("--exit-with-stdin").stdin(Stdio::piped());
        Self(command.spawn().expect("argus starts"))
    }

    pub(crate) fn pid(&self) -> u32 {
        self.0.id()
    }

    pub(crate) fn take_stdout(&mut self) -> ChildStdout {
        self.0.stdout.take().expect("stdout is piped")
    }

    pub(crate) fn take_stderr(&mut self) -> ChildStderr {
        self.0.stderr.take().expect("stderr is piped")
    }

    /// Stops it by the end of its input.
    pub(crate) fn stop(&mut self) -> ExitStatus {
        drop(self.0.stdin.take());
        self.wait()
    }

    /// Kills it, like a crash.
    pub(crate) fn kill(&mut self) {
        self.0.kill().expect("the process can be killed");
        self.0.wait().expect("the process ends");
    }

    /// Waits for its end, and returns the status.
    pub(crate) fn wait(&mut self) -> ExitStatus {
        let deadline = Instant::now() + PATIENCE;
        loop {
            if let Some(status) = self.0.try_wait().expect("the process can be asked") {
                return status;
            }
            assert!(Instant::now() < deadline, "process {} does not end", self.pid());
            std::thread::sleep(Duration::from_millis(10));
        }
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// A coordinator in its own process.
pub(crate) struct Coordinator {
    pub(crate) process: Process,
    pub(crate) url: String,
}

impl Coordinator {
    pub(crate) fn start(scene: &str, more: &[&str]) -> Self {
        Self::start_in(Path::new(env!("CARGO_MANIFEST_DIR")), scene, more)
    }

    /// Starts with changes to its environment.
    pub(crate) fn start_with(scene: &str, more: &[&str], change: impl FnOnce(&mut Command)) -> Self {
        Self::start_changed(Path::new(env!("CARGO_MANIFEST_DIR")), scene, more, change)
    }

    /// Starts in a working directory, from which relative paths of scenes begin.
    pub(crate) fn start_in(folder: &Path, scene: &str, more: &[&str]) -> Self {
        Self::start_changed(folder, scene, more, |_| {})
    }

    fn start_changed(folder: &Path, scene: &str, more: &[&str], change: impl FnOnce(&mut Command)) -> Self {
        let mut command = argus(&["coordinator", "--listen", "127.0.0.1:0", "--json", "--scene", scene]);
        command.args(more).current_dir(folder).stdout(Stdio::piped());
        change(&mut command);
        let mut process = Process::start(command);
        // The stream stays open while the service runs, so exactly one object is read from it.
        let mut objects = serde_json::Deserializer::from_reader(process.take_stdout()).into_iter::<Value>();
        let announced = objects.next().expect("the coordinator announces itself").expect("in JSON");
        let url = announced["url"].as_str().expect("with its address").to_owned();
        Self { process, url }
    }

    /// Starts a worker of this coordinator, in its own process.
    pub(crate) fn worker(&self, more: &[&str]) -> Process {
        let mut command = argus(&["worker", "--coordinator", &self.url, "--listen", "127.0.0.1:0"]);
        command.args(more);
        Process::start(command)
    }

    pub(crate) fn workers(&self, count: usize) -> Vec<Process> {
        (0..count).map(|_| self.worker(&[])).collect()
    }

    /// The object of `argus status --json`.
    pub(crate) fn status(&self) -> Value {
        json(&["status", "--server", &self.url, "--json"])
    }

    /// Waits until the status satisfies `condition`.
    pub(crate) fn wait_until(&self, what: &str, condition: impl Fn(&Value) -> bool) -> Value {
        let deadline = Instant::now() + PATIENCE;
        loop {
            let status = self.status();
            if condition(&status) {
                return status;
            }
            assert!(Instant::now() < deadline, "not in time: {what}; status {status:#}");
            std::thread::sleep(Duration::from_millis(200));
        }
    }

    pub(crate) fn wait_for_workers(&self, count: u64) -> Value {
        self.wait_until(&format!("{count} workers"), |status| status["processes"] == count)
    }

    /// Waits until views show all light of the sample set, so that images of later views can be compared.
    pub(crate) fn wait_for_full_light(&self) -> Value {
        self.wait_until("full light", |status| status["light"] == "full")
    }
}

/// A file of the real scenes, or `None` with a notice if this machine has none. With `ARGUS_REQUIRE_SCENES=1`, that is a
/// failure.
pub(crate) fn real_scene(path: &str) -> Option<PathBuf> {
    real(path).inspect(|file| assert!(file.is_file(), "ARGUS_SCENES has no file {path}"))
}

/// A folder of the real scenes, like [`real_scene`].
pub(crate) fn real_folder(path: &str) -> Option<PathBuf> {
    real(path).inspect(|folder| assert!(folder.is_dir(), "ARGUS_SCENES has no folder {path}"))
}

fn real(path: &str) -> Option<PathBuf> {
    let Some(folder) = std::env::var_os("ARGUS_SCENES").map(PathBuf::from) else {
        skip("ARGUS_REQUIRE_SCENES", &format!("ARGUS_SCENES is not set, so there is no {path}"));
        return None;
    };
    Some(folder.join(path))
}
