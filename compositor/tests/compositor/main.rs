//! The compositor's passes on a device, against the reference and against each other.

mod common;

mod batches;
mod confidence;
mod extent;
mod faces;
mod frames;
mod radiance;
mod reprojection;
mod search_backends;
mod slices;
mod views;
