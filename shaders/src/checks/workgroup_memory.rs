//! Memory of workgroups is not zeroed before a program runs (`gpu/src/pipeline.rs`), so that each program writes what it
//! reads of it.

use naga::AddressSpace;

use crate::Program;

/// Panics unless the programs with memory of workgroups are those that were looked through: every invocation writes its place
/// before the first barrier, or one invocation writes the whole.
pub(super) fn check_memory(programs: &[&Program], looked_through: &[&str]) {
    let has_any = |source: &str| {
        let module = naga::front::wgsl::parse_str(source).expect("valid WGSL");
        module.global_variables.iter().any(|(_, variable)| variable.space == AddressSpace::WorkGroup)
    };
    let found: Vec<&str> =
        programs.iter().filter(|program| has_any(program.source)).map(|program| program.label).collect();
    let mut expected = looked_through.to_vec();
    expected.sort_unstable();
    let mut sorted = found.clone();
    sorted.sort_unstable();
    assert_eq!(sorted, expected, "does the new one write what it reads? then add it here");
}

/// Panics if a program assumes a size of subgroups.
pub(super) fn check_subgroups(programs: &[&Program]) {
    for program in programs {
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
