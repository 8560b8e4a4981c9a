//! Fuzz targets for all readers of foreign bytes: messages, streams of chunks, packed images, scene files.
//!
//! A target is a function of bytes. It must return for any bytes, in time and memory proportional to its input. Its
//! corpus is valid inputs: messages and images are made by the code that writes them, so that the corpus is never
//! outdated; scene files are in `corpus/loaders`. An input is a valid one with some edits. `tests/fuzz.rs` runs each
//! target briefly in every test run. For ten minutes of one target:
//!
//! ```text
//! BOLERO_RANDOM_TEST_TIME_MS=600000 cargo test --release -p argus-fuzz --test fuzz frames
//! ```
//!
//! `./scripts/fuzz` does this for all targets. A failing input is shrunk and printed as its seed, which
//! `BOLERO_RANDOM_SEED` repeats. After the fix it becomes a test beside the fixed code.

pub mod cells;
pub mod chunks;
pub mod files;
pub mod images;
pub mod messages;
mod mutate;
pub mod sessions;

pub use mutate::{Edit, edited};
