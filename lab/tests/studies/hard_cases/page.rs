//! The page in `docs/` lists the suite's cases. Each theme's test looks its own cases up there.

use argus_studies::hard_cases::claims;

const PAGE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/hard-cases.md");

/// The page.
pub(super) fn text() -> String {
    std::fs::read_to_string(PAGE).unwrap()
}

#[test]
fn the_page_shows_cases_and_none_that_is_out_of_bounds() {
    let page = text();
    assert!(!page.contains("**failed**"), "the page shows a case that is out of bounds");
    assert!(!claims(&page).is_empty(), "the page shows no case");
}
