use super::cases::Theme;

#[test]
fn seams_poles_and_corners_of_omni_samples_are_within_their_bounds() {
    let rows = super::holds(Theme::Omni);
    super::has(&rows, &["seam", "pole", "corner of three faces", "rim of a paraboloid"]);
}
