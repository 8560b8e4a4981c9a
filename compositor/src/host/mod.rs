//! The splat search on the processor, for views that are warped from frames.
//!
//! A frame is one pinhole image without gloss, and it is in memory. On a software driver its warp by compute programs takes four
//! times as long: the driver gathers words one by one, every pass of every view has bindings and a dispatch, and the images are
//! uploaded first and read back later. Here a view is computed row by row, eight pixels at a time, and nothing is uploaded.
//! Frames of a plan may differ in size, which layers of one texture array cannot. So views from frames of several sizes are
//! computed here on every device.
//!
//! The method is that of the programs in `shaders/compositor/`, with their inputs; each file here names its program. All
//! arithmetic is in f32 by operations that every processor rounds alike, so the bytes of a view depend on its plan alone.
//!
//! | file | step |
//! |---|---|
//! | [`source`] | a frame as planes in memory, with its mip levels and the bounds of its tiles |
//! | [`splat`] | texels leave their depth in cells of the view |
//! | [`fill`] | gaps between cells of one surface are filled |
//! | [`lookup`] | a point is looked up in a frame: the depth-corrected fetch |
//! | [`warp`] | a row of pixels, eight at a time |
//! | [`second`] | the pixels that this did not settle |
//! | [`colors`] | their colours, from the places that were found |
//! | [`compose`] | all of these, in bands of rows |

mod colors;
mod compose;
mod fill;
mod lookup;
mod second;
mod source;
mod splat;
mod view;
mod warp;

pub(crate) use source::HostFrame;
pub(crate) use view::{HostInputs, HostSource};
