//! Moving nodes of the scene.

use argus_proto::convert::rows_of;
use argus_proto::v1;
use argus_scene::InvalidField;
use glam::DAffine3;

use crate::{Client, ClientError};

/// Most nodes of a request.
pub const MOST_NODES: usize = 2048;

/// Most setters that are asked for at once.
const PART: usize = 1024;

/// A node of the scene.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Node {
    /// Its index in [`Client::node_names`].
    Index(u32),
    /// Its name, which no other node has.
    Name(String),
}

/// What the matrix of a node leads to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Space {
    /// The space of its parent; the world for a node without one.
    #[default]
    Parent,
    /// The world.
    World,
}

/// A node and its new transform.
#[derive(Debug, Clone, PartialEq)]
pub struct SetTransform {
    /// The node.
    pub node: Node,
    /// From the node to `space`, metres; `None`: the file's transform again.
    pub matrix: Option<DAffine3>,
    /// What `matrix` leads to.
    pub space: Space,
}

/// The state of the nodes' transforms after a request.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Moved {
    /// Its number, which is in the provenance of frames that show it; 0: as in the file.
    pub revision: u64,
    /// Samples of the version before that workers hold. Views that need them wait for new ones, or are rendered from triangles.
    pub stale_samples: u64,
    /// Pages of light cells that workers hold, and of which they find out which ones the movers touch.
    pub pages_to_check: u64,
    /// Nodes whose transform is not that of the file.
    pub movers: u32,
}

/// Who set the transform of a node last.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NodeSetter {
    /// Index of the node.
    pub node: u32,
    /// Revision since which its transform is there.
    pub revision: u64,
    /// Name of the client's token, or else its address.
    pub client: String,
}

impl Client {
    /// Sets the transforms of nodes, all at one moment. Views that are requested after the answer show them. With `expected` nothing
    /// moves if that is no longer the newest revision. A request is not repeated: after an error of the connection ask for the
    /// revision, by an empty list of nodes.
    ///
    /// # Errors
    /// [`ClientError::Invalid`] for a node or a matrix that cannot be used, [`ClientError::Refused`] if this client's token lacks
    /// the role author, [`ClientError::Server`] with the code `FAILED_PRECONDITION` if another client was first.
    pub async fn set_transforms(
        &self,
        nodes: &[SetTransform],
        expected: Option<u64>,
    ) -> Result<Moved, ClientError> {
        if nodes.len() > MOST_NODES {
            let reason = format!(
                "must be at most {MOST_NODES}, not {}; send the rest in further requests",
                nodes.len()
            );
            let InvalidField { field, reason } = InvalidField::new("nodes", reason);
            return Err(ClientError::Invalid { field: field.to_owned(), reason });
        }
        let request = v1::SetTransformsRequest {
            nodes: nodes.iter().map(wire).collect(),
            expected_revision: expected,
            ..v1::SetTransformsRequest::default()
        };
        let v1::SetTransformsResponse { revision, stale_samples, pages_to_check, movers, .. } =
            self.views().set_transforms(request).await?.into_inner();
        Ok(Moved { revision, stale_samples, pages_to_check, movers })
    }

    /// Who set each node last, by index.
    ///
    /// # Errors
    /// Those of [`Client::set_transforms`].
    pub async fn node_setters(&self) -> Result<Vec<NodeSetter>, ClientError> {
        let (mut all, mut views, mut first_setter): (Vec<NodeSetter>, _, u32) = (Vec::new(), self.views(), 0);
        loop {
            let request = v1::SetTransformsRequest {
                list_setters: true,
                first_setter,
                ..v1::SetTransformsRequest::default()
            };
            let part = views.set_transforms(request).await?.into_inner().setters;
            let is_last = part.len() < PART;
            let of = |v1::NodeSetter { node, revision, client }| NodeSetter { node, revision, client };
            all.extend(part.into_iter().map(of));
            match all.last() {
                Some(last) if !is_last => first_setter = last.node.saturating_add(1),
                _ => return Ok(all),
            }
        }
    }

    /// The names of the scene's nodes, by their indices. Some may be empty or equal.
    ///
    /// # Errors
    /// Those of [`Client::describe`].
    pub async fn node_names(&self) -> Result<Vec<String>, ClientError> {
        let (mut names, mut views) = (Vec::new(), self.views());
        loop {
            let first = u32::try_from(names.len()).unwrap_or(u32::MAX);
            let request = v1::NamesRequest { first, nodes: true, ..v1::NamesRequest::default() };
            let part = views.names(request).await?.into_inner();
            let is_last = part.names.is_empty();
            names.extend(part.names);
            if is_last || names.len() >= part.total as usize {
                return Ok(names);
            }
        }
    }
}

fn wire(set: &SetTransform) -> v1::SetTransform {
    let node = match &set.node {
        Node::Index(index) => v1::set_transform::Node::Index(*index),
        Node::Name(name) => v1::set_transform::Node::Name(name.clone()),
    };
    let space = match set.space {
        Space::Parent => v1::Space::Parent,
        Space::World => v1::Space::World,
    };
    v1::SetTransform {
        node: Some(node),
        matrix: set.matrix.as_ref().map(rows_of).unwrap_or_default(),
        space: space as i32,
    }
}
