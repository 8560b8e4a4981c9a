//! Light cells as a whole.
