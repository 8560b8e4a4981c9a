//! Devices: how fast this machine's GPU and CPU do what a frame is made of.

pub mod campaign;
pub mod parts;
pub mod rays;
pub mod targets;
pub mod throughput;
pub mod visibility;
