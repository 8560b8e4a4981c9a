//! The GPU programs of this crate, `shaders/*.wgsl`, linked by `build.rs`.

include!(concat!(env!("OUT_DIR"), "/programs.rs"));

pub use self::megaviews::*;

#[cfg(test)]
mod tests {
    use argus_shaders::checks;

    #[test]
    fn programs_are_valid_and_mirrored_and_keep_the_rules_of_all_programs() {
        checks::all(super::ALL, &[crate::layout::MIRRORS], &[]);
    }
}
