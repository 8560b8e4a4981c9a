//! Which light a scene is shown in: its own, its own with sun and sky, or the light of interiors.
//!
//! A choice is made once, by metering (`argus-sampler`). Every process that has the scene's files then finds the same scene in
//! that light: the scene's hash covers the choice ([`SceneHash::in_light`]), and [`Scene::in_light_of`] finds the choice by
//! the hash.

use std::fmt;
use std::str::FromStr;

use glam::Vec3;
use serde::{Deserialize, Serialize};

use crate::{InvalidField, Light, Lighting, Scene, SceneHash, Sky};

/// What a user asks for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum LightRequest {
    /// The first of the others that lights what is seen.
    #[default]
    Auto,
    /// The scene's own lights, emitting surfaces and environment.
    File,
    /// The scene's own light, with a sun and a sky. An environment takes their place.
    Sky,
    /// The scene's own light, with the light of interiors.
    Interior,
}

impl LightRequest {
    /// All requests.
    pub const ALL: [Self; 4] = [Self::Auto, Self::File, Self::Sky, Self::Interior];

    /// The name in arguments.
    pub fn name(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::File => "file",
            Self::Sky => "sky",
            Self::Interior => "interior",
        }
    }
}

impl fmt::Display for LightRequest {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for LightRequest {
    type Err = InvalidField;

    fn from_str(text: &str) -> Result<Self, InvalidField> {
        let found = Self::ALL.into_iter().find(|request| request.name() == text);
        found.ok_or_else(|| {
            InvalidField::new("light", format!("must be auto, file, sky or interior, not `{text}`"))
        })
    }
}

/// What is added to a scene's own light.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum AddedLight {
    /// Nothing.
    None,
    /// Sun and sky.
    Sky,
    /// A sky that is blocked only by what is near. It stands for light between surfaces. Nearer than so many steps of a
    /// quarter of an octave above 1 m.
    Interior(i32),
}

/// The light that a scene is shown in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct LightChoice {
    /// What is added to the scene's own light.
    pub added: AddedLight,
    /// Stops by which the scene's own light is made stronger. It brings radiances that samples cannot store near to 1, and
    /// lamps that light little of a scene near to the light that is added.
    pub own_stops: i32,
}

/// Steps of [`AddedLight::Interior`] in an octave.
const STEPS: f64 = 4.0;
/// Least and greatest step: about a micrometre, and a million kilometres.
const REACHES: std::ops::RangeInclusive<i32> = -80..=120;

impl LightChoice {
    /// Most stops of the own light in either direction.
    pub const MOST_STOPS: i32 = 64;

    /// The scene's own light as it is.
    pub const FILE: Self = Self { added: AddedLight::None, own_stops: 0 };
    /// Sun and sky, and the scene's own light as it is.
    pub const SKY: Self = Self { added: AddedLight::Sky, own_stops: 0 };

    /// The light of interiors that is blocked within about `reach` metres.
    pub fn interior(reach: f64) -> Self {
        // Saturates; NaN is 0.
        let step = ((reach.log2() * STEPS).round() as i32).clamp(*REACHES.start(), *REACHES.end());
        Self { added: AddedLight::Interior(step), own_stops: 0 }
    }

    /// The same with stronger light of the scene's own.
    #[must_use]
    pub fn with_own(self, stops: i32) -> Self {
        Self { own_stops: stops.clamp(-Self::MOST_STOPS, Self::MOST_STOPS), ..self }
    }

    /// Distance in metres within which the added light is blocked; `None`: whatever the distance.
    pub fn reach(self) -> Option<f64> {
        match self.added {
            AddedLight::Interior(step) => Some((f64::from(step) / STEPS).exp2()),
            AddedLight::None | AddedLight::Sky => None,
        }
    }

    /// All choices.
    fn all() -> impl Iterator<Item = Self> {
        let added = [AddedLight::None, AddedLight::Sky].into_iter().chain(REACHES.map(AddedLight::Interior));
        added.flat_map(|added| {
            (-Self::MOST_STOPS..=Self::MOST_STOPS).map(move |own_stops| Self { added, own_stops })
        })
    }
}

impl fmt::Display for LightChoice {
    /// For people: a reach is rounded.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.added {
            AddedLight::None => f.write_str("file")?,
            AddedLight::Sky => f.write_str("sky")?,
            AddedLight::Interior(_) => write!(f, "interior within {:.3} m", self.reach().unwrap_or(0.0))?,
        }
        if self.own_stops != 0 {
            write!(f, ", own light {:+} stops", self.own_stops)?;
        }
        Ok(())
    }
}

impl Sky {
    /// The light of interiors: nearly even, and brighter from above, so that floor, walls and ceiling differ.
    fn interior(reach: Option<f64>) -> Self {
        let [zenith, horizon, ground] = [1.0, 0.8, 0.5].map(Vec3::splat);
        Self { zenith, horizon, ground, map: None, reach }
    }
}

impl Light {
    /// Makes it stronger.
    pub fn scale(&mut self, factor: f32) {
        match self {
            Self::Directional { irradiance, .. } => *irradiance *= factor,
            Self::Point { intensity, .. } | Self::Spot { intensity, .. } => *intensity *= factor,
        }
    }
}

impl Scene {
    /// Whether its lighting is the sun and sky of files without light.
    pub fn has_default_light(&self) -> bool {
        self.lighting == Lighting::default()
    }

    /// The choice that it was opened in.
    pub fn opened_light(&self) -> LightChoice {
        if self.has_default_light() { LightChoice::SKY } else { LightChoice::FILE }
    }

    /// Lights and sky of its own: nothing if it was opened in sun and sky. For a scene as it was opened.
    pub fn own_lighting(&self) -> Lighting {
        match self.has_default_light() {
            true => Lighting { lights: Vec::new(), sky: Sky::BLACK, exposure: self.lighting.exposure },
            false => self.lighting.clone(),
        }
    }

    /// A scene as it was opened, in a light. Its hash covers any choice but the one that it was opened in.
    #[must_use]
    pub fn in_light(mut self, choice: LightChoice) -> Self {
        if choice == self.opened_light() {
            return self;
        }
        self.hash = self.hash.in_light(choice);
        let factor = (choice.own_stops as f32).exp2();
        self.materials.iter_mut().for_each(|material| material.emissive *= factor);
        self.lighting = self.lighting_in(choice);
        self
    }

    /// Lights and sky of a scene as it was opened, in a light: those of its own first.
    pub fn lighting_in(&self, choice: LightChoice) -> Lighting {
        let Lighting { mut lights, sky, exposure } = self.own_lighting();
        let factor = (choice.own_stops as f32).exp2();
        lights.iter_mut().for_each(|light| light.scale(factor));
        match choice.added {
            AddedLight::None => {
                let mut sky = sky;
                for color in [&mut sky.zenith, &mut sky.horizon, &mut sky.ground] {
                    *color *= factor;
                }
                // The scene's own exposure shows its own radiances.
                Lighting { lights, sky, exposure: exposure / factor }
            }
            // An environment is a sky of the scene's own.
            AddedLight::Sky if sky.map.is_some() => Lighting { lights, sky, exposure },
            AddedLight::Sky => {
                lights.push(Light::sun());
                Lighting { lights, sky: Sky::DAYLIGHT, exposure }
            }
            AddedLight::Interior(_) => Lighting { lights, sky: Sky::interior(choice.reach()), exposure },
        }
    }

    /// A scene as it was opened, in the light in which it has a hash; `None` if it is another scene.
    pub fn in_light_of(self, hash: SceneHash) -> Option<Self> {
        let choice = self.hash.choice_of(hash)?;
        Some(match choice {
            None => self,
            Some(choice) => self.in_light(choice),
        })
    }
}

impl SceneHash {
    /// The hash of a scene in a light.
    pub fn in_light(&self, choice: LightChoice) -> Self {
        let mut hasher = blake3::Hasher::new();
        hasher.update(b"light");
        hasher.update(&self.0);
        // Steps and stops as whole numbers: the words for people round them.
        hasher.update(format!("{choice:?}").as_bytes());
        Self(*hasher.finalize().as_bytes())
    }

    /// The light in which the scene of this hash, as it was opened, has another one: the inner `None` is the light that it was
    /// opened in. `None` if it is the hash of another scene.
    pub fn choice_of(&self, lit: Self) -> Option<Option<LightChoice>> {
        match *self == lit {
            true => Some(None),
            false => LightChoice::all().find(|choice| self.in_light(*choice) == lit).map(Some),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn requests_are_written_as_they_are_read_and_others_are_refused() {
        for request in LightRequest::ALL {
            assert_eq!(request.to_string().parse(), Ok(request));
        }
        assert_eq!("day".parse::<LightRequest>().unwrap_err().field, "light");
    }

    #[test]
    fn each_choice_has_a_hash_of_its_own_by_which_it_is_found() {
        let plain = SceneHash([7; 32]);
        let hashes: std::collections::BTreeSet<_> =
            LightChoice::all().map(|choice| plain.in_light(choice)).collect();
        assert_eq!(hashes.len(), LightChoice::all().count());
        for choice in [
            LightChoice::FILE,
            LightChoice::SKY.with_own(-9),
            LightChoice::interior(0.3),
            LightChoice::interior(1e4).with_own(12),
        ] {
            assert_eq!(plain.choice_of(plain.in_light(choice)), Some(Some(choice)));
        }
        assert_eq!(plain.choice_of(plain), Some(None));
        assert_eq!(plain.choice_of(SceneHash([8; 32])), None);
    }

    #[test]
    fn reaches_are_kept_within_a_tenth() {
        for reach in [1e-5, 0.03, 0.7, 1.0, 12.0, 1e6] {
            let kept = LightChoice::interior(reach).reach().unwrap();
            assert!((kept / reach - 1.0).abs() < 0.1, "{reach}: {kept}");
        }
        for odd in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e300] {
            let kept = LightChoice::interior(odd).reach().unwrap();
            assert!(kept > 0.0 && kept.is_finite(), "{odd}: {kept}");
        }
    }
}
