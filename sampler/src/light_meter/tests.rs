#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use argus_scene::LightEffects;

    use super::*;

    fn light(scene: &Scene, effects: LightEffects, indirect: bool) -> f64 {
        PacketSight::new(&Arc::new(scene.clone())).metered(Metering { effects, indirect }).unwrap()
    }

    #[test]
    fn rays_find_about_the_light_that_shading_adds_to_an_open_scene() {
        let scene = argus_scene::procedural::terrain(20_000);
        let whole = light(&scene, LightEffects::NONE, false);
        for effects in ["shadows", "sky-visibility", "shadows,sky-visibility"] {
            let share = light(&scene, effects.parse().unwrap(), false) / whole;
            assert!((0.5..1.1).contains(&share), "{effects}: {share}");
        }
    }

    #[test]
    fn walls_keep_light_out_and_reflect_it() {
        let scene = argus_scene::procedural::rooms(20);
        let direct = light(&scene, LightEffects::ALL, false);
        let all = light(&scene, LightEffects::ALL, true);
        assert!(direct < 0.9 * all, "{direct} {all}");
    }

    #[test]
    fn a_scene_without_light_or_surfaces_is_not_metered() {
        let mut scene = argus_scene::procedural::terrain(2_000);
        let metering = Metering { effects: LightEffects::ALL, indirect: true };
        let metered = |scene: &Scene| PacketSight::new(&Arc::new(scene.clone())).metered(metering);
        scene.lighting = Lighting { lights: Vec::new(), sky: argus_scene::Sky::BLACK, exposure: 1.0 };
        assert_eq!(metered(&scene), None);
        scene.instances.clear();
        assert_eq!(metered(&scene), None);
    }

    #[test]
    fn light_is_the_same_at_a_million_metres() {
        let scene = argus_scene::procedural::rooms(20);
        let mut far = scene.clone();
        let by = DVec3::new(1e6, -2e6, 3e6);
        for instance in &mut far.instances {
            instance.world_from_mesh.translation += by;
        }
        for light in &mut far.lighting.lights {
            if let argus_scene::Light::Point { position, .. } | argus_scene::Light::Spot { position, .. } =
                light
            {
                *position += by;
            }
        }
        for named in &mut far.cameras {
            named.camera.eye += by;
            named.camera.target += by;
        }
        let [near, far] = [&scene, &far].map(|scene| light(scene, LightEffects::ALL, true));
        assert!((near / far - 1.0).abs() < 0.02, "{near} {far}");
    }
}
