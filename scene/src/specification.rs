//! The specification of a sample set: what the bytes of its samples are a function of, beside scene, version and cameras.

use std::fmt;

use serde::{Deserialize, Serialize};

use crate::{Indirect, InvalidField, LightEffects, Plan, ReflectionProbeSet, Sampling, Visibility};

/// How a sample set is rendered. All samples of a set have one specification, whichever worker renders them. The
/// specification of a frame is that of its samples, or how it was rendered from triangles.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Specification {
    /// The visibility backend: backends may find another triangle along edges.
    pub visibility: Visibility,
    /// What was rendered from. A direct view is rendered from triangles.
    pub sampling: Sampling,
    /// Sub-samples of each texel of a sample: 1, 4 or 16. A direct view does not depend on them.
    pub sub_samples: u32,
    /// Effects of direct light: shadows, and what else blocks or adds to it.
    pub effects: LightEffects,
    /// Light that surfaces reflect onto one another, and glowing particles.
    pub indirect: Indirect,
    /// Reflection probes of glossy and transparent surfaces; `None` where these reflect lights and the sky alone.
    pub reflections: Option<ReflectionProbeSet>,
    /// From linear radiance to display-linear values.
    pub exposure: f32,
}

/// BLAKE3 of a specification: equal for equal specifications, in every process and release.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub struct SpecificationHash(pub [u8; 32]);

impl fmt::Display for SpecificationHash {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.iter().try_for_each(|byte| write!(f, "{byte:02x}"))
    }
}

impl fmt::Debug for SpecificationHash {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

/// A field in which two specifications differ.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Difference {
    /// The field's name.
    pub field: &'static str,
    /// Its value in the first specification.
    pub first: String,
    /// Its value in the second specification.
    pub second: String,
}

impl Specification {
    /// Sub-samples of a texel unless a user says otherwise.
    pub const USUAL_SUB_SAMPLES: u32 = 4;

    /// Rejects values outside the documented ones.
    ///
    /// # Errors
    /// The field, by name.
    pub fn validate(&self) -> Result<(), InvalidField> {
        check_sub_samples(self.sub_samples)?;
        self.indirect.validate()?;
        self.indirect.check_effects(self.effects)?;
        self.reflections.map_or(Ok(()), |maps| maps.validate())?;
        InvalidField::positive("exposure", self.exposure).map(drop)
    }

    /// Its hash, which is stable.
    pub fn hash(&self) -> SpecificationHash {
        SpecificationHash(*blake3::hash(self.to_string().as_bytes()).as_bytes())
    }

    /// The first field in which another specification differs, of those that the bytes of a frame of that plan depend on.
    pub fn difference(&self, other: &Self, plan: &Plan) -> Option<Difference> {
        let of_samples = plan.needs_samples();
        let matters = |field| of_samples || !["sampling", "sub_samples"].contains(&field);
        let pairs = self.fields().into_iter().zip(other.fields());
        let mut pairs = pairs.map(|((field, first), (_, second))| Difference { field, first, second });
        pairs.find(|pair| pair.first != pair.second && matters(pair.field))
    }

    /// Its fields by name, each in words that say all of it.
    fn fields(&self) -> [(&'static str, String); 7] {
        let Self { visibility, sampling, sub_samples, effects, indirect, reflections, exposure } = self;
        let sampling = match sampling {
            Sampling::Triangles => sampling.name().to_owned(),
            Sampling::MegaViews(settings) => format!("{} {settings}", sampling.name()),
        };
        let reflections = reflections.map_or("off".to_owned(), |probes| probes.to_string());
        [
            ("visibility", visibility.name().to_owned()),
            ("sampling", sampling),
            ("sub_samples", sub_samples.to_string()),
            ("effects", effects.to_string()),
            ("indirect", indirect.to_string()),
            ("reflections", reflections),
            ("exposure", exposure.to_string()),
        ]
    }
}

impl Default for Specification {
    fn default() -> Self {
        Self {
            visibility: Visibility::default(),
            sampling: Sampling::default(),
            sub_samples: Self::USUAL_SUB_SAMPLES,
            effects: LightEffects::NONE,
            indirect: Indirect::default(),
            reflections: None,
            exposure: 1.0,
        }
    }
}

impl fmt::Display for Specification {
    /// All fields, which the hash is over.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let fields = self.fields().map(|(field, value)| format!("{field} {value}"));
        f.write_str(&fields.join("; "))
    }
}

/// Rejects a number of sub-samples that samplers do not render.
///
/// # Errors
/// `sub_samples`.
pub fn check_sub_samples(sub_samples: u32) -> Result<(), InvalidField> {
    match sub_samples {
        1 | 4 | 16 => Ok(()),
        _ => Err(InvalidField::new("sub_samples", format!("must be 1, 4 or 16, not {sub_samples}"))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    use crate::{Bounds, MegaViews, PointSettings, ProbeEye, ProbeSource, Reflections, VplSettings, Warp};

    /// Specifications that differ from the default in one field each.
    fn others() -> [(&'static str, Specification); 7] {
        let usual = Specification::default();
        let maps = ReflectionProbeSet { settings: Reflections::default(), count: 3, eye: None };
        [
            ("visibility", Specification { visibility: Visibility::Cpu, ..usual }),
            ("sampling", Specification { sampling: Sampling::MegaViews(MegaViews::default()), ..usual }),
            ("sub_samples", Specification { sub_samples: 16, ..usual }),
            ("effects", Specification { effects: LightEffects::ALL, ..usual }),
            ("indirect", Specification { indirect: Indirect::Points(PointSettings::default()), ..usual }),
            ("reflections", Specification { reflections: Some(maps), ..usual }),
            ("exposure", Specification { exposure: 0.5, ..usual }),
        ]
    }

    #[test]
    fn the_hash_of_a_specification_is_the_same_in_every_release() {
        let usual = Specification::default();
        let text = "visibility raster; sampling triangles; sub_samples 4; effects none; indirect off; reflections off; exposure 1";
        assert_eq!(usual.to_string(), text);
        assert_eq!(usual.hash().0, *blake3::hash(text.as_bytes()).as_bytes());
    }

    #[test]
    fn each_field_changes_the_hash_and_is_named_as_the_difference() {
        let (usual, warp) = (Specification::default(), Plan::Warp(Warp::default()));
        let direct = Plan::direct(1);
        for (field, other) in others() {
            assert_ne!(usual.hash(), other.hash(), "{field}");
            assert_eq!(usual.difference(&other, &warp).unwrap().field, field);
            let of_samples = ["sampling", "sub_samples"].contains(&field);
            assert_eq!(usual.difference(&other, &direct).is_none(), of_samples, "{field}");
            assert_eq!(other.difference(&other, &warp), None);
            assert_eq!(other.validate(), Ok(()));
        }
    }

    #[test]
    fn every_setting_of_indirect_light_changes_the_hash() {
        let usual = VplSettings::default();
        let hash =
            |settings| Specification { indirect: Indirect::Vpl(settings), ..Specification::default() }.hash();
        for other in [
            VplSettings { vpls: 8, ..usual },
            VplSettings { particles: 8, ..usual },
            VplSettings { bounces: 2, ..usual },
            VplSettings { samples: 4, ..usual },
            VplSettings { filter: 0, ..usual },
            VplSettings { clamp: 0.02, ..usual },
            VplSettings { seed: 2, ..usual },
        ] {
            assert_ne!(hash(usual), hash(other), "{other:?}");
        }
    }

    #[test]
    fn probes_from_points_differ_from_those_of_an_octree_and_with_their_viewers() {
        let octree = ReflectionProbeSet { settings: Reflections::default(), count: 3, eye: None };
        let box_of = |edge: f64| Bounds { min: DVec3::ZERO, max: DVec3::splat(edge) };
        let points = |edge, pixels, budget| ReflectionProbeSet {
            settings: Reflections { source: ProbeSource::Points { budget }, ..octree.settings },
            eye: Some(ProbeEye { viewpoints: box_of(edge), pixels }),
            ..octree
        };
        let all = [
            octree,
            points(1.0, 192.0, 4096),
            points(1.5, 192.0, 4096),
            points(1.0, 191.5, 4096),
            points(1.0, 192.0, 4097),
        ];
        let hashes =
            all.map(|probes| Specification { reflections: Some(probes), ..Specification::default() }.hash());
        for (number, hash) in hashes.iter().enumerate() {
            assert!(!hashes[..number].contains(hash), "{}", all[number]);
        }
    }

    #[test]
    fn values_out_of_range_are_refused_by_field() {
        let usual = Specification::default();
        let field = |specification: Specification| specification.validate().unwrap_err().field;
        assert_eq!(field(Specification { sub_samples: 3, ..usual }), "sub_samples");
        let indirect = Indirect::Vpl(VplSettings { bounces: 9, ..VplSettings::default() });
        assert_eq!(field(Specification { indirect, ..usual }), "indirect.bounces");
        for exposure in [0.0, -1.0, f32::NAN, f32::INFINITY] {
            assert_eq!(field(Specification { exposure, ..usual }), "exposure");
        }
    }
}
