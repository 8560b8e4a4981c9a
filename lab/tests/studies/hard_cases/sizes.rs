use super::cases::Theme;

#[test]
fn images_of_extreme_shape_and_their_tiles_are_within_their_bounds() {
    let rows = super::holds(Theme::Sizes);
    super::has(&rows, &["1×1 pixel", "8192×8 pixels, in tiles", "8×8192 pixels, in tiles"]);
}
