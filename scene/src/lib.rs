//! The vocabulary of Argus, and the loaders and generators of scenes.
//!
//! Every other crate uses these types: a [`Scene`] is sampled into a [`SampleSet`], from which views are reconstructed as
//! [`Frame`]s. Without features this crate is only the vocabulary, so that a thin client compiles little. `loaders`,
//! `procedural` and `reference` add file formats, generated scenes and the CPU ray tracer that every image is
//! judged against.
//!
//! Conventions: right-handed, y up, metres, radians unless a name says `deg`; positions, cameras and
//! transforms are `f64`, vertices are `f32` about an `f64` origin of their own mesh. Matrices are named for
//! both ends, `b_from_a`, and columns are applied to column vectors. Pixel centres lie at half integers, row
//! 0 is the top. Range is the Euclidean distance from the eye; samples store its inverse, 0 for sky.

pub mod animation;
mod bounds;
pub mod camera;
mod cell_pages;
mod closest;
mod default_camera;
pub mod deformation;
pub mod derived;
mod detail;
mod distortion;
pub mod effects;
pub mod emitters;
pub mod environment;
mod environment_map;
pub mod error;
pub mod exposure;
pub mod extent;
mod faces;
pub mod frame;
mod frame_source;
pub mod history;
pub mod indirect;
mod lens;
pub mod light;
mod light_choice;
mod light_effects;
mod light_level;
pub mod light_sampling;
pub mod material;
pub mod paraboloid;
pub mod particles;
pub mod path;
mod plan;
mod pose;
mod probe_map;
mod ray_list;
pub mod reflection;
pub mod revisions;
pub mod rgb9e5;
pub mod rig;
pub mod role;
pub mod sample;
mod sample_id;
mod sampling;
pub mod scene;
pub mod shading;
mod specification;
mod stage;
mod surface_light;
pub mod texture;
pub mod tone;
pub mod transforms;
pub mod transparency;
pub mod view;
mod visibility;

#[cfg(feature = "loaders")]
pub mod load;
#[cfg(feature = "reference")]
pub mod metrics;
#[cfg(feature = "mitsuba")]
pub mod mitsuba;
#[cfg(all(feature = "loaders", feature = "procedural"))]
mod open;
mod output;
#[cfg(feature = "procedural")]
pub mod procedural;
#[cfg(feature = "reference")]
pub mod reference;

pub use bounds::Bounds;
pub use camera::{Camera, OmniLayout, SampleCamera};
pub use cell_pages::{CellContent, CellPage, CellPages};
pub use closest::closest_on_triangle;
pub use detail::Detail;
pub use distortion::Distortion;
pub use effects::{EffectPlan, EffectRequest, Effects, ReflectionRequest};
pub use environment::Environment;
pub use environment_map::{EnvironmentMap, Patch};
pub use error::{InvalidField, RenderError};
pub use exposure::{Exposure, Metering};
pub use faces::{FaceMask, FaceMasks};
pub use frame::{Frame, Prediction, Provenance, Served};
pub use history::History;
pub use indirect::{CellSettings, Indirect, MapSource, PathSettings, PointSettings, VplSettings};
pub use lens::{ImagePlane, Intrinsics, Lens};
pub use light::{Light, Lighting, Sky};
pub use light_choice::{AddedLight, LightChoice, LightRequest};
pub use light_effects::LightEffects;
pub use light_level::LightLevel;
#[cfg(feature = "loaders")]
pub use load::LoadError;
pub use material::{AlphaMode, Material, Texture, TextureRef};
#[cfg(all(feature = "loaders", feature = "procedural"))]
pub use open::{base_of, in_environment, is_procedural, open, split_environment, with_additions};
pub use output::{Channel, FrameDigest, Images, Output, OutputFormat, Outputs};
pub use plan::{FrameSource, Holes, Plan, Search, Warp};
pub use pose::Pose;
pub use ray_list::RayList;
pub use reflection::{ProbeEye, ProbeSource, ReflectionCost, ReflectionProbeSet, Reflections, Reflector};
pub use revisions::{Revisions, Transforms};
pub use rig::{Rig, RigSettings};
pub use role::{Cancel, Compositor, PixelJob, Pixels, SampleJob, Sampler, ViewJob};
pub use sample::{Plane, PlaneData, PlaneFormat, PlaneKind, Sample, SampleSet, SampleSetInfo};
pub use sample_id::{SampleId, SceneState, Version};
pub use sampling::{MegaViews, Sampling};
pub use scene::{Effect, Instance, Mesh, RigKind, Scene, SceneHash};
pub use specification::{Difference, Specification, SpecificationHash, check_sub_samples};
pub use stage::Stage;
pub use surface_light::{CellReport, SurfaceLight};
pub use view::{Limits, PlanRequest, Preset, View};
pub use visibility::Visibility;
