//! How connections are tuned, the same between all processes.

use std::time::Duration;

use tonic::transport::Endpoint;

/// Of one answer: the largest frames are sent without waiting for the receiver more than a few times.
const STREAM_WINDOW_BYTES: u32 = 4 << 20;
/// Of all answers of a connection together.
const CONNECTION_WINDOW_BYTES: u32 = 16 << 20;
/// Of one answer that is passed on to somebody who may not read it.
const RELAY_WINDOW_BYTES: u32 = 1 << 20;
/// HTTP/2 knows no larger one.
const LARGEST_WINDOW_BYTES: u32 = (1 << 31) - 1;
/// One HTTP/2 frame a chunk rather than 64.
const HTTP2_FRAME_BYTES: u32 = 1 << 20;

/// Sets windows, delays and keep-alive of a connection that frames or samples come back on.
///
/// Fixed windows, since hyper's adaptive ones begin at 64 KiB and grow by a measured round trip: 290 frames of
/// 200×150 pixels over loopback took 145–195 ms with them, 55–125 ms with these windows and 45–100 ms with
/// these HTTP/2 frames as well.
pub fn tuned(endpoint: Endpoint) -> Endpoint {
    endpoint
        .tcp_nodelay(true)
        .http2_adaptive_window(false)
        .initial_stream_window_size(STREAM_WINDOW_BYTES)
        .initial_connection_window_size(CONNECTION_WINDOW_BYTES)
        .max_frame_size(HTTP2_FRAME_BYTES)
        // A peer that vanished without a word is noticed in seconds, also while nothing is asked of it.
        .http2_keep_alive_interval(Duration::from_secs(5))
        .keep_alive_timeout(Duration::from_secs(5))
        .keep_alive_while_idle(true)
}

/// Of a peer with up to `most` answers at the same time that are passed on, to whoever reads them or not: the connection's
/// window holds those of all its answers, so that ones that are not read never stop the others. An answer's is smaller
/// for that, a chunk: what is not read is held here, a window of each.
pub fn relayed(endpoint: Endpoint, most: usize) -> Endpoint {
    let [answer, all] = relay_windows(most);
    tuned(endpoint).initial_stream_window_size(answer).initial_connection_window_size(all)
}

/// Bytes of one answer and of all of them.
fn relay_windows(most: usize) -> [u32; 2] {
    let most = u32::try_from(most).unwrap_or(u32::MAX).max(1);
    let answer = RELAY_WINDOW_BYTES.min(LARGEST_WINDOW_BYTES / most).max(1);
    [answer, answer.saturating_mul(most).min(LARGEST_WINDOW_BYTES)]
}

/// Of a peer that another one can stand in for, so that doubt costs little: one that hangs or is cut off is noticed within
/// two and a half seconds of its last byte, which leaves as long again of the five in which a standby takes over.
pub fn replaceable(endpoint: Endpoint) -> Endpoint {
    tuned(endpoint)
        .http2_keep_alive_interval(Duration::from_millis(1000))
        .keep_alive_timeout(Duration::from_millis(1500))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_window_of_a_connection_holds_those_of_all_that_is_relayed_on_it() {
        assert_eq!(relay_windows(128), [1 << 20, 128 << 20]);
        for most in [0, 1, 7, 2047, 2048, 1 << 14, 1 << 20] {
            let [answer, all] = relay_windows(most);
            let together = u64::from(answer) * most as u64;
            assert!(together <= u64::from(all) && all <= LARGEST_WINDOW_BYTES, "{most}: {answer} of {all}");
        }
        // As many as a worker takes connections for: still more than the windows that HTTP/2 begins with.
        assert!(relay_windows(1 << 14)[0] > 1 << 16);
    }
}
