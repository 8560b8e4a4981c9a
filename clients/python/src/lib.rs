//! The native module of the Python package `argus_render`: [`argus_client`] for numpy.
//!
//! The module is private to the package, which checks arguments, knows conventions of cameras, and allocates arrays.
//! Here are connections, retries, sessions and the codec. Every wait releases the interpreter's lock.

mod client;
mod error;
mod images;
mod report;
mod runtime;
mod session;
mod transforms;
mod wanted;

/// `argus_render._native`.
#[pyo3::pymodule]
mod _native {
    #[pymodule_export]
    use crate::client::Client;
    #[pymodule_export]
    use crate::images::outputs;
    #[pymodule_export]
    use crate::session::Session;
}
