//! The thread that carries requests, and waiting for them.

use std::process;
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use pyo3::prelude::*;
use tokio::runtime::{Builder, Runtime};
use tokio::time::timeout;

use crate::error::misused;

/// How long Ctrl-C waits at most.
const TICK: Duration = Duration::from_millis(100);

/// The runtime of a process, by its id.
static RUNTIME: Mutex<Option<Home>> = Mutex::new(None);

/// The process whose threads carry a connection. A forked process has none of them.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Home {
    process: u32,
    runtime: &'static Runtime,
}

impl Home {
    /// The calling process. Its runtime is made at the first call, and lives as long as the process.
    ///
    /// # Errors
    /// The system has no thread for it.
    pub(crate) fn here() -> PyResult<Self> {
        let mut kept = RUNTIME.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(home) = kept.filter(|home| home.process == process::id()) {
            return Ok(home);
        }
        // One thread moves bytes. Callers' threads unpack them.
        let runtime =
            Builder::new_multi_thread().worker_threads(1).thread_name("argus").enable_all().build()?;
        // After a fork, dropping the parent's runtime would wait for threads that are not there.
        let home = Self { process: process::id(), runtime: Box::leak(Box::new(runtime)) };
        *kept = Some(home);
        Ok(home)
    }

    /// Waits without the interpreter's lock. Signals interrupt it.
    ///
    /// # Errors
    /// The exception of a signal's handler, such as `KeyboardInterrupt`; `ArgusError` after a fork.
    pub(crate) fn wait<T: Send>(
        &self,
        py: Python<'_>,
        future: impl Future<Output = T> + Send,
    ) -> PyResult<T> {
        self.check(py)?;
        py.detach(|| {
            self.runtime.block_on(async {
                let mut future = std::pin::pin!(future);
                loop {
                    match timeout(TICK, &mut future).await {
                        Ok(value) => return Ok(value),
                        Err(_) => Python::attach(|py| py.check_signals())?,
                    }
                }
            })
        })
    }

    /// Starts a task.
    pub(crate) fn spawn(&self, task: impl Future<Output = ()> + Send + 'static) {
        self.runtime.spawn(task);
    }

    /// # Errors
    /// `ArgusError` if this process is a fork of the one that connected.
    pub(crate) fn check(&self, py: Python<'_>) -> PyResult<()> {
        if self.process == process::id() {
            return Ok(());
        }
        Err(misused(
            py,
            "this connection belongs to the process that this one was forked from: connect to its url here",
        ))
    }
}
