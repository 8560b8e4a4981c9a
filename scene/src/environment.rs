//! Environment maps: the sky of a scene as an image of all directions (equirectangular).
//!
//! # Directions
//!
//! Directions of the world meet texels as in Mitsuba's `envmap`: the top row is +Y, the bottom row −Y, and the centre of
//! the image is +Z, the side that the front of a glTF asset faces. The left and right edges meet at −Z, and +X is a quarter
//! of the width from the left. Texel centres lie at half integers. Between them radiance is bilinear, across the edges too;
//! within half a texel of a pole it is that of the first or last row.
//!
//! # Small bright regions become lights
//!
//! Few of the rays that look for the sky would meet a sun of half a degree, and those few would be noise. So a map is split
//! once, when it is loaded ([`Environment::new`]), and everything that shades or casts rays uses the same two parts:
//!
//! - the strongest compact regions above a [threshold](Environment) become directional lights with the regions' mean
//!   direction, angular radius and irradiance;
//! - the map keeps the rest. It is at most as bright as the threshold there, which is at least the white of a display, so
//!   that the sun is still seen in the sky. No energy is lost: what the map loses the lights have.
//!
//! Regions that are too wide for a light stay in the map, where many rays meet them.

use std::f64::consts::{PI, TAU};
use std::sync::Arc;

use glam::{DVec3, Vec3};

use crate::environment_map::{direction_of, solid_angle};
use crate::{EnvironmentMap, Light, Lighting, Scene, SceneHash, Sky};

/// Most texels along the width of a map.
pub const MOST_COLUMNS: u32 = 8192;

/// Texels brighter than this many times the mean belong to bright regions. The mean counts each texel up to the threshold
/// only, so that a sun does not raise its own threshold.
const BRIGHT: f64 = 8.0;
/// Least threshold: radiance that a display shows as white, as scenes are loaded with an exposure of 1.
const WHITE: f64 = 1.0;
/// Most steps that find the threshold.
const STEPS: u32 = 16;
/// Most lights of a map.
const MOST_LIGHTS: usize = 8;
/// Largest angular radius of a region that becomes a light, radians.
const WIDEST: f64 = 0.3;
/// Least irradiance of a light, as a share of π times the mean radiance.
const WEAKEST: f64 = 0.005;
/// A map that is split for shading: the threshold is eight times the mean radiance, at least 1.
#[derive(Debug, Clone, PartialEq)]
pub struct Environment {
    /// What remains of the map.
    pub map: Arc<EnvironmentMap>,
    /// Directional lights in place of its small bright regions, the strongest first.
    pub lights: Vec<Light>,
    /// What the loader could not show of its file, one line each.
    pub warnings: Vec<String>,
}

/// A region of texels above the threshold.
#[derive(Default)]
struct Region {
    texels: Vec<usize>,
    /// Irradiance of what is above the threshold, on a surface that faces the region.
    irradiance: DVec3,
    /// Luminance of `irradiance`.
    weight: f64,
    /// Sum of directions by weight.
    toward: DVec3,
    /// Sum of solid angles of texels by weight, steradians.
    solid_angle: f64,
}

impl Region {
    /// Angular radius of a disc with the same spread, radians; above [`WIDEST`] for a region without a direction.
    fn radius(&self) -> f64 {
        // Over a disc the mean of 1 − cosine to its middle is half of that at its edge.
        let spread = 1.0 - self.toward.length() / self.weight;
        let of_texels = self.solid_angle / self.weight / (2.0 * TAU);
        (1.0 - 2.0 * (spread + of_texels)).clamp(-1.0, 1.0).acos()
    }
}

impl Environment {
    /// Splits a map. `texels` are linear radiance, row by row from the top: `width` times half as many.
    ///
    /// # Errors
    /// Why no map can have these texels: empty, too large, not twice as wide as high, or a texel that is negative or not
    /// finite.
    pub fn new(width: u32, height: u32, mut texels: Vec<Vec3>) -> Result<Self, String> {
        check_size(width, height)?;
        if texels.len() as u64 != u64::from(width) * u64::from(height) {
            return Err(format!("{} texels, not {width}×{height}", texels.len()));
        }
        if let Some(bad) = texels.iter().position(|texel| !(texel.is_finite() && texel.min_element() >= 0.0))
        {
            let (column, row) = (bad as u32 % width, bad as u32 / width);
            let [r, g, b] = texels[bad].to_array();
            return Err(format!(
                "texel {column}, {row} is ({r}, {g}, {b}): radiance must be finite and not negative"
            ));
        }
        let lights = split([width, height], &mut texels);
        let map = Arc::new(EnvironmentMap::new([width, height], &texels));
        Ok(Self { map, lights, warnings: Vec::new() })
    }
}

/// Checks the size of a map, which is known before its texels are.
///
/// # Errors
/// Why no map can have this size.
pub fn check_size(width: u32, height: u32) -> Result<(), String> {
    if width == 0 || height == 0 {
        return Err("the image is empty".to_owned());
    }
    if u64::from(width) != 2 * u64::from(height) {
        return Err(format!("{width}×{height} texels: a map of all directions is twice as wide as high"));
    }
    if width > MOST_COLUMNS {
        let most = MOST_COLUMNS;
        return Err(format!("{width}×{height} texels: at most {most}×{} are supported", most / 2));
    }
    Ok(())
}

impl Sky {
    /// The sky of a map. The gradient is a fit, for what cannot show the map.
    pub fn of_map(map: Arc<EnvironmentMap>) -> Self {
        let level = [Vec3::X, Vec3::NEG_X, Vec3::Z, Vec3::NEG_Z];
        let horizon = level.iter().map(|d| map.ambient(*d)).sum::<Vec3>() / level.len() as f32;
        let (zenith, ground) = (map.ambient(Vec3::Y), map.ambient(Vec3::NEG_Y));
        Self { zenith, horizon, ground, map: Some(map), reach: None }
    }

    /// Factors of the irradiance of its map ([`EnvironmentMap::harmonics`]) as programs of the GPU read them; zeros
    /// without a map.
    pub fn harmonics(&self) -> [[f32; 4]; 9] {
        let factors = self.map.as_ref().map_or([Vec3::ZERO; 9], |map| *map.harmonics());
        factors.map(|factor| factor.extend(0.0).to_array())
    }
}

impl Scene {
    /// The scene in an environment, which replaces its sky. Its lights stay, except for the sun of a scene without lights
    /// of its own. `file` is the content of the environment's file, which becomes a part of the scene's hash.
    pub fn with_environment(mut self, environment: Environment, file: &[u8]) -> Self {
        let mut lights = match self.lighting == Lighting::default() {
            true => Vec::new(),
            false => std::mem::take(&mut self.lighting.lights),
        };
        lights.extend(environment.lights);
        self.warnings.extend(environment.warnings.iter().map(|line| format!("environment map: {line}")));
        self.lighting =
            Lighting { lights, sky: Sky::of_map(environment.map), exposure: self.lighting.exposure };
        self.hash = self.hash.in_environment(file);
        self
    }
}

impl SceneHash {
    /// The hash of a scene in the environment whose file has this content.
    pub fn in_environment(&self, file: &[u8]) -> Self {
        let mut hasher = blake3::Hasher::new();
        hasher.update(b"environment");
        hasher.update(&self.0);
        hasher.update(file);
        Self(*hasher.finalize().as_bytes())
    }
}

/// Luminance of linear Rec. 709.
fn luminance(color: Vec3) -> f32 {
    Vec3::new(0.2126, 0.7152, 0.0722).dot(color)
}

/// Takes small bright regions out of a map and returns them as lights, the strongest first.
fn split(size: [u32; 2], texels: &mut [Vec3]) -> Vec<Light> {
    let width = size[0] as usize;
    let luminances: Vec<f32> = texels.iter().map(|texel| luminance(*texel)).collect();
    let areas: Vec<f64> = (0..size[1]).map(|row| solid_angle(size, row)).collect();
    let mean_up_to = |most: f64| {
        let rows = luminances.chunks(width).zip(&areas);
        rows.map(|(row, area)| row.iter().map(|l| f64::from(*l).min(most)).sum::<f64>() * area).sum::<f64>()
            / (2.0 * TAU)
    };
    let mut threshold = f64::INFINITY;
    for _ in 0..STEPS {
        let before = threshold;
        threshold = BRIGHT * mean_up_to(before);
        if threshold > before * 0.99 || threshold < WHITE {
            break;
        }
    }
    let threshold = threshold.max(WHITE);
    let least = WEAKEST * PI * mean_up_to(f64::INFINITY);
    let mut regions = regions(size, texels, &luminances, &areas, threshold);
    regions.retain(|region| region.weight > least && region.radius() <= WIDEST);
    regions.sort_by(|a, b| b.weight.total_cmp(&a.weight));
    regions.truncate(MOST_LIGHTS);
    let light = |region: Region| {
        for &texel in &region.texels {
            texels[texel] *= (threshold / f64::from(luminances[texel])) as f32;
        }
        Light::Directional {
            direction: -region.toward.normalize(),
            irradiance: region.irradiance.as_vec3(),
            angular_radius: region.radius(),
        }
    };
    regions.into_iter().map(light).collect()
}

/// The connected regions of texels above a threshold, across the left and right edge too.
fn regions(
    size: [u32; 2],
    texels: &[Vec3],
    luminances: &[f32],
    areas: &[f64],
    threshold: f64,
) -> Vec<Region> {
    let [width, height] = size.map(|side| side as usize);
    let mut is_open: Vec<bool> =
        luminances.iter().map(|luminance| f64::from(*luminance) > threshold).collect();
    let mut regions = Vec::new();
    for first in 0..is_open.len() {
        if !std::mem::take(&mut is_open[first]) {
            continue;
        }
        let mut region = Region::default();
        let mut waiting = vec![first];
        while let Some(texel) = waiting.pop() {
            let (column, row) = (texel % width, texel / width);
            let luminance = f64::from(luminances[texel]);
            let share = 1.0 - threshold / luminance;
            let irradiance = texels[texel].as_dvec3() * (share * areas[row]);
            let weight = luminance * share * areas[row];
            region.irradiance += irradiance;
            region.weight += weight;
            region.toward += direction_of(size, column as u32, row as u32) * weight;
            region.solid_angle += areas[row] * weight;
            region.texels.push(texel);
            for row in row.saturating_sub(1)..=(row + 1).min(height - 1) {
                for column in [column + width - 1, column, column + 1] {
                    let next = row * width + column % width;
                    if std::mem::take(&mut is_open[next]) {
                        waiting.push(next);
                    }
                }
            }
        }
        regions.push(region);
    }
    regions
}

#[cfg(test)]
mod tests;
