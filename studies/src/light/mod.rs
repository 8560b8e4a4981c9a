//! Light: what shadows, sky and indirect light cost, and their error against the converged image.

pub mod effects;
pub mod equal_error;
pub mod indirect;
mod radiance;
pub mod shadows;
