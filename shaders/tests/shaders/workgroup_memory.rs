//! Memory of workgroups is not zeroed before a program runs (`gpu/src/pipeline.rs`), so that each program writes what it
//! reads of it.

use argus_shaders::ALL;
use naga::AddressSpace;

/// Programs with memory of workgroups that were looked through: every invocation writes its place before the first barrier,
/// or one invocation writes the whole.
const LOOKED_THROUGH: [&str; 3] = ["compositor/build_pyramid", "sampler/choose_receivers", "sampler/receive"];

#[test]
fn every_program_with_workgroup_memory_was_looked_through() {
    let has_any = |source: &str| {
        let module = naga::front::wgsl::parse_str(source).expect("valid WGSL");
        module.global_variables.iter().any(|(_, variable)| variable.space == AddressSpace::WorkGroup)
    };
    let found: Vec<&str> =
        ALL.iter().filter(|program| has_any(program.source)).map(|program| program.label).collect();
    let mut expected = LOOKED_THROUGH.to_vec();
    expected.sort_unstable();
    let mut sorted = found.clone();
    sorted.sort_unstable();
    assert_eq!(sorted, expected, "does the new one write what it reads? then add it here");
}

#[test]
fn no_program_assumes_a_size_of_subgroups() {
    for program in ALL {
        // Packets of rays are laid out by the size that they read; sums over subgroups need none.
        let by_number = program.source.contains("subgroup_id") || program.source.contains("num_subgroups");
        assert!(
            !by_number || program.source.contains("subgroup_size"),
            "{} counts subgroups and does not read their size",
            program.label
        );
        // A shuffle or a ballot of fixed width would lose lanes: of a ballot only the word of the first 32 lanes is used
        // where no more than 8 of them can answer.
        let ballots = program.source.matches("subgroupBallot(").count();
        assert!(
            ballots == 0 || program.label.starts_with("sampler/trace"),
            "{} takes ballots: which lanes answer?",
            program.label
        );
    }
}
