//! The files of the page, which are part of the program.

use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};

/// A script of the page.
macro_rules! script {
    ($name:literal) => {
        ($name, "text/javascript", include_str!(concat!("page/", $name)))
    };
}

/// Name, type and text of each file beside the page itself.
const FILES: [(&str, &str, &str); 16] = [
    ("page.css", "text/css", include_str!("page/page.css")),
    script!("address.js"),
    script!("bound.js"),
    script!("compare.js"),
    script!("controls.js"),
    script!("figures.js"),
    script!("link.js"),
    script!("main.js"),
    script!("others.js"),
    script!("pace.js"),
    script!("plain.js"),
    script!("relief.js"),
    script!("request.js"),
    script!("scene.js"),
    script!("viewer.js"),
    script!("warp.js"),
];

/// The page.
pub(super) fn page() -> Response {
    text("text/html", include_str!("page/page.html"))
}

/// A file that the page loads.
pub(super) fn file(name: &str) -> Response {
    match FILES.iter().find(|(known, ..)| *known == name) {
        Some((_, kind, content)) => text(kind, content),
        None => (
            StatusCode::NOT_FOUND,
            "the paths are /, /scene, /cells, /session and /frame, and the files of the page\n",
        )
            .into_response(),
    }
}

fn text(kind: &str, content: &'static str) -> Response {
    // A page and its scripts are of one version, also after an upgrade of the program.
    let headers = [
        (header::CONTENT_TYPE, format!("{kind}; charset=utf-8")),
        (header::CACHE_CONTROL, "no-cache".to_owned()),
    ];
    (headers, content).into_response()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scripts_import_only_files_that_are_served_and_nothing_from_elsewhere() {
        let page = include_str!("page/page.html");
        assert!(page.contains("src=\"main.js\"") && page.contains("href=\"page.css\""));
        for (name, _, content) in FILES {
            for line in content.lines().filter(|line| line.starts_with("import ")) {
                let from = line.split_once("from \"./").and_then(|(_, rest)| rest.strip_suffix("\";"));
                let from = from.unwrap_or_else(|| panic!("{name}: {line}"));
                assert!(FILES.iter().any(|(known, ..)| *known == from), "{name} imports {from}");
            }
            assert!(!content.contains("://") || name == "link.js", "{name} names another server");
        }
    }
}
