//! One light in place of a scene's own, so that what is measured is what it is said to be.

use std::str::FromStr;

use argus_scene::{Light, Lighting, Scene, Sky};
use glam::{DVec3, Vec3};

/// A light as users write it: `point:X,Y,Z` or `spot:X,Y,Z:DX,DY,DZ:HALF_DEG`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LightSpec {
    position: DVec3,
    /// Unit direction and half angle of a spot's cone, radians.
    cone: Option<(DVec3, f64)>,
}

impl LightSpec {
    /// Lights a scene by this alone, under a black sky, as brightly as its size asks for.
    pub fn light(&self, scene: &mut Scene) {
        let intensity = Vec3::splat((scene.bounds().size().length() * 0.5).powi(2) as f32);
        let position = self.position;
        let light = match self.cone {
            None => Light::Point { position, intensity, range: None },
            Some((direction, half)) => Light::Spot {
                position,
                direction,
                intensity,
                range: None,
                inner_cone: half * 0.9,
                outer_cone: half,
            },
        };
        scene.lighting = Lighting { lights: vec![light], sky: Sky::BLACK, exposure: 1.0 };
    }
}

impl FromStr for LightSpec {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || format!("point:X,Y,Z or spot:X,Y,Z:DX,DY,DZ:HALF_DEG is wanted, not {text}");
        let vector = |part: &str| {
            let numbers: Vec<f64> = part.split(',').filter_map(|n| n.trim().parse().ok()).collect();
            let [x, y, z] = numbers[..] else { return Err(wrong()) };
            Some(DVec3::new(x, y, z)).filter(|v| v.is_finite()).ok_or_else(wrong)
        };
        let parts: Vec<&str> = text.split(':').collect();
        match parts[..] {
            ["point", position] => Ok(Self { position: vector(position)?, cone: None }),
            ["spot", position, direction, half] => {
                let direction = vector(direction)?.try_normalize().ok_or_else(wrong)?;
                let half = half.parse::<f64>().ok().filter(|deg| *deg > 0.0 && *deg < 90.0);
                let half =
                    half.ok_or_else(|| format!("a half angle between 0 and 90 is wanted in {text}"))?;
                Ok(Self { position: vector(position)?, cone: Some((direction, half.to_radians())) })
            }
            _ => Err(wrong()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lights_are_read_as_they_are_written_and_others_refused() {
        let spot: LightSpec = "spot:0,10,0:0,-2,0:35".parse().unwrap();
        assert_eq!(spot.cone, Some((DVec3::NEG_Y, 35f64.to_radians())));
        assert_eq!("point:1,2,-3".parse::<LightSpec>().unwrap().position, DVec3::new(1.0, 2.0, -3.0));
        for wrong in [
            "",
            "point",
            "point:1,2",
            "spot:0,0,0:0,0,0:35",
            "spot:0,0,0:0,1,0:95",
            "sun:1,2,3",
            "point:nan,0,0",
        ] {
            assert!(wrong.parse::<LightSpec>().is_err(), "{wrong}");
        }
    }
}
