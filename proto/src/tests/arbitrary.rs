//! Proptest strategies for every type of the vocabulary that is sent between processes.

mod frames;
mod scenes;
mod views;

pub(crate) use frames::*;
pub(crate) use scenes::*;
pub(crate) use views::*;
