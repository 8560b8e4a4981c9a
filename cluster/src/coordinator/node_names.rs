//! Finds nodes of a scene by name or index.

use std::collections::HashMap;

use argus_proto::v1;
use argus_scene::{InvalidField, Scene};

/// Longest beginning of a name that an error repeats, bytes.
const SHOWN: usize = 64;

/// The nodes of a scene by name.
pub(super) struct NodeNames {
    names: Vec<String>,
    /// First node of each name, and how many have it.
    by_name: HashMap<String, (u32, usize)>,
}

impl NodeNames {
    pub(super) fn new(scene: &Scene) -> Self {
        let names: Vec<String> = scene.nodes.iter().map(|node| node.name.clone()).collect();
        let mut by_name: HashMap<String, (u32, usize)> = HashMap::new();
        for (at, name) in (0u32..).zip(&names).filter(|(_, name)| !name.is_empty()) {
            by_name.entry(name.clone()).or_insert((at, 0)).1 += 1;
        }
        Self { names, by_name }
    }

    /// The index of the node that a client names.
    ///
    /// # Errors
    /// No node or several are meant.
    pub(super) fn find(&self, node: Option<&v1::set_transform::Node>) -> Result<u32, InvalidField> {
        use v1::set_transform::Node;
        let total = self.names.len();
        if total == 0 {
            let reason = "this scene has no nodes that could be moved: glTF files (.glb, .gltf) have them, .obj and .ply \
                          do not";
            return Err(InvalidField::new("nodes", reason));
        }
        match node {
            None => Err(InvalidField::new("nodes.node", "give each node's index or its name")),
            Some(Node::Index(index)) if (*index as usize) < total => Ok(*index),
            Some(Node::Index(index)) => {
                let reason = format!("there is no node {index}; the scene has nodes 0 to {}", total - 1);
                Err(InvalidField::new("nodes.index", reason))
            }
            Some(Node::Name(name)) => match self.by_name.get(name) {
                Some((index, 1)) => Ok(*index),
                Some((first, count)) => {
                    let reason = format!(
                        "{count} nodes are named {:?}, the first is {first}; give the index",
                        short(name)
                    );
                    Err(InvalidField::new("nodes.name", reason))
                }
                None => {
                    let reason =
                        format!("there is no node {:?}; Names lists the nodes of the scene", short(name));
                    Err(InvalidField::new("nodes.name", reason))
                }
            },
        }
    }

    /// A node as errors name it: its index, and its name if it has one.
    pub(super) fn shown(&self, index: u32) -> String {
        match self.names.get(index as usize).filter(|name| !name.is_empty()) {
            Some(name) => format!("{index} {:?}", short(name)),
            None => index.to_string(),
        }
    }
}

/// The beginning of a name.
fn short(name: &str) -> &str {
    &name[..name.floor_char_boundary(SHOWN)]
}
