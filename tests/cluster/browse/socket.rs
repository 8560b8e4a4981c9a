//! A page's WebSocket for tests: blocking, with time limits.

use std::io::ErrorKind;
use std::net::TcpStream;
use std::time::Duration;

use serde_json::{Value, json};
use tungstenite::client::IntoClientRequest;
use tungstenite::error::ProtocolError;
use tungstenite::handshake::HandshakeError;
use tungstenite::{Error, Message, WebSocket};

use super::Page;
use crate::support::PATIENCE;

/// A WebSocket to a page's server.
pub(crate) struct Socket(WebSocket<TcpStream>);

/// A message from the server, or its absence.
#[derive(Debug, PartialEq)]
pub(crate) enum Said {
    /// The description of an image, and the image with its relief.
    Image(Value, Vec<u8>),
    /// A text message.
    Text(Value),
    /// The WebSocket's end, with its code and reason.
    Closed(u16, String),
    /// No message within the time limit.
    Nothing,
}

impl Socket {
    /// Opens it like a program that is not a browser.
    pub(crate) fn open(page: &Page) -> Self {
        Self::open_as(page, None).unwrap()
    }

    /// Opens it like a page of an origin; returns the status if it is refused.
    pub(crate) fn open_as(page: &Page, origin: Option<&str>) -> Result<Self, u16> {
        let stream = TcpStream::connect(&page.address).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        let mut request = format!("ws://{}/session", page.address).into_client_request().unwrap();
        if let Some(origin) = origin {
            request.headers_mut().insert("origin", origin.parse().unwrap());
        }
        match tungstenite::client(request, stream) {
            Ok((socket, _)) => Ok(Self(socket)),
            Err(HandshakeError::Failure(Error::Http(response))) => Err(response.status().as_u16()),
            Err(error) => panic!("{error}"),
        }
    }

    /// Requests a small direct view of the scene's first camera.
    pub(crate) fn camera(&mut self, number: u64) {
        self.say(&json!({ "camera": number, "size": [160, 120], "direct": true }).to_string());
    }

    /// Acknowledges an image.
    pub(crate) fn shown(&mut self, number: u64) {
        self.say(&json!({ "shown": number }).to_string());
    }

    pub(crate) fn say(&mut self, text: &str) {
        self.0.send(Message::text(text)).unwrap();
    }

    /// [`Socket::say`] within a second; returns whether there was room for the message.
    pub(crate) fn try_say(&mut self, text: &str) -> bool {
        self.0.get_ref().set_write_timeout(Some(Duration::from_secs(1))).unwrap();
        self.0.send(Message::text(text)).is_ok()
    }

    pub(crate) fn say_bytes(&mut self, bytes: &[u8]) {
        self.0.send(Message::binary(bytes.to_vec())).unwrap();
    }

    /// Waits at most `time` for the next message.
    pub(crate) fn next_within(&mut self, time: Duration) -> Said {
        self.0.get_ref().set_read_timeout(Some(time)).unwrap();
        loop {
            match self.0.read() {
                Ok(Message::Text(text)) => return Said::Text(serde_json::from_str(&text).unwrap()),
                Ok(Message::Binary(bytes)) => {
                    let length = u32::from_le_bytes(bytes[..4].try_into().unwrap()) as usize;
                    let about = serde_json::from_slice(&bytes[4..4 + length]).unwrap();
                    return Said::Image(about, bytes[4 + length..].to_vec());
                }
                Ok(Message::Close(Some(close))) => {
                    return Said::Closed(close.code.into(), close.reason.to_string());
                }
                Ok(Message::Ping(_) | Message::Pong(_)) => {}
                Ok(other) => panic!("{other:?}"),
                Err(Error::Io(error))
                    if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) =>
                {
                    return Said::Nothing;
                }
                // The process ended before its last words were read. 1006 is the standard's code for that.
                Err(Error::Protocol(ProtocolError::ResetWithoutClosingHandshake)) => {
                    return Said::Closed(1006, String::new());
                }
                Err(Error::Io(error)) if error.kind() == ErrorKind::ConnectionReset => {
                    return Said::Closed(1006, String::new());
                }
                Err(error) => panic!("{error}"),
            }
        }
    }

    pub(crate) fn next(&mut self) -> Said {
        self.next_within(PATIENCE)
    }

    /// The camera's number and the size of the next image.
    pub(crate) fn image(&mut self) -> (u64, (u32, u32)) {
        match self.next() {
            Said::Image(about, jpeg) => {
                let image = image::load_from_memory_with_format(&jpeg, image::ImageFormat::Jpeg).unwrap();
                (about["camera_seq"].as_u64().unwrap(), (image.width(), image.height()))
            }
            other => panic!("no image: {other:?}"),
        }
    }
}
