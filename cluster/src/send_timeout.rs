//! Ends response streams whose client stopped reading (send timeout).
//!
//! A stream is asked for its next item when its connection has room for it. A client that does not read keeps what the stream
//! holds: a place, a worker's stream, a packed frame. The stream itself is not asked meanwhile, so a task watches the time.

use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll, ready};
use std::time::Duration;

use futures::Stream;
use parking_lot::Mutex;
use tokio::task::AbortHandle;
use tokio::time::{Instant, sleep_until};
use tonic::Status;

type Inner<T> = Pin<Box<dyn Stream<Item = Result<T, Status>> + Send>>;

/// A stream that is dropped, and with it all that it holds, where an item that it gave is not sent in time.
pub(crate) struct WithSendTimeout<T> {
    state: Arc<Mutex<State<T>>>,
    watch: AbortHandle,
    item: Duration,
}

struct State<T> {
    /// `None` once it is over.
    inner: Option<Inner<T>>,
    /// Since when an item was given and no other asked for.
    unsent: Option<Instant>,
    late: bool,
}

/// The stream, of which each item is sent within `item`.
pub(crate) fn with_send_timeout<T: Send + 'static>(
    stream: impl Stream<Item = Result<T, Status>> + Send + 'static,
    item: Duration,
) -> WithSendTimeout<T> {
    let inner: Inner<T> = Box::pin(stream);
    let state = Arc::new(Mutex::new(State { inner: Some(inner), unsent: None, late: false }));
    let watch = tokio::spawn(watch(state.clone(), item)).abort_handle();
    WithSendTimeout { state, watch, item }
}

/// Looks at the time until it is over.
async fn watch<T>(state: Arc<Mutex<State<T>>>, item: Duration) {
    let mut look = Instant::now() + item;
    loop {
        sleep_until(look).await;
        let now = Instant::now();
        let dropped = {
            let mut state = state.lock();
            let unsent = state.unsent.map(|since| since + item);
            let late = unsent.is_some_and(|due| due <= now);
            state.late |= late;
            look = unsent.unwrap_or(now + item);
            if late { state.inner.take() } else { None }
        };
        if dropped.is_some() {
            return;
        }
    }
}

impl<T> Stream for WithSendTimeout<T> {
    type Item = Result<T, Status>;

    fn poll_next(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Option<Self::Item>> {
        let mut state = self.state.lock();
        state.unsent = None;
        let Some(inner) = &mut state.inner else {
            let reason = || format!("what was sent was not read for {:.1} s", self.item.as_secs_f64());
            let late = std::mem::take(&mut state.late);
            return Poll::Ready(late.then(|| Err(Status::unavailable(reason()))));
        };
        let next = ready!(inner.as_mut().poll_next(cx));
        match next {
            Some(_) => state.unsent = Some(Instant::now()),
            None => state.inner = None,
        }
        Poll::Ready(next)
    }
}

impl<T> Drop for WithSendTimeout<T> {
    fn drop(&mut self) {
        self.watch.abort();
        // What is held goes now and not with the task.
        let dropped = self.state.lock().inner.take();
        drop(dropped);
    }
}

#[cfg(test)]
mod tests {
    use futures::StreamExt;
    use tonic::Code;

    use super::*;

    const ITEM: Duration = Duration::from_secs(10);

    fn held(place: &Arc<()>, items: usize) -> impl Stream<Item = Result<usize, Status>> + use<> {
        let place = place.clone();
        futures::stream::iter(0..items).map(move |item| {
            let _held = &place;
            Ok(item)
        })
    }

    #[tokio::test(start_paused = true)]
    async fn an_item_that_is_not_sent_in_time_ends_the_stream_and_frees_what_it_holds() {
        let place = Arc::new(());
        let mut stream = with_send_timeout(held(&place, 9), ITEM);
        for item in 0..4 {
            assert_eq!(stream.next().await.unwrap().unwrap(), item);
            tokio::time::sleep(ITEM * 9 / 10).await;
            assert_eq!(Arc::strong_count(&place), 2, "slow, and in time");
        }
        tokio::time::sleep(ITEM).await;
        assert_eq!(Arc::strong_count(&place), 1);
        assert_eq!(stream.next().await.unwrap().unwrap_err().code(), Code::Unavailable);
        assert!(stream.next().await.is_none());
    }

    #[tokio::test(start_paused = true)]
    async fn the_last_item_counts_and_waiting_for_the_next_does_not() {
        let place = Arc::new(());
        let late = futures::stream::once(async {
            tokio::time::sleep(ITEM * 20).await;
            Ok(7)
        });
        let mut stream = with_send_timeout(late.chain(held(&place, 1)), ITEM);
        assert_eq!(stream.next().await.unwrap().unwrap(), 7, "the reader did not keep it waiting");
        assert_eq!(stream.next().await.unwrap().unwrap(), 0);
        tokio::time::sleep(ITEM * 2).await;
        assert_eq!(Arc::strong_count(&place), 1, "nobody asked whether that was the last");
    }

    #[tokio::test(start_paused = true)]
    async fn whoever_goes_frees_all_at_once() {
        let place = Arc::new(());
        let stream = with_send_timeout(held(&place, 9), ITEM);
        assert_eq!(Arc::strong_count(&place), 2);
        drop(stream);
        assert_eq!(Arc::strong_count(&place), 1);
    }
}
