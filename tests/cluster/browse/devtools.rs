//! Chromium without a window, driven over its DevTools protocol.

use std::io::{BufRead, BufReader};
use std::net::TcpStream;
use std::process::{Child, Command, Stdio};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use base64::Engine as _;
use image::RgbImage;
use serde_json::{Value, json};
use tungstenite::{Message, WebSocket};

use crate::support::PATIENCE;

/// Held by the browser that runs. One alone keeps two cores busy, since it draws on them, too.
static ALONE: Mutex<()> = Mutex::new(());

/// A browser; it ends when dropped. There is one at a time.
pub(crate) struct Browser {
    _alone: MutexGuard<'static, ()>,
    child: Child,
    socket: WebSocket<TcpStream>,
    commands: u64,
    /// The browser's profile.
    _folder: tempfile::TempDir,
}

/// A page in the browser.
pub(crate) struct Tab(String);

impl Browser {
    pub(crate) fn start() -> Self {
        // A test that failed has ended its browser, too.
        let alone = ALONE.lock().unwrap_or_else(PoisonError::into_inner);
        let folder = tempfile::tempdir().unwrap();
        let mut child = Command::new("chromium")
            // Its sandbox needs rights that containers lack; it loads only our page.
            .args([
                "--headless=new",
                "--no-sandbox",
                "--disable-gpu",
                "--disable-dev-shm-usage",
                "--no-first-run",
            ])
            .args(["--remote-debugging-port=0", "--window-size=1280,900"])
            .arg(format!("--user-data-dir={}", folder.path().display()))
            .arg("about:blank")
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut lines = BufReader::new(child.stderr.take().unwrap()).lines();
        let address = lines
            .find_map(|line| line.unwrap().strip_prefix("DevTools listening on ").map(str::to_owned))
            .expect("Chromium prints its address");
        // Its further output must be read.
        std::thread::spawn(move || lines.for_each(drop));
        let authority = address.strip_prefix("ws://").unwrap().split('/').next().unwrap();
        let stream = TcpStream::connect(authority).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        let (socket, _) = tungstenite::client(address.as_str(), stream).unwrap();
        Self { _alone: alone, child, socket, commands: 0, _folder: folder }
    }

    /// Sends a command to a tab or to the browser, and waits for its result.
    fn command(&mut self, tab: Option<&Tab>, method: &str, parameters: Value) -> Value {
        self.commands += 1;
        let mut command = json!({ "id": self.commands, "method": method, "params": parameters });
        if let Some(Tab(session)) = tab {
            command["sessionId"] = json!(session);
        }
        self.socket.send(Message::text(command.to_string())).unwrap();
        loop {
            let Message::Text(text) = self.socket.read().unwrap() else { continue };
            let answer: Value = serde_json::from_str(&text).unwrap();
            if answer["id"] == self.commands {
                assert!(answer["error"].is_null(), "{method}: {answer}");
                return answer["result"].clone();
            }
        }
    }

    /// Opens a page after running `first` in it.
    pub(crate) fn open(&mut self, address: &str, first: &str) -> Tab {
        let target = self.command(None, "Target.createTarget", json!({ "url": "about:blank" }));
        let attach = json!({ "targetId": target["targetId"], "flatten": true });
        let attached = self.command(None, "Target.attachToTarget", attach);
        let tab = Tab(attached["sessionId"].as_str().unwrap().to_owned());
        self.command(Some(&tab), "Page.enable", json!({}));
        self.command(Some(&tab), "Page.addScriptToEvaluateOnNewDocument", json!({ "source": first }));
        self.command(Some(&tab), "Page.navigate", json!({ "url": address }));
        tab
    }

    /// What the page's canvas shows at its pose.
    pub(crate) fn picture(&mut self, tab: &Tab) -> RgbImage {
        let address = self.value(tab, "argus.picture()");
        png(address.as_str().unwrap())
    }

    /// The value of an expression in a page; of a promise, once there is one.
    pub(crate) fn value(&mut self, tab: &Tab, expression: &str) -> Value {
        let parameters = json!({ "expression": expression, "returnByValue": true, "awaitPromise": true });
        let result = self.command(Some(tab), "Runtime.evaluate", parameters);
        assert!(result["exceptionDetails"].is_null(), "{expression}: {result}");
        result["result"]["value"].clone()
    }

    /// Waits until an expression, which must not throw, is true.
    pub(crate) fn wait_until(&mut self, tab: &Tab, expression: &str) {
        let deadline = Instant::now() + PATIENCE;
        while self.value(tab, expression) != true {
            let says = "document.getElementById('error')?.textContent";
            assert!(Instant::now() < deadline, "not in time: {expression}; {}", self.value(tab, says));
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    /// Presses or releases a letter's key.
    pub(crate) fn key(&mut self, tab: &Tab, letter: char, down: bool) {
        let kind = if down { "keyDown" } else { "keyUp" };
        let code = format!("Key{}", letter.to_ascii_uppercase());
        let parameters = json!({ "type": kind, "key": letter.to_string(), "code": code });
        self.command(Some(tab), "Input.dispatchKeyEvent", parameters);
    }
}

/// The image of a `data:` address of a PNG.
pub(crate) fn png(address: &str) -> RgbImage {
    let encoded = address.strip_prefix("data:image/png;base64,").unwrap();
    let bytes = base64::engine::general_purpose::STANDARD.decode(encoded).unwrap();
    image::load_from_memory(&bytes).unwrap().to_rgb8()
}

impl Drop for Browser {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
