//! The CPU ray tracer that every image is judged against.
