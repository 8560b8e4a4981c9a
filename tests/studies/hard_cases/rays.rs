use argus_studies::hard_cases::Theme;

#[test]
fn rays_along_what_a_search_is_made_of() {
    let rows = super::holds(Theme::Rays);
    super::has(
        &rows,
        &["border of two tiles", "rows of texels", "columns of texels", "plane of the lattice"],
    );
}
