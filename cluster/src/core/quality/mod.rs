//! Requests that state what they want: from the features of a request to a plan and a prediction.
//!
//! A [`Model`] is what calibration measured of one scene, rig and device: for each [`Setting`] that a view can
//! be answered with, what it costs and how far its frames are from the reference. It is written by studies,
//! read by the coordinator, and used here without reading a clock, a file or a pixel.
//!
//! *Cost* is linear in the pixels of the view, per setting, and corrected by what frames are seen to cost
//! ([`Pace`]).
//!
//! *Error* (mean FLIP against the reference, 67 pixels a degree) is predicted twice by the same means, a ridge
//! regression of its logarithm ([`Regression`]) whose upper quantile comes from the residuals that each
//! calibration view has when it is left out. That is the jackknife+ in its simple form (Barber, Candès,
//! Ramdas, Tibshirani, *Predictive inference with the jackknife+*, Annals of Statistics 2021, section 1.2):
//! it asks of the errors no distribution, only that calibration and requests are drawn alike; a request
//! outside of what was calibrated is less certain by as far as it lies outside.
//!
//! 1. *Before* a frame, from its [`Situation`]: where the view stands among the sample cameras, how densely
//!    they saw what it looks at, where in the scene it is.
//! 2. *After* a frame, from what is [`Observed`] in it as well: how much detail the image has, how many pixels
//!    no sample saw, how many a second sample agrees with, how large the residuals are. This is much sharper,
//!    and it speaks of all other settings too: how much an image aliases depends on what it shows.
//!
//! A bound on the error is kept by trying ([`choose`]): a setting is rendered whose cost, with the cost of what
//! follows if its frame is not good enough, is least; if the frame's own quantile exceeds the bound it is
//! thrown away and the search goes on with what it told. Each choice is Weitzman's box with one step of
//! lookahead (*Optimal search for the best alternative*, Econometrica 1979).

pub mod choose;
mod model;
mod observed;
mod pace;
mod regression;
mod setting;
mod situation;
#[cfg(test)]
pub(in crate::core) mod tests;

pub use model::{After, Answer, Calibrated, Cost, MODEL_VERSION, Model, Trial};
pub use observed::Observed;
pub use pace::Pace;
pub use regression::Regression;
pub use setting::Setting;
pub use situation::Situation;

/// The share of views for which the predicted error is an upper bound: that of bounds which are promised to be kept. Choosing
/// among several settings favours those whose error is underestimated, but most frames that are accepted lie well below
/// their bound: `argus study bounds` counts how many keep it, 99 of 100 at least above `terrain:500000`.
pub const CONFIDENCE: f64 = 0.95;
