//! Quality models: from the features of a request to a plan and a prediction.
//!
//! A [`Model`] holds the calibration of one scene, rig and device: the cost of each [`Setting`], and how far its
//! frames are from the reference. Studies write it and the coordinator reads it. Here it is used without reading a
//! clock, a file or a pixel.
//!
//! *Cost* is linear in the pixels of the view, per setting, and corrected by measured costs of frames ([`Pace`]).
//!
//! *Error* (mean FLIP against the reference, 67 pixels a degree) is predicted twice in the same way: by a ridge
//! regression of its logarithm ([`Regression`]), whose upper quantile comes from the residual of each calibration
//! view when it is left out. That is the jackknife+ in its simple form (Barber, Candès, Ramdas, Tibshirani,
//! *Predictive inference with the jackknife+*, Annals of Statistics 2021, section 1.2). It assumes no distribution of
//! errors, only that calibration views and requests are drawn alike. A request outside of the calibrated range is
//! less certain, by its distance.
//!
//! 1. *Before* a frame, from its [`Situation`]: the place of the view among the sample cameras, their sampling
//!    density of what it shows, its place in the scene.
//! 2. *After* a frame, also from what is [`Observed`] in it: the detail of the image, the share of pixels that no
//!    sample saw, the share that a second sample confirms, the residuals. This is much sharper, and it informs about all
//!    other settings, too: how much an image aliases depends on what it shows.
//!
//! A bound on the error is kept by trying ([`choose`]). The setting with the least expected total cost is rendered,
//! including the cost of what follows a rejection. If the frame's own upper quantile exceeds the bound, the frame is
//! rejected, and the search goes on with what it showed. Each choice is Weitzman's box with one step of lookahead
//! (*Optimal search for the best alternative*, Econometrica 1979).

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

/// The share of views for which the predicted error is an upper bound, and so for which promised bounds are kept.
/// Choosing among settings favours underestimated ones, but most accepted frames lie well below their bound. `argus
/// study bounds` counts how many keep it: at least 99 of 100 for `terrain:500000`.
pub const CONFIDENCE: f64 = 0.95;
