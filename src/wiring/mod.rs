//! Joins the crates. The cluster asks for scenes and roles through its own traits and knows neither file formats nor
//! GPUs; these are the implementations.

mod alone;
mod methods;
mod opener;
mod roles;
mod source;

pub use alone::Alone;
pub(crate) use alone::epoch_of;
pub(crate) use opener::SceneFolder;
pub(crate) use roles::Device;
pub(crate) use source::OpenScene;
