//! What both roles need of a GPU: device, pass calls, timings, readback.
