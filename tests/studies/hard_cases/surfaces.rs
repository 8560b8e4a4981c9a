use argus_studies::hard_cases::Theme;

#[test]
fn whatever_there_is_to_see() {
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
        "triangles that are none",
    ];
    super::has(&rows, &cases);
}
