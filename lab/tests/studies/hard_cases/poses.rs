use super::cases::Theme;

#[test]
fn difficult_viewpoints_are_within_their_bounds() {
    let rows = super::holds(Theme::Poses);
    let cases =
        ["at a sample camera", "outside the rig", "behind the rig", "looking away", "fov 1°", "fov 179°"];
    super::has(&rows, &cases);
}
