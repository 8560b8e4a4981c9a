//! What must hold of all programs, by reflection.

mod bare_uniforms;
mod programs;
mod workgroup_memory;
