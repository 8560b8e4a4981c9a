//! Tuning of connections, the same between all processes.

use std::time::Duration;

use tonic::transport::Endpoint;

/// HTTP/2 window of one response, bytes: the largest frames wait for the receiver only a few times.
const STREAM_WINDOW_BYTES: u32 = 4 << 20;
/// HTTP/2 window of a connection, bytes.
const CONNECTION_WINDOW_BYTES: u32 = 16 << 20;
/// HTTP/2 window of one relayed response, whose client may not read it, bytes.
const RELAY_WINDOW_BYTES: u32 = 1 << 20;
/// Largest window of HTTP/2, bytes.
const LARGEST_WINDOW_BYTES: u32 = (1 << 31) - 1;
/// Size of HTTP/2 frames, bytes: one frame per chunk rather than 64.
const HTTP2_FRAME_BYTES: u32 = 1 << 20;

/// Sets windows, delays and keepalive of a connection for frames or samples.
///
/// Windows are fixed, since hyper's adaptive ones start at 64 KiB and grow with a measured round trip. Over loopback,
/// 290 frames of 200×150 pixels took 145–195 ms with adaptive windows, 55–125 ms with these windows, and 45–100 ms
/// with these HTTP/2 frames as well.
pub fn tuned(endpoint: Endpoint) -> Endpoint {
    endpoint
        .tcp_nodelay(true)
        .http2_adaptive_window(false)
        .initial_stream_window_size(STREAM_WINDOW_BYTES)
        .initial_connection_window_size(CONNECTION_WINDOW_BYTES)
        .max_frame_size(HTTP2_FRAME_BYTES)
        // A vanished peer is detected in seconds, also on an idle connection.
        .http2_keep_alive_interval(Duration::from_secs(5))
        .keep_alive_timeout(Duration::from_secs(5))
        .keep_alive_while_idle(true)
}

/// Tunes a connection for up to `most` concurrent relayed responses. The connection's window holds those of all
/// responses, so that unread ones never block others. A response's window is one chunk, since unread data are
/// buffered here.
pub fn relayed(endpoint: Endpoint, most: usize) -> Endpoint {
    let [answer, all] = relay_windows(most);
    tuned(endpoint).initial_stream_window_size(answer).initial_connection_window_size(all)
}

/// Windows of one response and of all of them, bytes.
fn relay_windows(most: usize) -> [u32; 2] {
    let most = u32::try_from(most).unwrap_or(u32::MAX).max(1);
    let answer = RELAY_WINDOW_BYTES.min(LARGEST_WINDOW_BYTES / most).max(1);
    [answer, answer.saturating_mul(most).min(LARGEST_WINDOW_BYTES)]
}

/// Tunes a connection to a peer that can be replaced, so that false suspicion costs little. A peer that hangs is
/// detected within 2.5 s of its last byte, half of the five seconds for the takeover by a standby.
pub fn replaceable(endpoint: Endpoint) -> Endpoint {
    tuned(endpoint)
        .http2_keep_alive_interval(Duration::from_millis(1000))
        .keep_alive_timeout(Duration::from_millis(1500))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_connections_window_holds_those_of_all_relayed_responses() {
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
