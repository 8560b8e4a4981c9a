//! Certificates and tokens that are replaced while a cluster by TLS runs.

use std::io::{Read as _, Write as _};
use std::net::TcpStream;
use std::path::Path;
use std::process::Stdio;
use std::sync::Arc;
use std::time::{Duration, Instant};

use argus_client::{Client, ConnectOptions, Credentials, Session, SessionEvent, SessionOptions, Token};
use argus_scene::{Outputs, PlanRequest, View};
use rcgen::{CertificateParams, Issuer, KeyPair};
use tokio_rustls::rustls::pki_types::{CertificateDer, ServerName, pem::PemObject as _};
use tokio_rustls::rustls::{ClientConfig, ClientConnection, RootCertStore, StreamOwned, crypto};

use crate::support::{PATIENCE, Process, SMALL, argus, run, stderr};

/// A change of files is in effect within this time: two looks, a second apart, and some for a busy machine.
const SOON: Duration = Duration::from_secs(20);

/// `argus serve` by TLS with certificates of its own.
struct Service {
    folder: tempfile::TempDir,
    _process: Process,
    url: String,
    page: String,
}

impl Service {
    fn start() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let made = run(&["certs", folder.path().to_str().unwrap()]);
        assert!(made.status.success(), "{}", stderr(&made));
        let config = folder.path().join("argus.toml");
        let mut command = argus(&["serve", "--config", config.to_str().unwrap(), "--json", "--scene", SMALL]);
        command.args(["--listen", "127.0.0.1:0", "--workers", "1"]).stdout(Stdio::piped());
        let mut process = Process::start(command);
        let mut objects =
            serde_json::Deserializer::from_reader(process.take_stdout()).into_iter::<serde_json::Value>();
        let announced = objects.next().unwrap().unwrap();
        let text = |key: &str| announced[key].as_str().unwrap().to_owned();
        Self { url: text("url"), page: text("page"), folder, _process: process }
    }

    fn read(&self, file: &str) -> String {
        std::fs::read_to_string(self.folder.path().join(file)).unwrap()
    }

    fn write(&self, file: &str, text: &str) {
        std::fs::write(self.folder.path().join(file), text).unwrap();
    }

    async fn connect(&self, token: &str) -> Result<Client, argus_client::ClientError> {
        let token = Some(Token::parse(token).unwrap());
        let credentials = Credentials { ca: Some(self.read("ca.pem").into()), token, identity: None };
        let options = ConnectOptions { credentials, ..ConnectOptions::default() };
        Client::connect_with(&self.url, &options).await
    }

    /// A connection by TLS, which has shaken hands.
    fn tls(&self, url: &str) -> StreamOwned<ClientConnection, TcpStream> {
        let mut roots = RootCertStore::empty();
        roots.add(CertificateDer::from_pem_slice(self.read("ca.pem").as_bytes()).unwrap()).unwrap();
        let config = ClientConfig::builder_with_provider(Arc::new(crypto::ring::default_provider()))
            .with_safe_default_protocol_versions()
            .unwrap()
            .with_root_certificates(roots)
            .with_no_client_auth();
        let tcp = TcpStream::connect(url.strip_prefix("https://").unwrap()).unwrap();
        tcp.set_read_timeout(Some(PATIENCE)).unwrap();
        let name = ServerName::try_from("127.0.0.1").unwrap();
        let mut stream = StreamOwned::new(ClientConnection::new(Arc::new(config), name).unwrap(), tcp);
        stream.conn.complete_io(&mut stream.sock).unwrap();
        stream
    }

    /// The certificate that a new connection gets.
    fn served(&self, url: &str) -> CertificateDer<'static> {
        self.tls(url).conn.peer_certificates().unwrap()[0].clone().into_owned()
    }

    /// The value of a metric with exactly these labels, as an operator reads it.
    fn metric(&self, token: &str, name: &str) -> f64 {
        let mut stream = self.tls(&self.url);
        let head = format!("GET /metrics HTTP/1.1\r\nHost: x\r\nAuthorization: Bearer {token}\r\n");
        write!(stream, "{head}Connection: close\r\n\r\n").unwrap();
        let mut page = Vec::new();
        // A server may end TCP without the end of TLS.
        let _ = stream.read_to_end(&mut page);
        let page = String::from_utf8_lossy(&page);
        let row = page.lines().find_map(|row| row.strip_prefix(name)?.strip_prefix(' '));
        row.unwrap_or_else(|| panic!("no {name} in {page}")).parse().unwrap()
    }
}

/// Repeats a check until it holds.
async fn soon(what: &str, mut holds: impl AsyncFnMut() -> bool) {
    let begin = Instant::now();
    while !holds().await {
        assert!(begin.elapsed() < SOON, "never: {what}");
        tokio::time::sleep(Duration::from_millis(100)).await;
    }
}

fn view_of(client: &Client) -> View {
    let camera = client.description().cameras[0].camera;
    let (outputs, plan) = (Outputs::COLOR, PlanRequest::default());
    View { camera, width: 48, height: 32, outputs, plan, pin: None, flow_to: None, rays: None }
}

/// The next frame of a session.
async fn frame(session: &mut Session, view: &View) {
    let frame = async {
        loop {
            session.send(view);
            match session.next().await.expect("the session is open") {
                SessionEvent::Frame { .. } => return,
                // Workers are still starting.
                SessionEvent::Failed { .. } => tokio::time::sleep(Duration::from_millis(200)).await,
            }
        }
    };
    tokio::time::timeout(PATIENCE, frame).await.expect("a frame comes");
}

/// A new certificate of the same authority, with the same names.
fn renewed(folder: &Path) -> [String; 2] {
    let read = |file: &str| std::fs::read_to_string(folder.join(file)).unwrap();
    let key = KeyPair::from_pem(&read("ca.key")).unwrap();
    // The issuer's name is all that a certificate has of it.
    let mut authority = CertificateParams::new(Vec::new()).unwrap();
    authority.distinguished_name.push(rcgen::DnType::CommonName, "Argus cluster authority");
    let issuer = Issuer::new(authority, key);
    let names = ["cluster.argus.internal", "localhost", "127.0.0.1"].map(str::to_owned);
    let pair = KeyPair::generate().unwrap();
    let signed = CertificateParams::new(names).unwrap().signed_by(&pair, &issuer).unwrap();
    [signed.pem(), pair.serialize_pem()]
}

#[tokio::test(flavor = "multi_thread")]
async fn a_new_token_works_and_an_old_one_is_refused_while_open_sessions_go_on() {
    let service = Service::start();
    let (old, admin) = (service.read("view.token"), service.read("admin.token"));
    let client = service.connect(&old).await.unwrap();
    let (mut session, view) = (client.session(SessionOptions::default()), view_of(&client));
    frame(&mut session, &view).await;

    let new = "a-new-token-of-the-tests-0123456789";
    let tokens = service.read("tokens");
    service.write("tokens", &tokens.replace(old.trim(), new));
    soon("the new token works", async || service.connect(new).await.is_ok()).await;
    assert!(service.connect(&old).await.is_err(), "the old token is refused");
    assert!(client.describe().await.is_err(), "and so it is on an open connection");
    frame(&mut session, &view).await;
    assert_eq!(service.metric(admin.trim(), "argus_credentials_reloads_total{outcome=\"loaded\"}"), 1.0);

    // A bad file changes nothing, and is told; so is the end of the trouble.
    let refused = |admin: &str| service.metric(admin.trim(), "argus_credentials_refused");
    assert_eq!(refused(&admin), 0.0);
    for bad in ["", "view shop", "root shop a-token-of-the-tests-0123456789"] {
        service.write("tokens", bad);
        soon("the bad file is told", async || refused(&admin) == 1.0).await;
        assert!(service.connect(new).await.is_ok(), "the token before it works: {bad:?}");
        service.write("tokens", &tokens.replace(old.trim(), new));
        soon("the file is good again", async || refused(&admin) == 0.0).await;
    }
    frame(&mut session, &view).await;
    // The session's frames are counted by the name of its token.
    let answered = "argus_client_views_total{client=\"viewer\",outcome=\"answered\"}";
    assert!(service.metric(admin.trim(), answered) >= 3.0);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_new_certificate_is_served_to_new_connections_by_all_and_a_bad_pair_to_none() {
    let service = Service::start();
    let admin = service.read("admin.token");
    let operator = service.connect(&admin).await.unwrap();
    let (mut session, view) = (operator.session(SessionOptions::default()), view_of(&operator));
    frame(&mut session, &view).await;
    let worker = operator.status().await.unwrap().workers[0].address.clone();
    let all = || [&service.url, &service.page, &worker].map(|url| service.served(url));
    let before = all();
    let [certificate, key] = renewed(service.folder.path());

    // The certificate without its key, as in the middle of a renewal.
    service.write("server.pem", &certificate);
    let refused = || service.metric(admin.trim(), "argus_credentials_refused");
    soon("the half pair is told", async || refused() == 1.0).await;
    assert_eq!(all(), before);
    assert!(service.connect(&admin).await.is_ok());

    service.write("server.key", &key);
    let new = CertificateDer::from_pem_slice(certificate.as_bytes()).unwrap();
    soon("all serve it", async || all().iter().all(|served| *served == new)).await;
    soon("no refusal is left", async || refused() == 0.0).await;
    // The connections from before go on, and processes reach each other over new ones.
    frame(&mut session, &view).await;
    let client = service.connect(&admin).await.unwrap();
    client.render(&view, &Default::default()).await.unwrap();
    let ends = "argus_certificate_expiry_timestamp_seconds{certificate=\"own\"}";
    // The year 4096, which rcgen gives a certificate without an end of its own.
    assert!(service.metric(admin.trim(), ends) > 60e9);
}
