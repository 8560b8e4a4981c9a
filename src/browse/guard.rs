//! Access control of the page's server: only requests under this machine's names, and only WebSockets of the own page.

use std::net::IpAddr;

use axum::http::{HeaderMap, Uri, header};

/// Whether a request names this machine as its host. DNS rebinding sends requests under another site's name, and
/// would let that site's page see what this client may see. `authority`: the host of the request's URI, if it has
/// one.
pub(super) fn is_of_this_machine(headers: &HeaderMap, authority: Option<&str>) -> bool {
    let named = headers.get(header::HOST).and_then(|host| host.to_str().ok());
    let Some(host) = named.or(authority) else { return false };
    // [::1]:7480, 127.0.0.1:7480, localhost
    let name = match host.strip_prefix('[') {
        Some(rest) => rest.split(']').next().unwrap_or_default(),
        None => host.split(':').next().unwrap_or_default(),
    };
    name.eq_ignore_ascii_case("localhost") || name.parse::<IpAddr>().is_ok_and(|ip| ip.is_loopback())
}

/// Whether a WebSocket comes from the page that this server serves. Browsers let any page open a WebSocket to any
/// server and name the page in `Origin`. Other programs send no `Origin` and may connect.
pub(super) fn is_of_own_page(headers: &HeaderMap) -> bool {
    let mut origins = headers.get_all(header::ORIGIN).iter();
    let Some(origin) = origins.next() else { return true };
    let (Ok(origin), None) = (origin.to_str(), origins.next()) else { return false };
    let host = headers.get(header::HOST).and_then(|host| host.to_str().ok());
    // `null` and `file:` have no authority.
    let authority = origin.parse::<Uri>().ok().and_then(|uri| uri.scheme().and(uri.authority()).cloned());
    matches!((authority, host), (Some(authority), Some(host)) if authority.as_str().eq_ignore_ascii_case(host))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn headers(host: &str, origin: Option<&str>) -> HeaderMap {
        let mut headers = HeaderMap::new();
        headers.insert(header::HOST, host.parse().unwrap());
        if let Some(origin) = origin {
            headers.insert(header::ORIGIN, origin.parse().unwrap());
        }
        headers
    }

    #[test]
    fn host_names_that_may_point_anywhere_are_not_this_machine() {
        for host in ["127.0.0.1:7480", "localhost", "LOCALHOST:7480", "[::1]:7480", "127.8.0.1"] {
            assert!(is_of_this_machine(&headers(host, None), None), "{host}");
        }
        for host in [
            "example.org",
            "example.org:7480",
            "localhost.example.org",
            "192.0.2.1:7480",
            "[2001:db8::1]",
            "",
        ] {
            assert!(!is_of_this_machine(&headers(host, None), None), "{host}");
        }
        assert!(!is_of_this_machine(&HeaderMap::new(), None));
    }

    #[test]
    fn a_page_of_another_origin_is_not_the_own_page() {
        let own = |origin| is_of_own_page(&headers("127.0.0.1:7480", origin));
        for origin in [None, Some("http://127.0.0.1:7480"), Some("https://127.0.0.1:7480")] {
            assert!(own(origin), "{origin:?}");
        }
        for origin in [
            "http://example.org",
            "http://127.0.0.1",
            "http://127.0.0.1:7481",
            "http://127.0.0.1:7480.example.org",
            "http://127.0.0.1:7480@example.org",
            "http://example.org@127.0.0.1:7480",
            "127.0.0.1:7480",
            "null",
            "file://",
            "",
        ] {
            assert!(!own(Some(origin)), "{origin}");
        }
        let mut two = headers("127.0.0.1:7480", Some("http://127.0.0.1:7480"));
        two.append(header::ORIGIN, "http://example.org".parse().unwrap());
        assert!(!is_of_own_page(&two));
        assert!(!is_of_own_page(&HeaderMap::from_iter([(header::ORIGIN, "http://a".parse().unwrap())])));
    }
}
