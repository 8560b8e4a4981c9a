use super::cases::Theme;

#[test]
fn rays_along_borders_and_texel_rows_are_within_their_bounds() {
    let rows = super::holds(Theme::Rays);
    super::has(
        &rows,
        &["border of two tiles", "rows of texels", "columns of texels", "plane of the lattice"],
    );
}
