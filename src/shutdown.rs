//! When a service stops: on Ctrl-C, on SIGTERM, or when the process that started it is gone.

use std::io::Read;

use tokio_util::sync::CancellationToken;

/// A token that is cancelled when this process is asked to stop. A second request ends it at once.
///
/// With `stdin`, the end of standard input is a request too: whoever holds the other end of that pipe need
/// not live to say goodbye, which a signal would demand.
pub(crate) fn requested(stdin: bool) -> CancellationToken {
    let token = CancellationToken::new();
    let signalled = token.clone();
    tokio::spawn(async move {
        signal().await;
        tracing::info!("finishing what is in work; once more to stop at once");
        signalled.cancel();
        signal().await;
        std::process::exit(1);
    });
    if stdin {
        let closed = token.clone();
        // A thread of its own: reading standard input cannot be cancelled, and must not hold up the runtime.
        std::thread::spawn(move || {
            let mut rest = [0; 64];
            let mut input = std::io::stdin().lock();
            while !matches!(input.read(&mut rest), Ok(0) | Err(_)) {}
            closed.cancel();
        });
    }
    token
}

/// Returns at the next request. Where signals cannot be listened to, they end the process by themselves.
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
