//! A whole cluster of processes on this machine, for as long as somebody needs it.

use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use serde::Deserialize;

/// How long the processes may take to finish what is in work.
const GRACE: Duration = Duration::from_secs(20);

/// An `argus serve` in a process of its own, with its workers; ends when dropped.
#[derive(Debug)]
pub struct LocalCluster {
    process: Child,
    started: Instant,
    url: String,
    pid: u32,
}

/// The part of what a service prints that is of use here.
#[derive(Deserialize)]
struct Announcement {
    url: String,
    pid: u32,
}

impl LocalCluster {
    /// Starts a coordinator and `workers` worker processes of the program `argus`, on a free port of the
    /// loopback interface; `more` are further arguments of `argus serve`. Returns as soon as clients can
    /// connect; views that are asked for before the workers have joined wait for them.
    ///
    /// # Errors
    /// If the program cannot be started, or ends before it serves; what it had to say is on standard error.
    pub fn start(argus: &Path, scene: &str, workers: usize, more: &[String]) -> anyhow::Result<Self> {
        let workers = workers.to_string();
        Self::spawn(argus, &["serve", "--scene", scene, "--workers", &workers], more, |_| ())
    }

    /// Starts a cluster like [`Self::start`] whose processes keep in `caches` what they would keep in the user's caches:
    /// programs that the driver has compiled, scenes, calibrations.
    ///
    /// # Errors
    /// If the program cannot be started, or ends before it serves; what it had to say is on standard error.
    pub fn with_caches(
        argus: &Path,
        scene: &str,
        workers: usize,
        more: &[String],
        caches: &Path,
    ) -> anyhow::Result<Self> {
        let workers = workers.to_string();
        Self::spawn(argus, &["serve", "--scene", scene, "--workers", &workers], more, |command| {
            // Mesa's drivers go by the first of these that is set, NVIDIA's by the last.
            for name in ["MESA_GLSL_CACHE_DIR", "MESA_SHADER_CACHE_DIR", "ARGUS_CACHE"] {
                command.env_remove(name);
            }
            command.env("XDG_CACHE_HOME", caches).env("__GL_SHADER_DISK_CACHE_PATH", caches);
        })
    }

    /// Starts a cluster whose workers' software driver has one thread each, unless the environment says how many: else a worker that is alone
    /// has those that others would have, and is no measure for them.
    ///
    /// # Errors
    /// As [`Self::start`].
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
    /// As [`Self::start`].
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
            // Progress is shown by whoever asked for the cluster; its processes report trouble alone.
            command.env("ARGUS_LOG", "warn");
        }
        // A cluster of its own goes by no configuration but its arguments, or who started it could not reach it.
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
        // One object and no more: the stream stays open for as long as the service runs.
        let mut objects = serde_json::Deserializer::from_reader(output).into_iter::<Announcement>();
        match objects.next() {
            Some(Ok(Announcement { url, pid })) => Ok(Self { process, started, url, pid }),
            _ => bail!("the service ended before it served: {}", process.wait()?),
        }
    }

    /// Where clients reach it.
    pub fn url(&self) -> &str {
        &self.url
    }

    /// When its first process was started.
    pub fn started(&self) -> Instant {
        self.started
    }

    /// Process id of the coordinator.
    pub fn pid(&self) -> u32 {
        self.pid
    }

    /// Lets it finish what is in work.
    ///
    /// # Errors
    /// If it did not end in time or did not end well.
    pub fn stop(mut self) -> anyhow::Result<()> {
        match self.end()? {
            Some(status) if status.success() => Ok(()),
            Some(status) => bail!("the service ended with {status}"),
            None => bail!("the service did not end within {} s", GRACE.as_secs()),
        }
    }

    /// Closes its standard input, by which it and its workers know that they are to stop.
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
        // Nothing is left to report to; the operating system has the processes' last word.
        let _ = self.end();
    }
}
