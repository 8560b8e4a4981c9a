//! Ends response streams whose client stopped reading (send timeout).
//!
//! A stream is polled for its next item when its connection has room for it. While a client does not read, the stream
//! holds resources: a place in a queue, a worker's stream, a packed frame. It is not polled meanwhile, so a task
//! watches the time.

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

/// A stream that is dropped, with everything it holds, if an item is not sent in time.
pub(crate) struct WithSendTimeout<T> {
    state: Arc<Mutex<State<T>>>,
    watch: AbortHandle,
    item: Duration,
}

struct State<T> {
    /// The stream; `None` once it ended.
    inner: Option<Inner<T>>,
    /// The time of the last item, until the next poll.
    unsent: Option<Instant>,
    late: bool,
}

/// Wraps a stream so that each item must be sent within `item`.
pub(crate) fn with_send_timeout<T: Send + 'static>(
    stream: impl Stream<Item = Result<T, Status>> + Send + 'static,
    item: Duration,
) -> WithSendTimeout<T> {
    let inner: Inner<T> = Box::pin(stream);
    let state = Arc::new(Mutex::new(State { inner: Some(inner), unsent: None, late: false }));
    let watch = tokio::spawn(watch(state.clone(), item)).abort_handle();
    WithSendTimeout { state, watch, item }
}

/// Watches the time until the stream ends.
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
            let reason =
                || format!("send timeout: the client read nothing for {:.1} s", self.item.as_secs_f64());
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
        // Drops the stream now, not with the task.
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
    async fn the_timeout_covers_the_last_item_but_not_waiting_for_the_next() {
        let place = Arc::new(());
        let late = futures::stream::once(async {
            tokio::time::sleep(ITEM * 20).await;
            Ok(7)
        });
        let mut stream = with_send_timeout(late.chain(held(&place, 1)), ITEM);
        assert_eq!(stream.next().await.unwrap().unwrap(), 7, "the reader did not keep it waiting");
        assert_eq!(stream.next().await.unwrap().unwrap(), 0);
        tokio::time::sleep(ITEM * 2).await;
        assert_eq!(Arc::strong_count(&place), 1, "the next item was not requested");
    }

    #[tokio::test(start_paused = true)]
    async fn a_dropped_stream_frees_what_it_holds() {
        let place = Arc::new(());
        let stream = with_send_timeout(held(&place, 9), ITEM);
        assert_eq!(Arc::strong_count(&place), 2);
        drop(stream);
        assert_eq!(Arc::strong_count(&place), 1);
    }
}
