//! The passes that a scene needs, and why.

use argus_scene::effects::SHARED_STAGE;
use argus_scene::{Effect, Light, LightEffects, Scene, Sky};

use crate::resident::{DrawClass, Resident};
use crate::{Indirect, SamplerSettings};

/// Whether a pass, or a part of one, runs for this scene.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PassPlan {
    /// Name. A pass has the name of its row in the timing table.
    pub name: &'static str,
    /// Whether it runs.
    pub on: bool,
    /// The property of the scene, or the setting, that switches it on or off.
    pub why: String,
}

/// The plan for a scene on the device.
pub(crate) fn pass_plan(
    scene: &Scene,
    resident: &Resident,
    settings: &SamplerSettings,
    has_layers: bool,
) -> Vec<PassPlan> {
    let effects = scene.effects();
    let has = |effect| effects.contains(&effect);
    let count = |test: &dyn Fn(DrawClass) -> bool| -> usize {
        resident.instances.iter().filter(|i| test(i.class)).count()
    };
    let row = |name, on, why: String| PassPlan { name, on, why };
    let (opaque, cutouts) = (count(&|c| !c.cutout), count(&|c| c.cutout));
    let lights = scene.lighting.lights.len();
    let textures = scene.textures.len();
    let features = resident.features;
    let said = |present, yes: &str, no: &str| if present { yes.to_owned() } else { no.to_owned() };
    let mut plan = vec![
        row(
            "visibility",
            opaque + cutouts > 0,
            format!("{} instances can be seen; rasterised or traced, as the job says", opaque + cutouts),
        ),
        row("trace rays", true, "pixels that no sample saw".to_owned()),
        row("test alpha", cutouts > 0, format!("{cutouts} of them have alpha-tested materials")),
        row(
            "blend layers",
            has_layers,
            said(has_layers, "a material is transparent by alpha", "nothing is transparent by alpha"),
        ),
        row("shade view", true, "direct views, with what their eyes see reflected".to_owned()),
        row(
            "shade whole texels",
            true,
            "samples: texels in which one triangle is seen are shaded once".to_owned(),
        ),
        row(
            "shade split texels",
            true,
            format!(
                "of {} sub-samples those of the surface that covers most, once a triangle",
                settings.sub_samples
            ),
        ),
        row("textures", features.srgb_textures || features.linear_textures, format!("{textures} textures")),
        row(
            "perturb normals",
            features.normal_maps,
            said(features.normal_maps, "a material has a normal map", "no material has a normal map"),
        ),
        row("emit", has(Effect::Emission), said(has(Effect::Emission), "a material emits", "nothing emits")),
        row("light", lights > 0, format!("{lights} directional, point and spot lights")),
        probes(scene, features.specular),
        indirect(settings.indirect, lights > 0 || has(Effect::Emission)),
        row("store texels", true, "samples, as they are kept and sent".to_owned()),
        row(
            "normal and specular planes",
            features.specular,
            said(features.specular, "the compositor adds reflection per view", "nothing is glossy"),
        ),
        row("resolve color", true, "direct views that ask for colour".to_owned()),
        row(
            "resolve range",
            true,
            "direct views that ask for range, along rays through pixel centres".to_owned(),
        ),
        row(
            "pose",
            has(Effect::Animation),
            said(has(Effect::Animation), "where an epoch is another than the last", "nothing moves"),
        ),
    ];
    plan.extend(direct(scene, settings.effects));
    plan
}

/// Rays to lights, sky and emitters: a row for what they share, and one for each effect.
fn direct(scene: &Scene, effects: LightEffects) -> [PassPlan; 5] {
    let asked = |name, asked: bool, present: bool, yes: &str, no: &str| {
        let why = match (asked, present) {
            (false, _) => "it is off in the effect plan",
            (true, true) => yes,
            (true, false) => no,
        };
        PassPlan { name, on: asked && present, why: why.to_owned() }
    };
    let lights = &scene.lighting.lights;
    let soft = effects.shadows && effects.soft_shadows;
    let why = match effects.any() {
        true => format!("rays start from visible surfaces: {effects}"),
        false => "lights and sky are added unblocked, while surfaces are shaded".to_owned(),
    };
    [
        PassPlan { name: SHARED_STAGE, on: effects.any(), why },
        asked("trace shadows", effects.shadows, !lights.is_empty(), "a ray to each light", "no light"),
        asked(
            "trace penumbras",
            soft,
            lights.iter().any(Light::is_extended),
            "rays over a light's disc where neighbours do not agree",
            "no light has an extent",
        ),
        asked(
            "trace sky",
            effects.sky_visibility,
            scene.lighting.sky != Sky::BLACK,
            "rays to the sky",
            "the sky is black",
        ),
        asked(
            "trace emitters",
            effects.emitters,
            scene.effects().contains(&Effect::Emission),
            "rays to emitting triangles",
            "nothing emits",
        ),
    ]
}

/// Reflection probes.
fn probes(scene: &Scene, glossy: bool) -> PassPlan {
    let count = if glossy { scene.reflectors(u32::MAX).len() } else { 0 };
    let why = match count {
        0 => "no surface is reflective".to_owned(),
        count => format!("{count} reflective objects, in sets with reflections"),
    };
    PassPlan { name: "reflection probes", on: count > 0, why }
}

fn indirect(setting: Indirect, shines: bool) -> PassPlan {
    let row = |on, why| PassPlan { name: "gather VPLs", on, why };
    match setting {
        Indirect::Off => row(false, "indirect light was not asked for".to_owned()),
        Indirect::Vpl(settings) if !shines && settings.particles == 0 => {
            row(false, "no light and no surface emits".to_owned())
        }
        Indirect::Vpl(settings) => {
            let [vpls, bounces, side, samples] =
                [settings.vpls, settings.bounces, settings.map_side, settings.samples];
            let maps = settings.maps.name();
            let particles = match settings.particles {
                0 => String::new(),
                count => format!(" and {count} particles"),
            };
            let why = format!(
                "{samples} of {vpls} VPLs{particles} a sub-sample, up to {bounces} reflections, {maps} maps of {side}² texels"
            );
            row(true, why)
        }
        // The sky is a source of paths.
        Indirect::Cells(settings) => PassPlan {
            name: "look up light cells",
            on: true,
            why: format!("sky and indirect light: {settings}"),
        },
        Indirect::Paths(settings) => {
            PassPlan { name: "gather paths", on: true, why: format!("a quarter of texels: {settings}") }
        }
        Indirect::Points(_) if !shines => row(false, "no light and no surface emits".to_owned()),
        Indirect::Points(settings) => {
            let why = format!("a receiver or two for {0}×{0} sub-samples: {settings}", settings.block);
            PassPlan { name: "receive light", on: true, why }
        }
    }
}
