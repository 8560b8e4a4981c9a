//! Unlit surfaces: shown as they are, and no light for other surfaces.

use argus_scene::reference::{DirectLight, Tracer};
use argus_scene::{Camera, LightEffects, Lighting, Material, Sky};
use glam::{DAffine3, DVec3, Vec3, Vec4};

use super::common::{furnace, patch, scene, sphere, sun, tracer, white};

fn unlit(color: Vec4) -> Material {
    Material { base_color: color, unlit: true, ..Material::default() }
}

#[test]
fn unlit_colours_and_vertex_colours_are_shown_at_any_exposure_and_in_any_light() {
    let color = Vec4::new(0.2, 0.5, 1.0, 1.0);
    let mut card = patch(1);
    card.colors = vec![Vec4::new(0.5, 1.0, 1.0, 1.0); 4];
    let dark = Lighting { lights: Vec::new(), sky: Sky::BLACK, exposure: 1.0 };
    for lighting in [dark, furnace(), sun(DVec3::NEG_Z)] {
        for exposure in [1e-6, 0.3, 1.0, 1e6] {
            let lighting = Lighting { exposure, ..lighting.clone() };
            let tracer = tracer(scene(vec![card.clone()], vec![unlit(color)], lighting))
                .with_direct_light(DirectLight { effects: LightEffects::ALL, rays: 2 });
            let seen = tracer.radiance_along(DVec3::Z * 3.0, DVec3::NEG_Z, DVec3::ZERO, DVec3::ZERO);
            let shown = seen * exposure;
            assert!((shown - Vec3::new(0.1, 0.5, 1.0)).abs().max_element() < 1e-5, "{exposure}: {shown}");
        }
    }
}

/// Radiance of a white floor's middle under a sun, in a sphere of this material.
fn in_sphere(material: Material) -> Vec3 {
    let mut ground = scene(vec![patch(1), sphere(12)], vec![white(), material], sun(DVec3::NEG_Z));
    ground.instances[1].world_from_mesh = DAffine3::from_scale(DVec3::splat(10.0));
    let tracer: Tracer =
        tracer(ground).with_direct_light(DirectLight { effects: LightEffects::ALL, rays: 4 });
    let eye = Camera::look_at(DVec3::Z * 3.0, DVec3::ZERO).eye;
    tracer.radiance_along(eye, DVec3::NEG_Z, DVec3::ZERO, DVec3::ZERO)
}

#[test]
fn a_backdrop_casts_no_shadow_and_other_unlit_surfaces_do() {
    let color = Vec4::ONE;
    let backdrop = in_sphere(Material { backdrop: true, ..unlit(color) });
    assert!((backdrop - Vec3::ONE).abs().max_element() < 1e-4, "{backdrop}");
    assert_eq!(in_sphere(unlit(color)), Vec3::ZERO);
}
