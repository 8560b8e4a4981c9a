//! Generated scenes, the same triangles on every machine.
