use super::cases::Theme;

#[test]
fn scenes_far_from_zero_very_small_or_very_large_are_within_their_bounds() {
    let rows = super::holds(Theme::Precision);
    super::has(&rows, &["(10⁶, 10⁶, 10⁶) m", "scaled by 10⁻³", "scaled by 10³"]);
}
