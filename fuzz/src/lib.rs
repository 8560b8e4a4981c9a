//! Fuzz targets for everything that reads bytes from elsewhere: messages, streams of chunks, packed images, scene files.
//!
//! A target is a function of bytes that must return, in time and in memory that follows from its input, whatever the bytes
//! are. Its corpus is valid inputs: those of the wire are made by the code that writes them, so that they never fall
//! behind it; scene files are in `corpus/loaders`. An input is one of them with some edits. `tests/fuzz.rs` runs each
//! target shortly with every test run; for ten minutes of one:
//!
//! ```text
//! BOLERO_RANDOM_TEST_TIME_MS=600000 cargo test --release -p argus-fuzz --test fuzz frames
//! ```
//!
//! (`./scripts/fuzz` says the same for all.) What fails is shrunk and printed as its seed, which
//! `BOLERO_RANDOM_SEED` repeats; fixed, it becomes a test beside what it was found in.

pub mod chunks;
pub mod files;
pub mod images;
pub mod messages;
mod mutate;
pub mod sessions;

pub use mutate::{Edit, edited};
