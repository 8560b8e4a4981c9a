//! Rust mirrors of WGSL structs. A test compares the name, offset and size of every field, and the size of every struct,
//! with the WGSL.

/// Declares a `#[repr(C)]` plain-old-data struct and its [`Mirror`].
#[macro_export]
macro_rules! mirror {
    ($(#[$meta:meta])* pub struct $name:ident { $($(#[$field_meta:meta])* pub $field:ident: $ty:ty,)* }) => {
        $(#[$meta])*
        #[repr(C)]
        #[derive(Debug, Clone, Copy, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
        pub struct $name { $($(#[$field_meta])* pub $field: $ty,)* }

        impl $name {
            /// What the layout test compares with the WGSL.
            pub const MIRROR: $crate::layout::Mirror = $crate::layout::Mirror {
                name: stringify!($name),
                size: size_of::<$name>(),
                fields: &[$((stringify!($field), core::mem::offset_of!($name, $field)),)*],
            };
        }
    };
}

/// Mirrors of the compositor's structs.
pub mod compositor;
/// Mirrors of the structs of hierarchies and traversals.
pub mod gpu;
mod mirror;
/// Mirrors of the sampler's structs.
pub mod sampler;
/// Mirrors of structs in `shared/` that both roles use.
pub mod shared;
/// Mirrors of the sampler's structs of light of cells, emitters and surfaces.
pub mod surface_light;

pub use mirror::Mirror;

/// All mirrors, for the test. A mirror that is missing here is not tested.
pub const MIRRORS: &[&[Mirror]] =
    &[shared::MIRRORS, gpu::MIRRORS, sampler::MIRRORS, surface_light::MIRRORS, compositor::MIRRORS];
