//! Which program has a backend in compute as well as in fragments.
//!
//! On a data-centre GPU few units draw, so that fragments can be many times slower than compute. Where both exist, which
//! one runs is measured on the device: [`argus_compositor::SearchBackend::Auto`], `--visibility auto`.

/// A program with fragment entry points.
#[derive(Debug, Clone, Copy)]
pub struct FragmentProgram {
    /// Its place among the shaders.
    pub label: &'static str,
    /// What does the same in compute; `None` where nothing does.
    pub compute: Option<&'static str>,
    /// How one of the two is chosen, or why there is no other.
    pub note: &'static str,
}

/// All of them.
pub const FRAGMENTS: [FragmentProgram; 8] = [
    search("compositor/fixed_point"),
    search("compositor/linear"),
    search("compositor/pyramid"),
    search("compositor/seeded"),
    search("compositor/warp"),
    FragmentProgram {
        label: "sampler/visibility",
        compute: Some("sampler/trace, sampler/trace_cutouts"),
        note: "tried on the scene by `--visibility auto`; packets on the CPU take part",
    },
    FragmentProgram {
        label: "compositor/resolve",
        compute: None,
        note: "averages the sub-pixels of supersampled views; views of one sub-pixel do not use it",
    },
    FragmentProgram {
        label: "compositor/floor",
        compute: None,
        note: "one fetch a pixel, which studies compare with; no view uses it",
    },
];

/// One of the searches, whose two programs share their source.
const fn search(label: &'static str) -> FragmentProgram {
    FragmentProgram {
        label,
        compute: Some("its own entry points in compute"),
        note: "both are tried on the first batches, and the faster one is kept",
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use argus_shaders::{ALL, Stage};

    use super::*;

    #[test]
    fn every_program_with_fragments_is_listed_and_no_other() {
        let of = |stage: Stage| {
            let has = move |program: &&&argus_shaders::Program| {
                program.entry_points.iter().any(|entry| entry.stage == stage)
            };
            ALL.iter().filter(has).map(|program| program.label).collect::<BTreeSet<_>>()
        };
        let listed: BTreeSet<&str> = FRAGMENTS.iter().map(|program| program.label).collect();
        assert_eq!(of(Stage::Fragment), listed);
        // What is said to have both has both.
        let twins = FRAGMENTS.iter().filter(|p| p.compute.is_some_and(|with| with.starts_with("its own")));
        for program in twins {
            assert!(of(Stage::Compute).contains(program.label), "{}", program.label);
        }
    }
}
