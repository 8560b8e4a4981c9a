//! Joins the crates: the cluster asks for scenes and roles by its own traits, knowing neither file formats
//! nor a GPU, and these are what it is handed.

mod opener;
mod roles;
mod source;

pub(crate) use opener::SceneFolder;
pub(crate) use roles::Device;
pub(crate) use source::OpenScene;
