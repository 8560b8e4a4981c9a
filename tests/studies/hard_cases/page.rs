//! The page in `docs/` lists the suite's cases.

use argus_gpu::{Gpu, GpuOptions};
use argus_studies::hard_cases::{Row, Stages, Theme, claims};

const PAGE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/docs/hard-cases.md");

/// Only the quick cases run here: they find a page that lacks a case or a search.
#[test]
fn the_page_has_every_case_by_every_search() {
    let page = std::fs::read_to_string(PAGE).unwrap();
    assert!(!page.contains("**failed**"), "the page shows a case that is out of bounds");
    let written = claims(&page);
    let gpu = Gpu::new(&GpuOptions::default()).unwrap();
    let rows: Vec<Row> = [Theme::Poses, Theme::Omni]
        .iter()
        .flat_map(|theme| theme.run(&mut Stages::new(&gpu).unwrap()).unwrap())
        .collect();
    for row in rows {
        let claim = (row.case, row.search.to_owned());
        assert!(written.contains(&claim), "write docs/hard-cases.md again: it lacks {claim:?}");
    }
}
