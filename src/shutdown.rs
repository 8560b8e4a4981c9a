//! Shutdown of a service: on Ctrl-C, on SIGTERM, or when its parent process ends.

use std::io::Read;

use tokio_util::sync::CancellationToken;

/// A token that is cancelled when this process is asked to stop. A second request ends it at once.
///
/// With `stdin`, the end of standard input is a request too. It also comes when the parent is killed, while a signal
/// would have to be sent.
pub fn requested(stdin: bool) -> CancellationToken {
    let token = CancellationToken::new();
    let signalled = token.clone();
    tokio::spawn(async move {
        signal().await;
        tracing::info!("finishing the requests in work; press Ctrl-C again to stop at once");
        signalled.cancel();
        signal().await;
        std::process::exit(1);
    });
    if stdin {
        let closed = token.clone();
        // A thread of its own: reading standard input cannot be cancelled and would block the runtime.
        std::thread::spawn(move || {
            let mut rest = [0; 64];
            let mut input = std::io::stdin().lock();
            while !matches!(input.read(&mut rest), Ok(0) | Err(_)) {}
            closed.cancel();
        });
    }
    token
}

/// Returns at the next request. If signals cannot be handled, they end the process themselves.
async fn signal() {
    #[cfg(unix)]
    {
        use tokio::signal::unix::{SignalKind, signal};
        let Ok(mut terminate) = signal(SignalKind::terminate()) else { return std::future::pending().await };
        tokio::select! {
            result = tokio::signal::ctrl_c() => if result.is_err() { std::future::pending().await },
            _ = terminate.recv() => {}
        }
    }
    #[cfg(not(unix))]
    if tokio::signal::ctrl_c().await.is_err() {
        std::future::pending().await
    }
}
