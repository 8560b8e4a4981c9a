//! The figures and tables of one paper, made anew and written on one page.
//!
//! Each study runs in a process of its own, so that one that fails is a line of the page and the others are made.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result};
use indicatif::ProgressBar;
use tokio_util::sync::CancellationToken;

pub use super::contents::{Figure, Made, Paper};
use crate::child::{self, Ended};

/// Longest time of one study.
const MOST: Duration = Duration::from_secs(3600);

/// What a page is made of.
#[derive(Debug, Clone, clap::Args)]
pub struct Options {
    /// The paper
    #[arg(value_name = "PAPER")]
    pub paper: Paper,
    /// The scene of all its studies; without it each takes its own default
    #[arg(long, value_name = "S")]
    pub scene: Option<String>,
}

/// How the page's figures ended.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Written {
    /// The page.
    pub page: PathBuf,
    /// Figures and tables that were made.
    pub made: usize,
    /// Figures and tables that no study makes yet.
    pub missing: usize,
    /// Studies that failed.
    pub failed: usize,
}

/// A study that was run.
struct Run {
    /// Folder of its table, plots and pictures, below the page's.
    folder: String,
    secs: f64,
    /// Why it failed.
    failure: Option<String>,
}

/// Runs the studies of a paper by `program` (`argus-lab`), and writes the page `README.md` into a folder. `progress` counts
/// studies. Cancelling `stop` ends the running study; those after it are not started.
///
/// # Errors
/// The folder cannot be written to, or the program cannot be started. A study that fails is part of the page.
pub async fn run(
    program: &Path,
    options: &Options,
    (quick, out): (bool, &Path),
    progress: &ProgressBar,
    stop: &CancellationToken,
) -> Result<Written> {
    fs::create_dir_all(out).with_context(|| format!("cannot make {}", out.display()))?;
    let figures = options.paper.figures();
    let mut commands: Vec<&[&str]> = Vec::new();
    for figure in figures {
        if let Made::By(words) = figure.made
            && !commands.contains(&words)
        {
            commands.push(words);
        }
    }
    progress.set_length(commands.len() as u64);
    let mut runs = BTreeMap::new();
    for words in commands {
        progress.set_message(words.join(" "));
        runs.insert(words, run_study(program, words, options, (quick, out), stop).await?);
        let page = page(options, quick, out, &runs);
        fs::write(out.join("README.md"), page).with_context(|| format!("cannot write {}", out.display()))?;
        progress.inc(1);
    }
    let missing = figures.iter().filter(|figure| matches!(figure.made, Made::Not(_))).count();
    let failed = runs.values().filter(|run| run.failure.is_some()).count();
    let has_failed =
        |figure: &&Figure| matches!(figure.made, Made::By(words) if runs[words].failure.is_some());
    let made = figures.len() - missing - figures.iter().filter(has_failed).count();
    Ok(Written { page: out.join("README.md"), made, missing, failed })
}

async fn run_study(
    program: &Path,
    words: &[&str],
    options: &Options,
    (quick, out): (bool, &Path),
    stop: &CancellationToken,
) -> Result<Run> {
    let folder =
        words.iter().map(|word| word.trim_start_matches('-')).collect::<Vec<_>>().join("-").replace(',', "-");
    let files = out.join(&folder);
    fs::create_dir_all(&files)?;
    let mut arguments = vec!["study".to_owned()];
    arguments.extend(words.iter().map(|&word| word.to_owned()));
    arguments.extend(options.scene.iter().flat_map(|scene| ["--scene".to_owned(), scene.clone()]));
    arguments.extend(quick.then(|| "--quick".to_owned()));
    arguments.extend(["--out".to_owned(), files.display().to_string()]);
    let (output, log) = (files.join("output.txt"), files.join("log.txt"));
    let begin = Instant::now();
    let ended = child::run(program, &arguments, [&output, &log], MOST, stop).await?;
    let failure = match ended {
        Ended::Exit(status) if status.success() => None,
        Ended::Exit(status) => Some(child::reason(status, &log)),
        Ended::TimedOut => Some(format!("it took more than {} s", MOST.as_secs())),
        Ended::Stopped => Some("it was stopped".to_owned()),
    };
    Ok(Run { folder, secs: begin.elapsed().as_secs_f64(), failure })
}

/// The page: a section for each figure. A study's table and pictures stand where it is named first.
fn page(options: &Options, quick: bool, out: &Path, runs: &BTreeMap<&[&str], Run>) -> String {
    let figures = options.paper.figures();
    let mut page = format!("# {}\n", options.paper.title());
    if quick {
        page += "\nMade by `--quick`: it shows that everything runs; the figures are noise.\n";
    }
    let missing: Vec<_> = figures.iter().filter(|figure| matches!(figure.made, Made::Not(_))).collect();
    if !missing.is_empty() {
        page += "\nNot made: ";
        page += &missing.iter().map(|figure| figure.number).collect::<Vec<_>>().join(", ");
        page += ".\n";
    }
    let mut shown: BTreeMap<&[&str], &str> = BTreeMap::new();
    for figure in figures {
        let _ = write!(page, "\n## {}: {}\n", capital(figure.number), figure.shows);
        if !figure.published.is_empty() {
            let _ = write!(page, "\nThe paper: {}.\n", figure.published);
        }
        let words = match figure.made {
            Made::By(words) => words,
            Made::Not(why) => {
                let _ = write!(page, "\nNot made: {why}.\n");
                continue;
            }
        };
        if let Some(first) = shown.get(words) {
            let _ = write!(page, "\nIn the table of {first}.\n");
            continue;
        }
        shown.insert(words, figure.number);
        let _ = write!(page, "\n`argus-lab study {}`", words.join(" "));
        match runs.get(words) {
            None => page += " has not run yet.\n",
            Some(Run { failure: Some(why), .. }) => {
                let _ = writeln!(page, " FAILED: {why}");
            }
            Some(run) => {
                let _ = write!(page, ", {:.0} s:\n\n{}", run.secs, results(out, &run.folder));
            }
        }
    }
    page
}

/// The tables of a study's folder, then its plots and pictures as images.
fn results(out: &Path, folder: &str) -> String {
    let entries = fs::read_dir(out.join(folder)).into_iter().flatten().flatten();
    let mut files: Vec<PathBuf> = entries.map(|entry| entry.path()).collect();
    files.sort();
    let of = |kinds: &'static [&'static str]| {
        files.iter().filter(|file| file.extension().is_some_and(|kind| kinds.iter().any(|of| kind == *of)))
    };
    let mut text: String = of(&["md"]).map(|file| fs::read_to_string(file).unwrap_or_default()).collect();
    for file in of(&["svg", "png"]) {
        let path = file.strip_prefix(out).unwrap_or(file).display().to_string();
        let _ = write!(text, "\n![{path}]({path})\n");
    }
    text
}

fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or_else(String::new, |first| first.to_uppercase().chain(letters).collect())
}

#[cfg(all(test, unix))]
mod tests {
    #![allow(clippy::unwrap_used)] // a test ends at the first thing that goes wrong

    use std::os::unix::fs::PermissionsExt as _;

    use super::*;

    /// Makes the page of ManyLoDs with a program that runs a shell script; `$@` are the arguments of `argus-lab`.
    async fn page_by(script: &str) -> (Written, String) {
        let folder = tempfile::tempdir().unwrap();
        let program = folder.path().join("argus-lab");
        fs::write(&program, format!("#!/bin/sh\n{script}\n")).unwrap();
        fs::set_permissions(&program, fs::Permissions::from_mode(0o755)).unwrap();
        let options = Options { paper: Paper::ManyLods, scene: Some("rooms".to_owned()) };
        let out = folder.path().join("page");
        let written =
            run(&program, &options, (true, &out), &ProgressBar::hidden(), &CancellationToken::new())
                .await
                .unwrap();
        let text = fs::read_to_string(&written.page).unwrap();
        (written, text)
    }

    #[tokio::test]
    async fn each_study_runs_once_and_its_table_stands_where_it_is_named_first() {
        let script = r#"
            case "$*" in *"--scene rooms --quick --out "*) ;; *) exit 1;; esac
            while [ "$1" != --out ]; do shift; done
            echo "| rows of $2 |" | sed 's#/.*/##' > "$2/t.md"; touch "$2/p.svg""#;
        let (written, page) = page_by(script).await;
        assert_eq!((written.made, written.missing, written.failed), (5, 1, 0), "{page}");
        assert_eq!(page.matches("| rows of method-manylods |").count(), 1, "{page}");
        assert!(
            page.contains("In the table of figure 4 and 7.") && page.contains("(method-manylods/p.svg)"),
            "{page}"
        );
        assert!(page.contains("Not made: figure 6."), "{page}");
    }

    #[tokio::test]
    async fn a_study_that_fails_is_a_line_and_the_others_are_made() {
        let (written, page) =
            page_by(r#"[ "$3" = probes ] && { echo "argus: no mirror" >&2; exit 1; }; exit 0"#).await;
        assert_eq!((written.made, written.failed), (4, 1), "{page}");
        assert!(page.contains("FAILED: argus: no mirror"), "{page}");
    }
}
