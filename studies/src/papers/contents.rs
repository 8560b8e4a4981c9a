//! What each paper shows, by the number of its figure or table, and the study that makes the same here.

/// A figure or table of a paper.
#[derive(Debug, Clone, Copy)]
pub struct Figure {
    /// Its number in the paper, such as `figure 10a`.
    pub number: &'static str,
    /// What it shows.
    pub shows: &'static str,
    /// The paper's own numbers, to be read beside those made here; empty if it gives none.
    pub published: &'static str,
    /// The study that makes it here, or why it is not made.
    pub made: Made,
}

/// How a figure is made here.
#[derive(Debug, Clone, Copy)]
pub enum Made {
    /// By the words after `argus-lab study`. The same words are run once for all figures that name them.
    By(&'static [&'static str]),
    /// Not yet, for this reason.
    Not(&'static str),
}

use Made::{By, Not};

/// A paper.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Paper {
    /// GPU cluster for multiple views: samplers, compositors and the balance formula
    Cluster,
    /// Maps of very many views by two hierarchies that are traversed together
    #[value(name = "megaviews")]
    MegaViews,
    /// Many cuts through a hierarchy of levels of detail, in parallel
    #[value(name = "manylods")]
    ManyLods,
    /// Eye-based point rendering: reflections and soft shadows from points
    EyePoints,
}

impl Paper {
    /// Its authors, title and year.
    pub fn title(self) -> &'static str {
        match self {
            Self::Cluster => "An architecture for rendering multiple views of one scene on a cluster of GPUs",
            Self::MegaViews => {
                "Kol, Bauszat, Lee, Eisemann: MegaViews: Scalable Many-View Rendering With Concurrent Scene-View Hierarchy Traversal, 2018"
            }
            Self::ManyLods => {
                "Holländer, Ritschel, Eisemann, Boubekeur: ManyLoDs: Parallel Many-View Level-of-Detail Selection for Real-Time Global Illumination, 2011"
            }
            Self::EyePoints => {
                "Gavane, Watson: Eye-Based Point Rendering for Dynamic Multiview Effects, 2022"
            }
        }
    }

    /// Its figures and tables with results, in their order. Diagrams and pseudocode are left out.
    pub fn figures(self) -> &'static [Figure] {
        match self {
            Self::Cluster => CLUSTER,
            Self::MegaViews => MEGAVIEWS,
            Self::ManyLods => MANYLODS,
            Self::EyePoints => EYE_POINTS,
        }
    }
}

const fn figure(number: &'static str, shows: &'static str, published: &'static str, made: Made) -> Figure {
    Figure { number, shows, published, made }
}

/// Clusters of processes on this machine, each step of a tick measured.
const MEASURED: Made = By(&["load", "cluster"]);
/// Clusters of any number of simulated processes, eleven as in the paper among them.
const SIMULATED: Made = By(&["load", "cluster", "--simulate"]);

const CLUSTER: &[Figure] = &[
    figure(
        "figure 5",
        "time of the naive and the proposed parallelization over the number of views, measured and predicted",
        "",
        MEASURED,
    ),
    figure(
        "table 1",
        "efficiency at 1000 views over the number of processes",
        "proposed .715 (5) to .829 (11), naive .103 to .110",
        SIMULATED,
    ),
    figure("figure 6", "time of the main steps: samples, their distribution, views", "", MEASURED),
    figure("figure 7", "speedup at 1000 views over the number of processes", "", SIMULATED),
    figure("figure 8", "efficiency as the number of views grows, on 5 processes", "", SIMULATED),
    figure(
        "figure 9 and 11",
        "a view from samples beside the same view from triangles, and where they differ",
        "100 steps of the search; judged by Perceptual Image Diff",
        By(&["views", "warp"]),
    ),
    figure(
        "figure 10",
        "the samples of a view and what each contributes",
        "",
        Not("no study writes the share of each sample in a view"),
    ),
];

/// Times over views, placement and method.
const MAPS: Made = By(&["method", "megaviews"]);
/// Error and time of indirect light by virtual point lights.
const VPL: Made = By(&["method", "virtual-lights"]);

const MEGAVIEWS: &[Figure] = &[
    figure(
        "figure 10",
        "time, parts of the time and memory over the number of views, beside ManyLoDs and brute force",
        "a million maps of 16² in about 100 ms on a GTX 1080 Ti (figure 1), some ten times faster than ManyLoDs",
        MAPS,
    ),
    figure(
        "figure 11",
        "placement of views: after one bounce, after four, at random",
        "at random about four times slower than after one bounce",
        MAPS,
    ),
    figure(
        "figure 12",
        "time over the resolution of a view's map",
        "about fourfold for twice the resolution",
        By(&["method", "megaviews", "--views", "4096", "--resolution", "16,32,64"]),
    ),
    figure(
        "figure 13",
        "levels of the hierarchies: time of the maps and error of the light",
        "64K lights: 31 ms with 11 levels, 7 ms with 8",
        VPL,
    ),
    figure("figure 14 and 15", "resolution of the shadow maps: error of the light", "", VPL),
    figure(
        "figure 16",
        "gathering from lights that are not culled",
        "94 % of the leaf nodes are culled at level 6",
        VPL,
    ),
    figure(
        "figure 9",
        "holes of points filled from coarser levels",
        "",
        Not(
            "the study of virtual lights judges filled maps by their light; no picture of a single map is written",
        ),
    ),
    figure(
        "figure 17",
        "glowing particles with and without shadows",
        "maps of 4K particles 21 ms, of 64K 184 ms; nearly twice as fast as ManyLoDs at 64K",
        By(&["method", "particles"]),
    ),
];

/// Cuts, the hierarchies and an animation.
const CUTS: Made = By(&["method", "manylods"]);

const MANYLODS: &[Figure] = &[
    figure(
        "figure 3",
        "reflections of many objects, each from its own map",
        "400 objects",
        By(&["method", "probes"]),
    ),
    figure("figure 4 and 7", "maps from cuts beside imperfect and rasterised ones of equal time", "", CUTS),
    figure("table 1 and figure 8", "cuts of an animation: anew, from the last frame's, and lazily", "", CUTS),
    figure(
        "table 2",
        "building and updating the hierarchy, cuts at several thresholds",
        "build 7 to 10 s, update 15 to 26 ms, cuts of 1 px 2.7 to 3.4 ms (GTX 480)",
        CUTS,
    ),
    figure(
        "figure 5",
        "indirect light gathered from points",
        "700k triangles, 4096 views: 29 ms",
        By(&["light", "indirect", "--methods", "off,points"]),
    ),
    figure(
        "figure 6",
        "one view of a large mesh from a cut, beside its triangles",
        "3.1 M triangles 82 ms, 4 M points 4.9 ms",
        Not("no study draws a view of full size from a cut"),
    ),
];

const EYE_POINTS: &[Figure] = &[
    figure(
        "table 1",
        "shading computations beside multi-view rendering",
        "Sponza: 34 times fewer for 1 object, 104 for 10",
        By(&["method", "eye-points"]),
    ),
    figure(
        "table 2",
        "time, points and error beside iVIR and multi-view rendering",
        "Sponza and others: multi-view rendering 4.5 to 232 ms (GTX 1080 Ti)",
        By(&["method", "eye-points"]),
    ),
    figure(
        "figure 5",
        "two cylinders that face each other",
        "1.64, 2.92 and 3.80 ms for one to three bounces",
        By(&["method", "eye-points", "--part", "recursion"]),
    ),
    figure("figure 6", "error against time", "", By(&["method", "eye-points", "--part", "accuracy"])),
    figure(
        "figure 7 and 8",
        "pictures of reflections, and the largest one enlarged",
        "",
        By(&["method", "eye-points"]),
    ),
    figure(
        "table 3 and figure 10",
        "soft shadows of a spherical light",
        "20 samples: 28.5 ms, iVIR 30.7, multi-view 31.8",
        By(&["method", "eye-points", "--part", "shadows"]),
    ),
];

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use clap::ValueEnum as _;

    use super::*;

    #[test]
    fn figures_have_distinct_numbers_and_say_what_they_show() {
        for paper in Paper::value_variants() {
            let numbers: BTreeSet<_> = paper.figures().iter().map(|figure| figure.number).collect();
            assert_eq!(numbers.len(), paper.figures().len(), "{paper:?}");
            assert!(paper.figures().iter().all(|figure| !figure.shows.is_empty()));
        }
    }
}
