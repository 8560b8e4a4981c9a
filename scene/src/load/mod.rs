//! Scene files: glTF 2.0, OBJ + MTL and PLY become a [`crate::Scene`].
