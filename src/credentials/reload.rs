//! Certificates, keys and tokens are read again when their files change.

use std::path::PathBuf;
use std::sync::Arc;

use argus_client::{Client, ConnectOptions};
use argus_cluster::security::ReloadableSecurity;

use super::changed_files::ChangedFiles;
use super::{of_client, read_member};
use crate::settings;

/// Follows the files of a process that listens, until it is dropped. What cannot be used changes nothing, is logged once
/// and counted by the process's metrics.
pub(crate) async fn keep_member(
    security: Arc<ReloadableSecurity>,
    settings: settings::Security,
    clients: bool,
) {
    let settings::Security { certificate, key, ca, tokens, .. } = &settings;
    let tokens = tokens.as_ref().filter(|_| clients);
    let mut files =
        ChangedFiles::of(present([certificate.as_ref(), key.as_ref(), ca.as_ref(), tokens])).await;
    // They may have changed since the process read them.
    let mut read = read_member(&settings, clients);
    loop {
        match read {
            Ok(Some(read)) => match security.replace(read) {
                Ok(true) => tracing::info!("new certificates or tokens are in use"),
                Ok(false) => {}
                Err(error) => kept(&error.to_string()),
            },
            // The files are named by settings, which do not change.
            Ok(None) => return,
            Err(error) => {
                security.refuse();
                kept(&format!("{error:#}"));
            }
        }
        read = files.changed(|| read_member(&settings, clients)).await;
    }
}

/// Follows the files of a client's settings, until it is dropped: connects anew when they change, and hands the client
/// to `replace`. What the service refuses changes nothing and is logged.
pub(crate) async fn keep_client(settings: settings::Client, connections: usize, replace: impl Fn(Client)) {
    let settings::Client { server, ca, token_file, certificate, key, .. } = &settings;
    let paths = [ca.as_ref(), token_file.as_ref(), certificate.as_ref(), key.as_ref()];
    let mut files = ChangedFiles::of(present(paths)).await;
    loop {
        let connected = match files.changed(|| of_client(&settings)).await {
            Ok(options) => Client::connect_with(server, &ConnectOptions { connections, ..options })
                .await
                .map_err(|error| error.to_string()),
            Err(error) => Err(format!("{error:#}")),
        };
        match connected {
            Ok(client) => {
                replace(client);
                tracing::info!("new credentials are in use");
            }
            Err(reason) => kept(&reason),
        }
    }
}

fn present<'p>(paths: impl IntoIterator<Item = Option<&'p PathBuf>>) -> Vec<PathBuf> {
    paths.into_iter().flatten().cloned().collect()
}

/// Logs that new files cannot be used.
fn kept(reason: &str) {
    tracing::warn!(
        reason,
        "changed certificates or tokens cannot be used, the earlier ones stay in use: correct the files"
    );
}
