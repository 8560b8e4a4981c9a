//! What must hold of all programs, by reflection.

use argus_shaders::layout::MIRRORS;
use argus_shaders::{ALL, checks};

#[test]
fn programs_are_valid_and_mirrored_and_keep_the_rules_of_all_programs() {
    checks::all(ALL, MIRRORS, &["compositor/build_pyramid"]);
}
