//! Every program is linked, valid and mirrored.

use argus_shaders::layout::MIRRORS;
use argus_shaders::{ALL, Program};
use naga::{Module, TypeInner};

fn parse(program: &Program) -> Module {
    naga::front::wgsl::parse_str(program.source)
        .unwrap_or_else(|e| panic!("{}: {}", program.label, e.emit_to_string(program.source)))
}

#[test]
fn every_program_is_valid_and_has_an_entry_point() {
    use naga::valid::{Capabilities, ValidationFlags, Validator};
    assert!(!ALL.is_empty());
    for program in ALL {
        let module = parse(program);
        let mut validator = Validator::new(ValidationFlags::all(), Capabilities::all());
        validator.validate(&module).unwrap_or_else(|e| panic!("{}: {e:?}", program.label));
        assert!(!module.entry_points.is_empty(), "{} has no entry point", program.label);
    }
}

#[test]
fn mirrors_have_the_names_offsets_and_sizes_of_their_wgsl_structs() {
    for mirror in MIRRORS.iter().copied().flatten() {
        let mut found = false;
        for program in ALL {
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
