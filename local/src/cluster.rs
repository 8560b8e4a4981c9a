//! Starts a cluster of processes on this machine, for the demo and for studies.

use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use serde::Deserialize;

/// How long the processes may take to finish their work when they are stopped.
const GRACE: Duration = Duration::from_secs(20);

/// An `argus serve` process with its workers. It ends when dropped.
#[derive(Debug)]
pub struct LocalCluster {
    process: Child,
    started: Instant,
    url: String,
    pid: u32,
}

/// The fields of the service's announcement that are used here.
#[derive(Deserialize)]
struct Announcement {
    url: String,
    pid: u32,
}

impl LocalCluster {
    /// Starts a coordinator and `workers` worker processes of the program `argus`, on a free port of the loopback
    /// interface. `more` are further arguments of `argus serve`. Returns as soon as clients can connect; earlier
    /// requests wait for the workers to join.
    ///
    /// # Errors
    /// The program cannot be started, or ends before it serves. Its reason is on standard error.
    pub fn start(argus: &Path, scene: &str, workers: usize, more: &[String]) -> anyhow::Result<Self> {
        let workers = workers.to_string();
        Self::spawn(argus, &["serve", "--scene", scene, "--workers", &workers], more, |_| ())
    }

    /// Starts a cluster like [`Self::start`] whose processes use `caches` in place of the user's cache folders: compiled
    /// programs of the driver, scenes, calibrations.
    ///
    /// # Errors
    /// The program cannot be started, or ends before it serves. Its reason is on standard error.
    pub fn with_caches(
        argus: &Path,
        scene: &str,
        workers: usize,
        more: &[String],
        caches: &Path,
    ) -> anyhow::Result<Self> {
        let workers = workers.to_string();
        Self::spawn(argus, &["serve", "--scene", scene, "--workers", &workers], more, |command| {
            // Mesa's drivers use the first of these that is set, NVIDIA's the last.
            for name in ["MESA_GLSL_CACHE_DIR", "MESA_SHADER_CACHE_DIR", "ARGUS_CACHE"] {
                command.env_remove(name);
            }
            command.env("XDG_CACHE_HOME", caches).env("__GL_SHADER_DISK_CACHE_PATH", caches);
        })
    }

    /// Starts a cluster whose workers' software driver has one thread each, unless `LP_NUM_THREADS` is set. Otherwise
    /// a lone worker would use the threads that other workers would have, and could not be compared with them.
    ///
    /// # Errors
    /// Any error of [`Self::start`].
    pub fn of_single_threads(
        argus: &Path,
        scene: &str,
        workers: usize,
        more: &[String],
    ) -> anyhow::Result<Self> {
        let workers = workers.to_string();
        Self::spawn(argus, &["serve", "--scene", scene, "--workers", &workers], more, |command| {
            if std::env::var_os("LP_NUM_THREADS").is_none() {
                command.env("LP_NUM_THREADS", "1");
            }
        })
    }

    /// Starts a coordinator without workers.
    ///
    /// # Errors
    /// Any error of [`Self::start`].
    pub fn coordinator(argus: &Path, scene: &str, more: &[String]) -> anyhow::Result<Self> {
        Self::spawn(argus, &["coordinator", "--scene", scene], more, |_| ())
    }

    fn spawn(
        argus: &Path,
        arguments: &[&str],
        more: &[String],
        change: impl FnOnce(&mut Command),
    ) -> anyhow::Result<Self> {
        let mut command = Command::new(argus);
        change(&mut command);
        if std::env::var_os("ARGUS_LOG").is_none() {
            // The caller shows progress itself; its processes log warnings only.
            command.env("ARGUS_LOG", "warn");
        }
        // Only arguments configure this cluster. Variables of the environment could make it unreachable.
        for (name, _) in std::env::vars_os() {
            if name.to_str().is_some_and(|name| name.starts_with("ARGUS_") && name.contains("__")) {
                command.env_remove(name);
            }
        }
        let started = Instant::now();
        let mut process = command
            .args(arguments)
            .args(["--config=", "--json", "--exit-with-stdin", "--listen", "127.0.0.1:0"])
            .args(more)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .with_context(|| format!("cannot start {}", argus.display()))?;
        let Some(output) = process.stdout.take() else { bail!("the service has no output") };
        // Reads one object and no more: the stream stays open while the service runs.
        let mut objects = serde_json::Deserializer::from_reader(output).into_iter::<Announcement>();
        match objects.next() {
            Some(Ok(Announcement { url, pid })) => Ok(Self { process, started, url, pid }),
            _ => bail!("the service ended before it served: {}", process.wait()?),
        }
    }

    /// The URL that clients connect to.
    pub fn url(&self) -> &str {
        &self.url
    }

    /// When the first process was started.
    pub fn started(&self) -> Instant {
        self.started
    }

    /// Process id of the coordinator.
    pub fn pid(&self) -> u32 {
        self.pid
    }

    /// Stops the cluster after it finishes its work.
    ///
    /// # Errors
    /// It did not end in time, or ended with an error.
    pub fn stop(mut self) -> anyhow::Result<()> {
        match self.end()? {
            Some(status) if status.success() => Ok(()),
            Some(status) => bail!("the service ended with {status}"),
            None => bail!("the service did not end within {} s", GRACE.as_secs()),
        }
    }

    /// Closes standard input, which stops the coordinator and its workers.
    fn end(&mut self) -> std::io::Result<Option<ExitStatus>> {
        drop(self.process.stdin.take());
        let deadline = Instant::now() + GRACE;
        while Instant::now() < deadline {
            if let Some(status) = self.process.try_wait()? {
                return Ok(Some(status));
            }
            std::thread::sleep(Duration::from_millis(10));
        }
        self.process.kill()?;
        self.process.wait()?;
        Ok(None)
    }
}

impl Drop for LocalCluster {
    fn drop(&mut self) {
        // No receiver for an error is left.
        let _ = self.end();
    }
}
