//! Readback, hierarchies and maps of many views on a device.

mod hierarchy;
mod many_views;
mod readback;
