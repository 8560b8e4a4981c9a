//! Every GPU program of Argus, linked at build time.
