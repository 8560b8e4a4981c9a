//! Transforms of the scene's nodes.

use argus_client::{Moved, Node, SetTransform, Space};
use argus_proto::convert::affine;
use pyo3::prelude::*;
use serde_json::json;

use crate::error::invalid;

/// A node as Python names it.
#[derive(FromPyObject)]
pub(crate) enum NodeKey {
    Index(u32),
    Name(String),
}

/// The nodes with their transforms.
///
/// # Errors
/// `InvalidField` for a matrix that is none.
pub(crate) fn sets(
    py: Python<'_>,
    nodes: Vec<NodeKey>,
    matrices: Vec<Option<Vec<f64>>>,
    world: bool,
) -> PyResult<Vec<SetTransform>> {
    let space = if world { Space::World } else { Space::Parent };
    let set = |(node, matrix): (NodeKey, Option<Vec<f64>>)| {
        let matrix = matrix.map(|numbers| affine(&numbers)).transpose();
        let matrix = matrix.map_err(|reason| invalid(py, "transforms", reason))?;
        let node = match node {
            NodeKey::Index(index) => Node::Index(index),
            NodeKey::Name(name) => Node::Name(name),
        };
        Ok(SetTransform { node, matrix, space })
    };
    nodes.into_iter().zip(matrices).map(set).collect()
}

/// The state after a request, as JSON.
pub(crate) fn report(moved: &Moved) -> String {
    let Moved { revision, stale_samples, pages_to_check, movers } = moved;
    json!({
        "revision": revision,
        "stale_samples": stale_samples,
        "pages_to_check": pages_to_check,
        "movers": movers,
    })
    .to_string()
}
