//! Lights and what blocks them: largest irradiance, and tests for casters of shadows.

use glam::{DVec3, Vec3};

use super::surfaces::{Body, LEVEL};
use crate::shading::falloff;
use crate::{Bounds, Light, Sky};

/// Largest irradiance of a light within a box. `moves`: light and box may be anywhere.
pub(super) fn irradiance(light: &Light, at: &Bounds, moves: bool) -> Vec3 {
    let nearest = |light: DVec3| if moves { 0.0 } else { distance(light, at) };
    match *light {
        Light::Directional { irradiance, .. } => irradiance,
        Light::Point { position, intensity, range, radius } => {
            intensity * falloff(nearest(position), radius, range)
        }
        Light::Spot { position, intensity, range, radius, .. } => match moves || light.reaches(at) {
            true => intensity * falloff(nearest(position), radius, range),
            false => Vec3::ZERO,
        },
    }
}

/// Distance of a point from a box; 0 within it.
pub(super) fn distance(point: DVec3, at: &Bounds) -> f64 {
    (at.min - point).max(point - at.max).max(DVec3::ZERO).length()
}

/// Distance of two boxes; 0 if they meet.
pub(super) fn distance_of_boxes(a: &Bounds, b: &Bounds) -> f64 {
    (a.min - b.max).max(b.min - a.max).max(DVec3::ZERO).length()
}

/// Half the angle that a light has at the nearest point of a box, radians.
pub(super) fn half_angle(light: &Light, at: &Bounds, moves: bool) -> f64 {
    match *light {
        Light::Directional { angular_radius, .. } => angular_radius,
        Light::Point { position, radius, .. } | Light::Spot { position, radius, .. } => {
            let d = if moves { 0.0 } else { distance(position, at) };
            if radius > 0.0 { (radius / d.max(1e-9)).min(1.0).asin() } else { 0.0 }
        }
    }
}

/// Share of a light's largest irradiance that a convex body can lose to itself: light that its shading normal faces but its
/// triangle does not.
pub(super) fn lost_to_itself(body: &Body, half_angle: f64) -> f64 {
    ((body.bend + half_angle).min(std::f64::consts::FRAC_PI_2).sin() + LEVEL).min(1.0)
}

/// Most bodies that are tested in pairs; of more, one is taken to shade another.
const MOST_PAIRED: usize = 512;

/// The instances whose surfaces may block a light for a surface that it reaches: a body that blocks itself, or one whose
/// box meets the hull of the light and another body. At most one instance is named. Never empty if something casts a
/// shadow.
pub(super) fn caster(light: &Light, bodies: &[Body], moves: bool) -> Option<u32> {
    let lit: Vec<&Body> = bodies
        .iter()
        .filter(|body| body.reflects() && irradiance(light, &body.bounds, moves) != Vec3::ZERO)
        .collect();
    let itself = lit.iter().find(|body| !body.is_convex);
    if let Some(body) = itself {
        return Some(body.instance);
    }
    let first = bodies.first().filter(|_| !lit.is_empty() && bodies.len() > 1)?;
    if moves || bodies.len() > MOST_PAIRED {
        return Some(first.instance);
    }
    let blocks = |caster: &&Body| {
        lit.iter().any(|body| body.instance != caster.instance && !is_apart(&caster.bounds, body, light))
    };
    bodies.iter().find(blocks).map(|caster| caster.instance)
}

/// Whether some plane separates a caster's box from the hull of a light and a body. `false` proves nothing.
fn is_apart(caster: &Bounds, body: &Body, light: &Light) -> bool {
    // Rays begin above a smooth surface by less than this: see `light_sampling::terminator_lift`.
    let lift = body.bounds.size().length() * body.bend.min(std::f64::consts::FRAC_PI_2).sin();
    let (center, half) = (body.bounds.center(), body.bounds.size() * 0.5 + lift);
    let mut both = *caster;
    both.extend(center - half);
    both.extend(center + half);
    // Of the light's end of the hull: centre, half size of a box, and radius of the sphere that each of its points has.
    let (far, far_half, radius) = match *light {
        Light::Directional { direction, angular_radius, .. } => {
            let reach = both.size().length();
            (center - direction * reach, half, reach * angular_radius.tan())
        }
        Light::Point { position, radius, .. } | Light::Spot { position, radius, .. } => {
            (position, DVec3::ZERO, radius)
        }
    };
    let along = (far - center).normalize_or(DVec3::Y);
    let axes = [DVec3::X, DVec3::Y, DVec3::Z];
    let planes = axes.into_iter().chain(axes.map(|axis| along.cross(axis))).chain([along]);
    let slack = 1e-9 * (both.size().length() + both.center().length());
    for normal in planes {
        let spread = normal.abs();
        let near = (normal.dot(center), spread.dot(half));
        let end = (normal.dot(far), spread.dot(far_half) + radius * normal.length());
        let (least, most) = ((near.0 - near.1).min(end.0 - end.1), (near.0 + near.1).max(end.0 + end.1));
        let middle = normal.dot(caster.center());
        let reach = spread.dot(caster.size() * 0.5);
        // NaN separates nothing.
        if middle - reach > most + slack || middle + reach < least - slack {
            return true;
        }
    }
    false
}

/// Largest radiance of a sky.
pub(super) fn brightest(sky: &Sky) -> Vec3 {
    match &sky.map {
        Some(map) => map.brightest(),
        None => sky.zenith.max(sky.horizon).max(sky.ground),
    }
}

/// Largest difference of an open sky's irradiance / π, as the integral that visibility rays estimate, from the blend of
/// [`crate::shading::sky_ambient`], as a share of the difference of brightest and darkest. For maps it is at most 0.09: half
/// the integral of the absolute difference of a clamped cosine from its harmonics up to degree 2.
pub(super) const OPEN_SKY: f32 = 0.17;

/// Largest difference of brightest and darkest in a sky.
pub(super) fn contrast(sky: &Sky) -> Vec3 {
    let darkest = match &sky.map {
        Some(map) => map.darkest(),
        None => sky.zenith.min(sky.horizon).min(sky.ground),
    };
    brightest(sky) - darkest
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::light_sampling::{cosine_direction, disc_point, r2};
    use crate::shading::{sky_ambient, sky_radiance};

    #[test]
    fn an_open_skys_integral_differs_from_its_blend_by_less_than_the_constant() {
        for colors in [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 1.0], [0.0, 1.0, 1.0]] {
            let [zenith, horizon, ground] = colors.map(Vec3::splat);
            let sky = Sky { zenith, horizon, ground, map: None, reach: None };
            for step in -50..=50 {
                let y = f64::from(step) / 50.0;
                let normal = DVec3::new((1.0 - y * y).sqrt(), y, 0.0);
                let directions = (0..2048).map(|i| cosine_direction(normal, disc_point(r2(i))).as_vec3());
                let integral = directions.map(|d| sky_radiance(&sky, d).x).sum::<f32>() / 2048.0;
                let blend = sky_ambient(&sky, normal.as_vec3()).x;
                assert!((integral - blend).abs() < OPEN_SKY, "{colors:?} at {y}: {integral}, {blend}");
            }
        }
    }

    #[test]
    fn a_box_outside_of_a_spots_cone_has_no_light() {
        let spot = Light::Spot {
            position: DVec3::ZERO,
            direction: DVec3::NEG_Y,
            intensity: Vec3::splat(8.0),
            range: Some(10.0),
            inner_cone: 0.1,
            outer_cone: 0.5,
            radius: 0.01,
        };
        let at = |center: DVec3| Bounds { min: center - 0.5, max: center + 0.5 };
        assert_eq!(irradiance(&spot, &at(DVec3::X * 5.0), false), Vec3::ZERO, "beside the cone");
        assert_eq!(irradiance(&spot, &at(DVec3::Y * -11.0), false), Vec3::ZERO, "beyond the range");
        assert!((irradiance(&spot, &at(DVec3::Y * -2.5), false).x - 2.0).abs() < 0.02);
        let touching = irradiance(&spot, &at(DVec3::X * 5.0), true).x;
        assert!(
            (touching / (8.0 / 0.01f32.powi(2)) - 1.0).abs() < 1e-5,
            "what moves may be at the light: {touching}"
        );
    }
}
