use argus_studies::hard_cases::Theme;

#[test]
fn far_from_zero_very_small_and_very_large() {
    let rows = super::holds(Theme::Precision);
    super::has(&rows, &["(10⁶, 10⁶, 10⁶) m", "scaled by 10⁻³", "scaled by 10³"]);
}
