//! What must hold of all programs, by reflection: for tests of the crates that have programs.

mod bare_uniforms;
mod workgroup_memory;

use crate::Program;
use crate::layout::Mirror;
use naga::{Module, TypeInner};

/// Panics unless programs are valid, structs have the layouts of their mirrors, no loop's end depends on uniforms alone, and memory
/// of workgroups is that of programs that were looked through, by label.
pub fn all(programs: &[&Program], mirrors: &[&[Mirror]], looked_through: &[&str]) {
    check_valid(programs);
    check_mirrors(programs, mirrors);
    bare_uniforms::check(programs);
    workgroup_memory::check_memory(programs, looked_through);
    workgroup_memory::check_subgroups(programs);
}

fn parse(program: &Program) -> Module {
    naga::front::wgsl::parse_str(program.source)
        .unwrap_or_else(|e| panic!("{}: {}", program.label, e.emit_to_string(program.source)))
}

/// Panics unless every program is valid and has an entry point.
fn check_valid(programs: &[&Program]) {
    use naga::valid::{Capabilities, ValidationFlags, Validator};
    assert!(!programs.is_empty());
    for program in programs {
        let module = parse(program);
        let mut validator = Validator::new(ValidationFlags::all(), Capabilities::all());
        validator.validate(&module).unwrap_or_else(|e| panic!("{}: {e:?}", program.label));
        assert!(!module.entry_points.is_empty(), "{} has no entry point", program.label);
    }
}

/// Panics unless mirrors have the names, offsets and sizes of their WGSL structs.
fn check_mirrors(programs: &[&Program], mirrors: &[&[Mirror]]) {
    for mirror in mirrors.iter().copied().flatten() {
        let mut found = false;
        for program in programs {
            let module = parse(program);
            for (_, ty) in module.types.iter() {
                let (Some(name), TypeInner::Struct { members, span }) = (&ty.name, &ty.inner) else {
                    continue;
                };
                if name != mirror.name {
                    continue;
                }
                found = true;
                let wgsl: Vec<(&str, usize)> = members
                    .iter()
                    .map(|m| (m.name.as_deref().expect("members have names"), m.offset as usize))
                    .collect();
                let rust: Vec<(&str, usize)> =
                    mirror.fields.iter().filter(|(name, _)| !name.starts_with('_')).copied().collect();
                assert_eq!(rust, wgsl, "fields of {name} in {}", program.label);
                assert_eq!(mirror.size, *span as usize, "size of {name} in {}", program.label);
            }
        }
        assert!(found, "no program declares struct {}", mirror.name);
    }
}
