//! The page in `docs/` lists the suite's cases. Each theme's test looks its own cases up there.

use super::cases::{Theme, claims, page};

const PAGE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/hard-cases.md");

/// The page.
pub(super) fn text() -> String {
    std::fs::read_to_string(PAGE).unwrap()
}

#[test]
fn the_page_shows_cases_and_none_that_is_out_of_bounds() {
    if std::env::var_os("ARGUS_WRITE_PAGE").is_some() {
        let rows: Vec<_> = Theme::ALL.into_iter().flat_map(super::rows).collect();
        std::fs::write(PAGE, page(&rows)).unwrap();
    }
    let page = text();
    assert!(!page.contains("**failed**"), "the page shows a case that is out of bounds");
    assert!(!claims(&page).is_empty(), "the page shows no case");
}
