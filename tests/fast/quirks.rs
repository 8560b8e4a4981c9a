//! Oddities of drivers: programs name those that they work around, and `gpu/src/quirks.rs` explains them.

use std::collections::BTreeSet;

use argus_gpu::quirks::{ALL, Quirk};

use crate::dependency_rules::{files, is_shader, root};

/// The names that follow `Quirk: ` in a text.
fn named(text: &str) -> impl Iterator<Item = String> {
    let names = text.split("Quirk: ").skip(1);
    names.map(|rest| {
        rest.split(|c: char| !(c.is_ascii_lowercase() || c == '-')).next().unwrap_or_default().to_owned()
    })
}

#[test]
fn programs_name_the_quirks_that_they_work_around() {
    let programs = files().into_iter().filter(|path| is_shader(path));
    let texts = programs.map(|path| std::fs::read_to_string(root().join(path)).unwrap());
    let named: BTreeSet<String> = texts.flat_map(|text| named(&text).collect::<Vec<_>>()).collect();
    let listed = ALL.iter().filter(|quirk| quirk.in_wgsl).map(|quirk| quirk.name.to_owned());
    assert_eq!(named, listed.collect::<BTreeSet<_>>());
}

#[test]
fn each_quirk_has_a_name_of_its_own_and_an_explanation() {
    let names: BTreeSet<&str> = ALL.iter().map(|quirk| quirk.name).collect();
    assert_eq!(names.len(), ALL.len());
    for Quirk { name, happens, measured, around, until, .. } in ALL {
        for text in [happens, measured, around, until] {
            assert!(text.ends_with('.'), "{name}: {text:?} is no sentence");
        }
    }
}
