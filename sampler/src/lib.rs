//! Scene to sample sets: visibility, then shading.
