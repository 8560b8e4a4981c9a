//! How connections are tuned, the same between all processes.

use std::time::Duration;

use tonic::transport::Endpoint;

/// Of one answer: the largest frames are sent without waiting for the receiver more than a few times.
const STREAM_WINDOW_BYTES: u32 = 4 << 20;
/// Of all answers of a connection together.
const CONNECTION_WINDOW_BYTES: u32 = 16 << 20;
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

/// Of a peer that another one can stand in for, so that doubt costs little: one that hangs or is cut off is noticed within
/// two and a half seconds of its last byte, which leaves as long again of the five in which a standby takes over.
pub fn replaceable(endpoint: Endpoint) -> Endpoint {
    tuned(endpoint)
        .http2_keep_alive_interval(Duration::from_millis(1000))
        .keep_alive_timeout(Duration::from_millis(1500))
}
