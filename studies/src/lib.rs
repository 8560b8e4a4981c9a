//! The experiments: accuracy against time, cluster load, the papers' figures.
