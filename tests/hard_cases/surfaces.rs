use argus_studies::hard_cases::Theme;

#[test]
fn whatever_there_is_to_see() {
    let rows = crate::holds(Theme::Surfaces);
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
    crate::has(&rows, &cases);
}
