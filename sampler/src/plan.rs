//! Which passes a scene calls for, and why.

use argus_scene::{Effect, Scene};

use crate::SamplerKnobs;
use crate::resident::{DrawClass, Resident};

/// Whether one piece of work runs for this scene.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PassPlan {
    /// What it does; a pass has the name of its timing row.
    pub name: &'static str,
    /// Whether it runs.
    pub on: bool,
    /// What of the scene, or which knob, calls for it or makes it needless.
    pub why: String,
}

/// The plan for a scene as it lies on the device.
pub(crate) fn plan(scene: &Scene, resident: &Resident, knobs: &SamplerKnobs) -> Vec<PassPlan> {
    let effects = scene.effects();
    let has = |effect| effects.contains(&effect);
    let count = |test: &dyn Fn(DrawClass) -> bool| -> usize {
        resident.instances.iter().filter(|i| test(i.class)).count()
    };
    let row = |name, on, why: String| PassPlan { name, on, why };
    let (opaque, cutouts) = (count(&|c| !c.cutout), count(&|c| c.cutout));
    let lights = scene.lighting.lights.len();
    let textures = scene.textures.len();
    let specular = has(Effect::Specular);
    let said = |present, yes: &str, no: &str| if present { yes.to_owned() } else { no.to_owned() };
    vec![
        row("rasterise opaque", opaque > 0, format!("{opaque} instances of opaque materials")),
        row("rasterise cut-outs", cutouts > 0, format!("{cutouts} instances of alpha-tested materials")),
        row("shade view", true, "direct views are shaded with their specular part".to_owned()),
        row(
            "shade sample",
            !specular,
            said(specular, "glossy samples are shaded instead", "nothing is glossy"),
        ),
        row("shade glossy sample", specular, said(specular, "a material is glossy", "nothing is glossy")),
        row("look textures up", textures > 0, format!("{textures} textures")),
        row(
            "perturb normals",
            has(Effect::NormalMap),
            said(has(Effect::NormalMap), "a material has a normal map", "no material has a normal map"),
        ),
        row("emit", has(Effect::Emission), said(has(Effect::Emission), "a material emits", "nothing emits")),
        row("light", lights > 0, format!("{lights} punctual lights")),
        row(
            "choose surface",
            knobs.sub_samples > 1,
            format!("{} sub-samples in a texel of a sample", knobs.sub_samples),
        ),
        row(
            "normal and specular planes",
            specular,
            said(specular, "the compositor adds reflection per view", "nothing is glossy"),
        ),
        row("resolve range", true, "when a view asks for range, from rays through pixel centres".to_owned()),
    ]
}
