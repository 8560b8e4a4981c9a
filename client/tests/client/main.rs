//! The client against a server in the same process that is slow, breaks off, misbehaves or is gone.

#![allow(clippy::unwrap_used, reason = "clippy knows tests by their attribute, not the server they share")]

mod batch;
mod fake;
mod load;
mod session;
mod views;
