//! The programs with fragment entry points, and their compute backends.
//!
//! A data-centre GPU has few raster units, so fragment programs can be many times slower than compute. Where both exist,
//! the faster one is measured on the device: [`argus_compositor::SearchBackend::Auto`], `--visibility auto`.

/// A program with fragment entry points.
#[derive(Debug, Clone, Copy)]
pub struct FragmentProgram {
    /// The program's label in the `shaders` crate.
    pub label: &'static str,
    /// The compute backend; `None` if there is none.
    pub compute: Option<&'static str>,
    /// How one of the two is chosen, or why there is no compute backend.
    pub note: &'static str,
}

/// All programs with fragment entry points.
pub const FRAGMENTS: [FragmentProgram; 7] = [
    search("compositor/linear"),
    search("compositor/pyramid"),
    search("compositor/seeded"),
    search("compositor/warp"),
    FragmentProgram {
        label: "sampler/visibility",
        compute: Some("sampler/trace, sampler/trace_cutouts"),
        note: "measured on the scene by `--visibility auto`, as are packets on the CPU",
    },
    FragmentProgram {
        label: "compositor/resolve",
        compute: None,
        note: "averages the sub-pixels of supersampled views; views of one sub-pixel do not use it",
    },
    FragmentProgram {
        label: "compositor/bare_fetch",
        compute: None,
        note: "one fetch a pixel, a baseline of studies; no view uses it",
    },
];

/// A search; its two programs share their source.
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
    fn the_list_names_exactly_the_programs_with_fragment_entry_points() {
        let of = |stage: Stage| {
            let has = move |program: &&&argus_shaders::Program| {
                program.entry_points.iter().any(|entry| entry.stage == stage)
            };
            ALL.iter().filter(has).map(|program| program.label).collect::<BTreeSet<_>>()
        };
        let listed: BTreeSet<&str> = FRAGMENTS.iter().map(|program| program.label).collect();
        assert_eq!(of(Stage::Fragment), listed);
        // Programs that claim their own compute entry points have them.
        let twins = FRAGMENTS.iter().filter(|p| p.compute.is_some_and(|with| with.starts_with("its own")));
        for program in twins {
            assert!(of(Stage::Compute).contains(program.label), "{}", program.label);
        }
    }
}
