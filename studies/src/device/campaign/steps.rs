//! The steps of a campaign, the most valuable first.

use std::time::Duration;

/// One step: a command of `argus` in a process of its own.
#[derive(Debug, Clone, Copy)]
pub struct Step {
    /// Name of the study and of its files.
    pub name: &'static str,
    /// The kind of study, the word before its name; `None` for the self-test.
    pub kind: Option<&'static str>,
    /// Further arguments of a full campaign.
    pub arguments: &'static [&'static str],
    /// Further arguments of a quick campaign.
    pub quick_arguments: &'static [&'static str],
    /// Time limit in seconds of a full campaign.
    pub most_secs: u64,
    /// Columns that identify a row when two campaigns are compared.
    pub keys: &'static [&'static str],
}

/// Time limit in seconds of a step in a quick campaign.
const QUICK_SECS: u64 = 120;

/// Name of the self-test's step.
pub(super) const SELFTEST: &str = "selftest";

impl Step {
    /// A study with its default arguments.
    const fn study(
        kind: &'static str,
        name: &'static str,
        most_secs: u64,
        keys: &'static [&'static str],
    ) -> Self {
        Self { name, kind: Some(kind), arguments: &[], quick_arguments: &[], most_secs, keys }
    }

    /// Adds arguments for a full campaign.
    const fn with(self, arguments: &'static [&'static str]) -> Self {
        Self { arguments, ..self }
    }

    /// Arguments of `argus`.
    pub fn command(&self, quick: bool) -> Vec<String> {
        let mut words = match self.kind {
            None => vec![self.name],
            Some(kind) => vec!["study", kind, self.name],
        };
        words.extend(if quick { self.quick_arguments } else { self.arguments });
        words.extend((quick && self.kind.is_some()).then_some("--quick"));
        words.push("--json");
        words.into_iter().map(str::to_owned).collect()
    }

    /// The step's time limit.
    pub fn most(&self, quick: bool) -> Duration {
        Duration::from_secs(if quick { self.most_secs.min(QUICK_SECS) } else { self.most_secs })
    }
}

/// All steps, the most valuable first. A new study is appended at the end.
pub const STEPS: [Step; 18] = [
    Step { kind: None, ..Step::study("", SELFTEST, 180, &[]) },
    Step::study("device", "parts", 240, &["measure", "variant", "unit"]),
    Step::study("views", "baseline", 180, &["scene", "size", "method"]).with(&["--scene", "terrain:500000"]),
    Step::study("views", "warp", 240, &["search", "steps", "samples", "supersampling", "texels", "cameras"])
        .with(&["--views", "6"]),
    Step::study("device", "visibility", 180, &["scene", "size", "sub_samples"])
        .with(&["--scene", "terrain:500000"]),
    Step::study("load", "burst", 180, &["scene", "method", "views", "size", "workers"]),
    Step::study("device", "throughput", 180, &["scene", "size", "batch"]),
    // Ten levels below the root make eleven.
    Step::study(
        "method",
        "megaviews",
        300,
        &["method", "placement", "views", "resolution", "levels", "texel", "occlusion"],
    )
    .with(&[
        "--views",
        "65536,262144,1048576",
        "--levels",
        "10",
        "--method",
        "megaviews,manylods",
        "--patience",
        "20",
    ]),
    Step::study(
        "method",
        "manylods",
        240,
        &["part", "tree", "method", "path", "threshold", "views", "motion"],
    ),
    Step::study("method", "virtual-lights", 240, &["differs", "way", "vpls", "resolution", "maps", "levels"]),
    Step::study("method", "probes", 240, &["differs", "side", "levels"]),
    Step::study("load", "service", 300, &["mode", "phase"]),
    Step::study("device", "rays", 120, &["scene", "rays", "tracer", "threads"]).with(&[
        "--scene",
        "rooms",
        "--scene",
        "terrain:500000",
        "--size",
        "640x480",
        "--views",
        "2",
        "--rounds",
        "3",
    ]),
    Step::study("light", "shadows", 180, &["effects"]).with(&["--scene", "rooms", "--rays", "1,4"]),
    Step::study("light", "indirect", 300, &["method"]).with(&[
        "--methods",
        "off,paths,cells",
        "--paths",
        "32",
    ]),
    Step::study("light", "effects", 240, &["scene", "row"]).with(&[
        "--scene",
        "room,rooms,mirrors",
        "--rounds",
        "3",
    ]),
    Step::study("light", "equal-error", 300, &["way", "setting"]).with(&["--views", "2", "--paths", "4"]),
    Step::study("method", "eye-points", 240, &["reflectors", "pose", "way", "density"]).with(&[
        "--reflectors",
        "10",
        "--density",
        "1",
        "--ways",
        "points,points-culled,mvr-adaptive,rays",
    ]),
];

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;
    use crate::device::targets::TARGETS;

    #[test]
    fn step_names_are_unique_and_the_device_is_tested_first() {
        let names: BTreeSet<&str> = STEPS.iter().map(|step| step.name).collect();
        assert_eq!(names.len(), STEPS.len());
        assert_eq!((STEPS[0].name, STEPS[0].kind), (SELFTEST, None));
        assert_eq!(STEPS[1].name, "parts");
    }

    #[test]
    fn every_target_belongs_to_a_step() {
        for target in TARGETS {
            assert!(STEPS.iter().any(|step| step.name == target.study), "{}", target.claim);
        }
    }

    #[test]
    fn a_quick_step_is_short_and_a_full_step_has_its_arguments() {
        let megaviews = STEPS.iter().find(|step| step.name == "megaviews").unwrap();
        assert_eq!(megaviews.command(true), ["study", "method", "megaviews", "--quick", "--json"]);
        assert_eq!(megaviews.most(true), Duration::from_secs(QUICK_SECS));
        let whole = megaviews.command(false).join(" ");
        assert!(whole.contains("--levels 10") && whole.contains("1048576") && !whole.contains("--quick"));
        assert_eq!(STEPS[0].command(true), ["selftest", "--json"]);
    }
}
