//! Light: what shadows, sky and indirect light cost, and their error against the converged image.

mod cells;
pub mod effects;
pub mod equal_error;
pub mod indirect;
mod radiance;
pub mod shadows;
mod timed;
