//! The table from errors of the client to exceptions of the package.

use argus_client::ClientError;
use pyo3::IntoPyObjectExt;
use pyo3::prelude::*;
use pyo3::types::PyTuple;

/// The exception of an error; or, if the package's exceptions cannot be had, the reason why.
pub(crate) fn exception(py: Python<'_>, error: &ClientError) -> PyErr {
    let message = error.to_string();
    let made = match error {
        ClientError::Invalid { field, reason } => make(py, "InvalidField", (field, reason)),
        ClientError::Address { reason, .. } => make(py, "InvalidField", ("url", reason)),
        ClientError::Overloaded { retry_after, .. } => {
            make(py, "Overloaded", (message, retry_after.map(|after| after.as_secs_f64())))
        }
        ClientError::Unreachable { .. } => make(py, "Unavailable", (message,)),
        ClientError::Server { .. } if error.is_transient() => make(py, "Unavailable", (message,)),
        ClientError::Server { .. } => make(py, "ServerError", (message,)),
        ClientError::Untrusted { .. } | ClientError::Refused { .. } => make(py, "NotAllowed", (message,)),
        ClientError::NotArgus { .. } | ClientError::Version { .. } => make(py, "Incompatible", (message,)),
        ClientError::Deadline { .. } => make(py, "TimedOut", (message,)),
        ClientError::Damaged(_) => make(py, "Damaged", (message,)),
    };
    made.unwrap_or_else(|other| other)
}

/// `InvalidField` of a request that was not sent.
pub(crate) fn invalid(py: Python<'_>, field: &str, reason: impl Into<String>) -> PyErr {
    make(py, "InvalidField", (field, reason.into())).unwrap_or_else(|other| other)
}

/// `ArgusError` itself, for what is no fault of the service.
pub(crate) fn misused(py: Python<'_>, message: &str) -> PyErr {
    make(py, "ArgusError", (message,)).unwrap_or_else(|other| other)
}

fn make<'py>(
    py: Python<'py>,
    class: &str,
    arguments: impl IntoPyObject<'py, Target = PyTuple>,
) -> PyResult<PyErr> {
    let arguments = arguments.into_bound_py_any(py)?.cast_into::<PyTuple>()?;
    Ok(PyErr::from_value(py.import("argus_render.errors")?.getattr(class)?.call1(arguments)?))
}
