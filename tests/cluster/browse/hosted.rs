//! The page that a service serves itself: by `argus serve`, with and without TLS and tokens.

use std::io::{Read, Write};
use std::net::TcpStream;
use std::process::Stdio;
use std::sync::Arc;

use serde_json::Value;
use tokio_rustls::rustls::pki_types::{CertificateDer, ServerName, pem::PemObject};
use tokio_rustls::rustls::{ClientConfig, ClientConnection, RootCertStore, StreamOwned, crypto};

use super::get_from;
use crate::support::{PATIENCE, Process, SMALL, argus, run, stderr};

/// `argus serve` and the link of its page, if it has one.
fn serve(more: &[&str]) -> (Process, Option<String>) {
    let mut command =
        argus(&["serve", "--listen", "127.0.0.1:0", "--json", "--scene", SMALL, "--workers", "1"]);
    command.args(more).stdout(Stdio::piped());
    let mut process = Process::start(command);
    let mut objects = serde_json::Deserializer::from_reader(process.take_stdout()).into_iter::<Value>();
    let announced = objects.next().unwrap().unwrap();
    let page = announced["page"].as_str().map(str::to_owned);
    (process, page)
}

#[test]
fn a_service_serves_its_page_itself_unless_told_not_to() {
    let (mut process, page) = serve(&[]);
    let page = page.expect("a link");
    let address = page.strip_prefix("http://127.0.0.1:").map(|port| format!("127.0.0.1:{port}")).unwrap();
    let (status, _, scene) = get_from(&address, "/scene", &address);
    let scene: Value = serde_json::from_slice(&scene).unwrap();
    assert_eq!((status, scene["name"].as_str()), (200, Some(SMALL)));
    assert_eq!(get_from(&address, "/", &address).0, 200);
    let (status, head, image) = get_from(&address, "/frame?size=64x48&direct", &address);
    assert_eq!((status, image::load_from_memory(&image).unwrap().width()), (200, 64), "{head}");
    // The same guard as that of `argus browse`.
    assert_eq!(get_from(&address, "/", "example.org").0, 421);
    // A second service on this machine has its page, too.
    let (_second, other) = serve(&[]);
    assert_ne!(other.as_ref(), Some(&page));
    assert!(process.stop().success());
    assert!(TcpStream::connect(&address).is_err(), "the page ends with its service");

    // A page shows the scene that its address names.
    let (_both, page) = serve(&["--scene", "hills=terrain:3000"]);
    let address = page.unwrap().replace("http://", "");
    let get = |path: &str| get_from(&address, path, &address);
    let scene = |path: &str| serde_json::from_slice::<Value>(&get(path).2).unwrap();
    let (first, second) = (scene("/scene"), scene("/scene?scene=hills"));
    assert_eq!((&first["name"], &first["scene"]), (&SMALL.into(), &"terrain".into()));
    assert_eq!((&second["name"], &second["scene"]), (&"terrain:3000".into(), &"hills".into()));
    assert_eq!(second["scenes"], serde_json::json!(["terrain", "hills"]));
    let frames = ["/frame?size=64x48&direct", "/frame?size=64x48&direct&scene=hills"].map(get);
    assert!(frames[0].0 == 200 && frames[1].0 == 200 && frames[0].2 != frames[1].2);
    let (status, _, reason) = get("/scene?scene=valley");
    let reason = String::from_utf8_lossy(&reason);
    assert!(status == 400 && reason.contains("terrain, hills"), "{status} {reason}");

    let (_without, none) = serve(&["--page", "off"]);
    assert_eq!(none, None);
    let refused = run(&["serve", "--scene", SMALL, "--listen", "127.0.0.1:0", "--page", "0.0.0.0:0"]);
    assert_eq!(refused.status.code(), Some(2), "{}", stderr(&refused));
    assert!(stderr(&refused).contains("--page"), "{}", stderr(&refused));
}

/// A request by TLS; returns status and head, and body.
fn request(address: &str, trust: &Arc<ClientConfig>, request: &str, more: &str) -> (u16, String, String) {
    let tcp = TcpStream::connect(address).unwrap();
    tcp.set_read_timeout(Some(PATIENCE)).unwrap();
    let name = ServerName::try_from("127.0.0.1").unwrap();
    let mut stream = StreamOwned::new(ClientConnection::new(trust.clone(), name).unwrap(), tcp);
    write!(stream, "{request} HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\n{more}").unwrap();
    let mut answer = Vec::new();
    // A server may end TCP without the end of TLS.
    let _ = stream.read_to_end(&mut answer);
    let text = String::from_utf8_lossy(&answer).into_owned();
    let (head, body) = text.split_once("\r\n\r\n").unwrap_or_else(|| panic!("{text:?}"));
    (head.split(' ').nth(1).unwrap().parse().unwrap(), head.to_owned(), body.to_owned())
}

#[test]
fn a_page_of_a_service_with_tokens_is_by_tls_and_wants_a_login() {
    let folder = tempfile::tempdir().unwrap();
    let made = run(&["certs", folder.path().to_str().unwrap()]);
    assert!(made.status.success(), "{}", stderr(&made));
    let file = |name: &str| std::fs::read(folder.path().join(name)).unwrap();
    let (_process, page) = serve(&["--config", folder.path().join("argus.toml").to_str().unwrap()]);
    let page = page.unwrap();
    let address = page.strip_prefix("https://").unwrap_or_else(|| panic!("{page}"));

    let mut roots = RootCertStore::empty();
    roots.add(CertificateDer::from_pem_slice(&file("ca.pem")).unwrap()).unwrap();
    let trust = ClientConfig::builder_with_provider(Arc::new(crypto::ring::default_provider()))
        .with_safe_default_protocol_versions()
        .unwrap()
        .with_root_certificates(roots)
        .with_no_client_auth();
    let trust = Arc::new(trust);
    let get =
        |path: &str, more: &str| request(address, &trust, &format!("GET {path}"), &format!("{more}\r\n"));
    let login = |token: &str, more: &str| {
        request(
            address,
            &trust,
            "POST /login",
            &format!("{more}Content-Length: {}\r\n\r\n{token}", token.len()),
        )
    };
    // The page itself is no secret.
    assert_eq!(get("/", "").0, 200);
    for path in ["/scene", "/cells", "/frame"] {
        assert_eq!(get(path, "").0, 401, "{path}");
        assert_eq!(get(path, "Cookie: argus_login=00000000000000000000000000000000\r\n").0, 401, "{path}");
    }
    let token = String::from_utf8(file("view.token")).unwrap();
    for wrong in ["", "two words", "nonsense"] {
        assert_eq!(login(wrong, "").0, 401, "{wrong:?}");
    }
    assert_eq!(login(&"x".repeat(10_000), "").0, 413);
    assert_eq!(login(&token, "Origin: https://example.org\r\n").0, 403);
    let (status, head, _) = login(&token, &format!("Origin: https://{address}\r\n"));
    assert_eq!(status, 204, "{head}");
    let cookie = head
        .lines()
        .find_map(|line| line.to_ascii_lowercase().strip_prefix("set-cookie: ").map(str::to_owned));
    let cookie = cookie.unwrap_or_else(|| panic!("no cookie in {head}"));
    assert!(["httponly", "samesite=strict", "secure"].iter().all(|word| cookie.contains(word)), "{cookie}");
    assert!(!cookie.contains(&token.trim().to_ascii_lowercase()));
    let logged_in = format!("Cookie: {}\r\n", cookie.split(';').next().unwrap());
    let (status, _, scene) = get("/scene", &logged_in);
    assert!(status == 200 && scene.contains(SMALL), "{status} {scene}");
    assert_eq!(get("/frame?size=64x48&direct", &logged_in).0, 200);
}
