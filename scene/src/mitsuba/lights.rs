//! Lights and sky as Mitsuba's emitters.

use std::f64::consts::{PI, TAU};
use std::io;
use std::path::Path;

use glam::{DVec3, Vec3};
use image::{ImageBuffer, Rgb};

use super::xml::{Xml, numbers, rgb};
use crate::shading::{sky_ambient, sky_radiance};
use crate::{Light, Sky};

/// Radiance of the exported sky.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum SkyLight {
    /// As it is seen: [`crate::shading::sky_radiance`].
    #[default]
    Seen,
    /// The sky that lights an unoccluded matt surface exactly as [`crate::shading::sky_ambient`] approximates it. It tells a
    /// fault of the export from that approximation.
    Ambient,
}

/// Columns of the sky's panorama.
const SKY_COLUMNS: u32 = 64;
/// Rows of the sky's panorama: an odd number, so that one of them is the horizon.
const SKY_ROWS: u32 = 1025;
/// Texels on a side of a spot light's cone.
const CONE_SIDE: u32 = 512;
/// Distance of a disc that stands for a far light, in diameters of the scene: its direction then differs by a thousandth
/// across the scene.
const DISC_DISTANCE: f64 = 1000.0;

/// The space that the scene takes, for lights from afar.
#[derive(Clone, Copy)]
pub(super) struct Space {
    /// The exported scene's zero in the world, metres.
    pub(super) origin: DVec3,
    /// Middle of the scene, world space, metres.
    pub(super) center: DVec3,
    /// Diameter of the scene, metres.
    pub(super) diameter: f64,
}

/// Angular radius (radians) of a directional light, or radius (metres) of the sphere of another one; 0 without extent.
// Today's lights have none.
fn extent(light: &Light) -> f64 {
    match *light {
        Light::Directional { angular_radius, .. } => angular_radius,
        Light::Point { radius, .. } | Light::Spot { radius, .. } => radius,
    }
}

/// Writes one light. `index` numbers its files. Returns what Mitsuba shows otherwise.
pub(super) fn write_light(
    xml: &mut Xml,
    light: &Light,
    index: usize,
    space: Space,
    folder: &Path,
) -> io::Result<Vec<String>> {
    let mut differences = Vec::new();
    let radius = extent(light);
    match *light {
        Light::Directional { direction, irradiance, .. } if radius > 0.0 => {
            write_disc(xml, direction, irradiance, radius, space);
        }
        Light::Directional { direction, irradiance, .. } => {
            xml.open("emitter", &[("type", "directional")]);
            xml.value("vector", "direction", &numbers(direction.to_array()));
            xml.value("rgb", "irradiance", &rgb(irradiance));
            xml.close();
        }
        Light::Point { position, intensity, range, .. } => {
            if range.is_some() {
                differences.push(format!("light {index}: its range has no cut-off in Mitsuba"));
            }
            let position = numbers((position - space.origin).to_array());
            if radius > 0.0 {
                xml.open("shape", &[("type", "sphere")]);
                xml.value("point", "center", &position);
                xml.value("float", "radius", &radius.to_string());
                // A sphere's intensity is its radiance times the area of its disc.
                write_area(xml, intensity / (PI * radius * radius) as f32);
            } else {
                xml.open("emitter", &[("type", "point")]);
                xml.value("point", "position", &position);
                xml.value("rgb", "intensity", &rgb(intensity));
            }
            xml.close();
        }
        Light::Spot { position, direction, intensity, range, inner_cone, outer_cone, .. } => {
            if range.is_some() {
                differences.push(format!("light {index}: its range has no cut-off in Mitsuba"));
            }
            if radius > 0.0 {
                differences.push(format!("light {index}: a spot light is a point in Mitsuba"));
            }
            let file = format!("cone-{index}.exr");
            cone([inner_cone, outer_cone]).save(folder.join(&file)).map_err(io::Error::other)?;
            let position = position - space.origin;
            xml.open("emitter", &[("type", "spot")]);
            look_at(xml, position, position + direction);
            xml.value("rgb", "intensity", &rgb(intensity));
            let degrees = outer_cone.to_degrees();
            xml.value("float", "cutoff_angle", &degrees.to_string());
            // Mitsuba's own ramp is linear in the angle: it is pushed to the rim, and the texture has Argus' ramp.
            xml.value("float", "beam_width", &(degrees * 0.9999).to_string());
            xml.open("texture", &[("type", "bitmap"), ("name", "texture")]);
            xml.value("string", "filename", &file);
            xml.value("boolean", "raw", "true");
            xml.value("string", "wrap_mode", "clamp");
            xml.close();
            xml.close();
        }
    }
    Ok(differences)
}

/// Writes the sky, if it is not black. Files go to `folder`. A map is always written as it is seen.
pub(super) fn write_sky(xml: &mut Xml, sky: &Sky, light: SkyLight, folder: &Path) -> io::Result<()> {
    if sky.map.is_none() && sky.zenith == sky.horizon && sky.zenith == sky.ground {
        if sky.zenith != Vec3::ZERO {
            xml.open("emitter", &[("type", "constant")]);
            xml.value("rgb", "radiance", &rgb(sky.zenith));
            xml.close();
        }
        return Ok(());
    }
    let radiance = |d: Vec3| match light {
        SkyLight::Ambient if sky.map.is_none() => ambient_radiance(sky, d),
        _ => sky_radiance(sky, d),
    };
    let size = sky.map.as_ref().map_or([SKY_COLUMNS, SKY_ROWS], |map| [map.size()[0], map.size()[1] + 1]);
    panorama(size, radiance).save(folder.join("sky.exr")).map_err(io::Error::other)?;
    xml.open("emitter", &[("type", "envmap")]);
    xml.value("string", "filename", "sky.exr");
    xml.close();
    Ok(())
}

/// Writes an emitter of a shape's front.
pub(super) fn write_area(xml: &mut Xml, radiance: Vec3) {
    xml.open("emitter", &[("type", "area")]);
    xml.value("rgb", "radiance", &rgb(radiance));
    xml.close();
}

/// Writes the transform of something that looks along +z.
pub(super) fn look_at(xml: &mut Xml, from: DVec3, to: DVec3) {
    let up = (to - from).normalize_or(DVec3::Z).any_orthonormal_vector();
    xml.open("transform", &[("name", "to_world")]);
    look_at_element(xml, from, to, up);
    xml.close();
}

/// Writes a `lookat` element, the content of a transform: +z looks from one point to the other.
pub(super) fn look_at_element(xml: &mut Xml, from: DVec3, to: DVec3, up: DVec3) {
    let list = |v: DVec3| v.to_array().map(|x| x.to_string()).join(", ");
    xml.leaf("lookat", &[("origin", &list(from)), ("target", &list(to)), ("up", &list(up))]);
}

/// A directional light with an angular radius: a disc far away that faces the scene.
fn write_disc(xml: &mut Xml, direction: DVec3, irradiance: Vec3, angular_radius: f64, space: Space) {
    let center = space.center - space.origin;
    let distance = DISC_DISTANCE * space.diameter;
    let from = center - direction * distance;
    let up = direction.any_orthonormal_vector();
    xml.open("shape", &[("type", "disk")]);
    xml.open("transform", &[("name", "to_world")]);
    xml.leaf("scale", &[("value", &(distance * angular_radius.tan()).to_string())]);
    look_at_element(xml, from, center, up);
    xml.close();
    write_area(xml, irradiance / (PI * angular_radius.sin().powi(2)) as f32);
    xml.close();
}

/// Radiance of a sky that lights an unoccluded surface exactly as [`sky_ambient`] says. Its irradiance by π is
/// a + b·n.y; a radiance a + 3/2·b·d.y has it, since a cosine-weighted mean shrinks a linear function by 2/3.
fn ambient_radiance(sky: &Sky, d: Vec3) -> Vec3 {
    let (above, below) = (sky_ambient(sky, Vec3::Y), sky_ambient(sky, Vec3::NEG_Y));
    ((above + below) * 0.5 + (above - below) * (0.75 * d.y)).max(Vec3::ZERO)
}

/// A panorama of radiance by direction for Mitsuba's `envmap`: y is up. Row i shows the polar angle π·i/(rows − 1).
/// Columns have their centres at half integers; column 0 begins at −z, and +x follows after a quarter.
fn panorama(size: [u32; 2], radiance: impl Fn(Vec3) -> Vec3) -> ImageBuffer<Rgb<f32>, Vec<f32>> {
    ImageBuffer::from_fn(size[0], size[1], |column, row| {
        Rgb(radiance(direction_of(size, column, row).as_vec3()).to_array())
    })
}

/// Unit direction of a texel of [`panorama`].
pub(super) fn direction_of(size: [u32; 2], column: u32, row: u32) -> DVec3 {
    let polar = PI * f64::from(row) / f64::from(size[1] - 1);
    let around = TAU * (f64::from(column) + 0.5) / f64::from(size[0]);
    DVec3::new(polar.sin() * around.sin(), polar.cos(), -polar.sin() * around.cos())
}

/// The ramp of [`crate::shading::incident`] over a spot light's cone, projected onto a plane in front of it.
fn cone([inner, outer]: [f64; 2]) -> ImageBuffer<Rgb<f32>, Vec<f32>> {
    let reach = outer.tan();
    let at = |i: u32| (2.0 * (f64::from(i) + 0.5) / f64::from(CONE_SIDE) - 1.0) * reach;
    ImageBuffer::from_fn(CONE_SIDE, CONE_SIDE, |x, y| {
        let cosine = DVec3::new(at(x), at(y), 1.0).normalize().z;
        let ramp = ((cosine - outer.cos()) / (inner.cos() - outer.cos()).max(1e-4)).clamp(0.0, 1.0);
        Rgb([(ramp * ramp) as f32; 3])
    })
}
