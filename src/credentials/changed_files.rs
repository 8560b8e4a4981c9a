//! Files whose contents change while a process runs.
//!
//! Contents are compared, not times: copies keep times, and Kubernetes replaces a whole folder by a link.

use std::path::PathBuf;
use std::time::Duration;

/// Interval between two looks at the files.
const LOOK: Duration = Duration::from_secs(1);

/// What each file holds, or why it cannot be read.
type Contents = Vec<Result<Vec<u8>, std::io::ErrorKind>>;

/// Some small files.
pub(super) struct ChangedFiles {
    paths: Vec<PathBuf>,
    /// The contents that were reported last.
    reported: Contents,
}

impl ChangedFiles {
    /// The files as they are now. Later contents are changes.
    pub(super) async fn of(paths: Vec<PathBuf>) -> Self {
        let reported = read(&paths).await;
        Self { paths, reported }
    }

    /// Waits until the files hold something else than at the last report, and have held it for two looks. So a file that
    /// is being written is left alone. Returns what `load` makes of them, unless they changed meanwhile.
    pub(super) async fn changed<T>(&mut self, load: impl Fn() -> T) -> T {
        let mut before = self.reported.clone();
        loop {
            tokio::time::sleep(LOOK).await;
            let now = read(&self.paths).await;
            if now != self.reported && now == before {
                let loaded = load();
                if read(&self.paths).await == now {
                    self.reported = now;
                    return loaded;
                }
            }
            before = now;
        }
    }
}

/// Reads files on a thread that may block, since a network's file system may hang.
async fn read(paths: &[PathBuf]) -> Contents {
    let paths = paths.to_vec();
    let read = move || paths.iter().map(|path| std::fs::read(path).map_err(|error| error.kind())).collect();
    tokio::task::spawn_blocking(read).await.unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use tokio::time::timeout;

    use super::*;

    #[tokio::test]
    async fn a_change_is_reported_once_and_not_while_it_is_being_written() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("tokens");
        std::fs::write(&path, "old").unwrap();
        let mut files = ChangedFiles::of(vec![path.clone()]).await;
        let load = || std::fs::read_to_string(&path).unwrap_or_default();
        // A writer that is slower than the looks.
        let writer = {
            let path = path.clone();
            tokio::spawn(async move {
                for text in ["n", "ne", "new"] {
                    std::fs::write(&path, text).unwrap();
                    tokio::time::sleep(LOOK * 9 / 10).await;
                }
            })
        };
        assert_eq!(timeout(LOOK * 8, files.changed(load)).await.unwrap(), "new");
        writer.await.unwrap();
        assert!(timeout(LOOK * 3, files.changed(load)).await.is_err(), "nothing changed");
        // A file that is gone is a change, too.
        std::fs::remove_file(&path).unwrap();
        assert_eq!(timeout(LOOK * 4, files.changed(load)).await.unwrap(), "");
    }
}
