use super::*;

fn tile() -> Rig {
    let bounds = Bounds { min: DVec3::new(-50.0, 0.0, -50.0), max: DVec3::new(50.0, 20.0, 50.0) };
    Rig::TileCorners { bounds, tiles: [2, 3], height: 1.0, size: [400, 300] }
}

fn refined(refined: &[u64]) -> CandidateCameras<'_> {
    CandidateCameras { refined, sight: None }
}

fn cell() -> Rig {
    Rig::Cell { origin: DVec3::new(1.0, 2.0, 3.0), spacing: 2.0, face: 64 }
}

#[test]
fn a_rig_of_fewer_texels_has_the_same_cameras() {
    let Rig::TileCorners { size, .. } = tile().with_side(100) else { panic!() };
    assert_eq!(size, [100, 75]);
    for (rig, index) in [(tile(), 2), (cell(), cell().nearest(&Camera::look_at(DVec3::ZERO, DVec3::X), 1)[0])]
    {
        let (fine, coarse) = (rig.camera(index).unwrap(), rig.with_side(64).camera(index).unwrap());
        assert_eq!(fine.center(), coarse.center());
        assert_eq!(coarse.size()[0] % 64, 0);
    }
}

#[test]
fn a_tiles_cameras_see_all_of_its_box() {
    let rig = tile();
    for index in (0..24).chain((24..24 + 6 * tile::REFINED).step_by(37)) {
        let SampleCamera::Perspective { camera, width, height } = rig.camera(index).unwrap() else {
            panic!("tile cameras are perspective")
        };
        camera.validate().unwrap();
        let bounds = rig.tile_camera(index).unwrap().0.bounds;
        let half = camera.tan_half_fov(width, height);
        for corner in [bounds.min, bounds.max] {
            let p = camera.view_from_world() * (corner - camera.eye);
            assert!(p.z < 0.0 && (p.truncate() / -p.z).abs().cmple(half).all(), "camera {index}");
        }
    }
    let beyond = 24 + 6 * tile::REFINED;
    assert_eq!(rig.camera(beyond).unwrap_err().field, "sample.index");
    assert_eq!(rig.level(beyond), None);
}

#[test]
fn the_corner_above_the_eye_is_the_best_one() {
    let rig = tile();
    let bounds = rig.tile(5).bounds;
    let SampleCamera::Perspective { camera, .. } = rig.camera(4 * 5 + 3).unwrap() else { panic!() };
    let view = Camera::look_at(camera.eye + DVec3::splat(0.1), bounds.center());
    let nearest = rig.nearest(&view, 4);
    assert_eq!(nearest[0], 4 * 5 + 3);
    assert_eq!(nearest.len(), 4);
}

#[test]
fn lattice_corners_surround_the_eye_and_survive_packing() {
    let rig = cell();
    let view = Camera::look_at(DVec3::new(-7.3, 4.1, 3.0), DVec3::ZERO);
    let nearest = rig.nearest(&view, 8);
    assert_eq!(nearest.len(), 8);
    for index in nearest {
        let center = rig.camera(index).unwrap().center();
        assert!((center - view.eye).abs().max_element() <= 2.0, "{center}");
    }
}

#[test]
fn viewpoints_on_cell_borders_and_absurdly_far_away_still_have_samples() {
    let rig = cell();
    for eye in [DVec3::new(1.0, 2.0, 3.0), DVec3::splat(1e6), DVec3::splat(-1e12), DVec3::splat(f64::MAX)] {
        let view = Camera::look_at(eye, eye + DVec3::X);
        assert_eq!(rig.nearest(&view, 4).len(), 4);
    }
}

#[test]
fn each_level_of_refinement_is_nearer_and_nearer_to_the_eye() {
    let far = |rig: &Rig, view: &Camera, index: u64| match rig.camera(index).unwrap() {
        SampleCamera::Omni { center, .. } => (center - view.eye).length(),
        SampleCamera::Perspective { camera, .. } => {
            let center = rig.tile(rig.tile_looked_at(view)).bounds.center();
            (camera.eye - center).angle_between(view.eye - center)
        }
    };
    for i in 0..200 {
        let turn = f64::from(i) * 2.399_963;
        let eye = DVec3::new(turn.cos() * 90.0, 30.0 + f64::from(i % 60), turn.sin() * 90.0);
        let view = Camera::look_at(eye, DVec3::ZERO);
        for (rig, reach) in [(tile(), 1.2), (cell(), 2.0)] {
            for level in 1..=MAX_LEVEL {
                let index = rig.refinement(&view, level, None).unwrap();
                assert!(rig.level(index).unwrap() <= level);
                let limit = reach / f64::from(1 << level);
                assert!(far(&rig, &view, index) <= limit, "view {i}, level {level}");
                let among = rig.nearest_among(&view, 4, refined(&[index, index]));
                assert!(among.contains(&index), "view {i}, level {level}");
                assert!(among.windows(2).all(|w| w[0] != w[1]));
            }
        }
    }
}

#[test]
fn refinements_of_another_tile_and_malformed_indices_are_not_chosen() {
    let rig = tile();
    let view = Camera::look_at(DVec3::new(60.0, 60.0, 60.0), DVec3::new(40.0, 10.0, 40.0));
    let own = rig.nearest(&view, 8);
    let elsewhere = 24 + 5 * tile::REFINED - 1;
    assert_eq!(rig.nearest_among(&view, 8, refined(&[elsewhere, u64::MAX])), own);
    assert_eq!(cell().nearest_among(&view, 8, refined(&[u64::MAX])), cell().nearest(&view, 8));
}
