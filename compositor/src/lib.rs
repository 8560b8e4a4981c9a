//! Sample sets to frames: depth-corrected inverse warping.
