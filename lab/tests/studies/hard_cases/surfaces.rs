use super::cases::Theme;

#[test]
fn difficult_surfaces_are_within_their_bounds() {
    let rows = super::holds(Theme::Surfaces);
    let cases = [
        "inside geometry",
        "near plane",
        "grazing plane",
        "coplanar",
        "thin wires",
        "checkerboard",
        "far side of a wall",
        "sky only",
        "one triangle",
        "degenerate triangles",
    ];
    super::has(&rows, &cases);
}
