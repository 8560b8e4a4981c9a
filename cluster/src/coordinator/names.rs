//! Names of a scene's instances and materials, which ids of pixels count, and of its nodes.

use argus_proto::convert::WireEnum;
use argus_proto::v1;
use argus_scene::{InvalidField, Output, Scene};

/// Names of one answer.
const MOST: usize = 1024;

/// Bytes of a name.
const LONGEST: usize = 256;

/// The part of a list of names that a request asks for.
///
/// # Errors
/// [`InvalidField`] for an output that has no names, or a first id beyond the list.
pub(super) fn part(scene: &Scene, request: v1::NamesRequest) -> Result<v1::NamesResponse, InvalidField> {
    if request.nodes {
        return listed(scene.nodes.len(), request.first, |at| short(&scene.nodes[at].name));
    }
    let output = Output::from_number(request.output, "output")?;
    let of_instance = |at: usize| &scene.meshes[scene.instances[at].mesh as usize].name;
    let (total, name): (usize, &dyn Fn(usize) -> String) = match output {
        Output::Instance => (scene.instances.len(), &|at| short(of_instance(at))),
        Output::Material => (scene.materials.len(), &|at| short(&scene.materials[at].name)),
        other => {
            return Err(InvalidField::new(
                "output",
                format!("must be instance or material, not {}", other.name()),
            ));
        }
    };
    listed(total, request.first, name)
}

/// Names from the first one on, as many as one answer has.
///
/// # Errors
/// The first one is beyond the list.
fn listed(
    total: usize,
    first: u32,
    name: impl Fn(usize) -> String,
) -> Result<v1::NamesResponse, InvalidField> {
    let first = first as usize;
    if first > total {
        return Err(InvalidField::new("first", format!("must be at most {total}, not {first}")));
    }
    let names = (first..total.min(first + MOST)).map(name).collect();
    Ok(v1::NamesResponse { names, total: u32::try_from(total).unwrap_or(u32::MAX) })
}

/// The beginning of a name.
fn short(name: &str) -> String {
    name[..name.floor_char_boundary(LONGEST)].to_owned()
}

#[cfg(test)]
mod tests {
    use argus_scene::{Instance, Material, Mesh};

    use super::*;

    #[test]
    fn names_come_in_parts_of_a_bounded_size() {
        let named = |i: usize| Material { name: format!("{i}-{}", "ü".repeat(200)), ..Material::default() };
        let mesh = Mesh { name: "box".to_owned(), ..Mesh::default() };
        let instance = Instance { mesh: 0, node: None, world_from_mesh: glam::DAffine3::IDENTITY };
        let scene = Scene {
            materials: (0..1500).map(named).collect(),
            meshes: vec![mesh],
            instances: vec![instance; 2],
            ..Scene::default()
        };
        let ask = |output: Output, first| {
            part(&scene, v1::NamesRequest { output: output.number(), first, nodes: false })
        };
        let [head, tail] = [0, 1024].map(|first| ask(Output::Material, first).unwrap());
        assert_eq!([head.names.len(), tail.names.len()], [1024, 476]);
        assert!(tail.names[0].starts_with("1024-") && head.names.iter().all(|name| name.len() <= LONGEST));
        assert_eq!((head.total, tail.total), (1500, 1500));
        let instances = ask(Output::Instance, 0).unwrap();
        assert_eq!((instances.names, instances.total), (vec!["box".to_owned(); 2], 2));
        assert!(ask(Output::Instance, 2).unwrap().names.is_empty());
        assert_eq!(ask(Output::Instance, 3).unwrap_err().field, "first");
        assert_eq!(ask(Output::Color, 0).unwrap_err().field, "output");
        let nodes = part(&scene, v1::NamesRequest { nodes: true, ..v1::NamesRequest::default() }).unwrap();
        assert_eq!((nodes.names.len(), nodes.total), (0, 0), "it has no nodes");
        let unspecified = part(&scene, v1::NamesRequest::default()).unwrap_err();
        assert_eq!(unspecified.field, "output");
    }
}
