//! What instances can do with light at most: albedo, emission, gloss and shape.

use std::collections::BTreeMap;

use glam::{DMat3, DVec3, Vec3};

use crate::tone::linear_from_srgb;
use crate::{Bounds, Instance, Mesh, Scene, TextureRef};

/// An instance, by the largest values that its material, textures and vertex colours allow.
#[derive(Debug, Clone)]
pub(super) struct Body {
    /// Index into [`Scene::instances`].
    pub(super) instance: u32,
    /// Index into [`Scene::materials`].
    pub(super) material: u32,
    /// World space. In an animated scene, the box of the whole scene.
    pub(super) bounds: Bounds,
    pub(super) albedo: Vec3,
    pub(super) emission: Vec3,
    /// Area of an emitting instance, square metres; infinite in an animated scene.
    pub(super) area: f64,
    pub(super) gloss: Option<Gloss>,
    /// Share of light that passes through.
    pub(super) transmission: f32,
    /// Whether it cannot block its own light: a flat mesh, or a convex one that is seen only from outside.
    pub(super) is_convex: bool,
    /// Largest angle between a shading normal and its triangle's normal, radians; π/2 if unknown.
    pub(super) bend: f64,
}

/// The specular lobe of a body.
#[derive(Debug, Clone, Copy)]
pub(super) struct Gloss {
    /// Smallest GGX α.
    pub(super) alpha: f32,
    /// Largest factor of the lobe: reflectance at normal incidence, at least 1 for grazing directions.
    pub(super) most: f32,
}

impl Body {
    /// Whether light can change what it looks like.
    pub(super) fn reflects(&self) -> bool {
        self.albedo.max_element() > 0.0 || self.gloss.is_some()
    }

    pub(super) fn emits(&self) -> bool {
        self.emission.max_element() > 0.0
    }
}

/// The bodies of a scene: its instances with at least one triangle.
pub(super) fn bodies(scene: &Scene) -> Vec<Body> {
    let animated = scene.is_animated();
    let whole = if animated { scene.bounds() } else { Bounds::EMPTY };
    let mut ranges = Ranges { scene, known: BTreeMap::new() };
    let looks: Vec<Looks> = scene.meshes.iter().map(|mesh| Looks::of(mesh, &mut ranges)).collect();
    let body = |(index, placed): (u32, &Instance)| {
        let mesh = &scene.meshes[placed.mesh as usize];
        let looks = &looks[placed.mesh as usize];
        if mesh.triangles() == 0 || looks.bounds.is_empty() {
            return None;
        }
        let area = match looks.emission.max_element() > 0.0 {
            true if animated => f64::INFINITY,
            true => area(mesh, placed.world_from_mesh.matrix3),
            false => 0.0,
        };
        let textured = scene.materials[mesh.material as usize].normal_texture.is_some();
        let bend = match looks.is_convex && !textured {
            true => bend(mesh, placed.world_from_mesh.matrix3),
            false => std::f64::consts::FRAC_PI_2,
        };
        Some(Body {
            instance: index,
            material: mesh.material,
            bounds: if animated { whole } else { placed_bounds(&looks.bounds, placed) },
            albedo: looks.albedo,
            emission: looks.emission,
            area,
            gloss: looks.gloss,
            transmission: looks.transmission,
            is_convex: looks.is_convex,
            bend,
        })
    };
    (0u32..).zip(&scene.instances).filter_map(body).collect()
}

/// What all instances of a mesh have in common.
struct Looks {
    /// Mesh space.
    bounds: Bounds,
    albedo: Vec3,
    emission: Vec3,
    gloss: Option<Gloss>,
    transmission: f32,
    is_convex: bool,
}

impl Looks {
    fn of(mesh: &Mesh, ranges: &mut Ranges<'_>) -> Self {
        let material = &ranges.scene.materials[mesh.material as usize];
        let colors = match mesh.colors.is_empty() {
            true => Vec3::ONE,
            false => mesh.colors.iter().fold(Vec3::ZERO, |most, color| most.max(color.truncate())),
        };
        let base = ranges.of(material.base_color_texture);
        let base = material.base_color.truncate() * base.most * colors;
        let surface = ranges.of(material.metallic_roughness_texture);
        let metallic = |blue: f32| (material.metallic * blue).clamp(0.0, 1.0);
        let roughness = (material.roughness * surface.least.y).clamp(0.0, 1.0);
        let gloss = material.is_glossy().then(|| Gloss {
            alpha: (roughness * roughness).max(2e-3),
            most: match metallic(surface.most.z) > 0.0 {
                true => base.max_element().max(1.0),
                false => 1.0,
            },
        });
        let mut bounds = Bounds::EMPTY;
        for position in &mesh.positions {
            bounds.extend(mesh.origin + position.as_dvec3());
        }
        Self {
            bounds,
            albedo: if material.unlit { Vec3::ZERO } else { base * (1.0 - metallic(surface.least.z)) },
            emission: material.emissive * ranges.of(material.emissive_texture).most,
            gloss,
            transmission: material.transmission * ranges.of(material.transmission_texture).most.x,
            is_convex: is_convex(mesh, material.double_sided),
        }
    }
}

/// Smallest and largest values of a texture's channels, linear.
#[derive(Debug, Clone, Copy)]
struct Range {
    least: Vec3,
    most: Vec3,
}

/// Ranges of textures, each computed once.
struct Ranges<'a> {
    scene: &'a Scene,
    known: BTreeMap<u32, Range>,
}

impl Ranges<'_> {
    /// The range of a texture; white where there is none.
    fn of(&mut self, reference: Option<TextureRef>) -> Range {
        let white = Range { least: Vec3::ONE, most: Vec3::ONE };
        let found = reference.and_then(|r| Some((r.texture, self.scene.textures.get(r.texture as usize)?)));
        let Some((index, texture)) = found else { return white };
        *self.known.entry(index).or_insert_with(|| {
            let texels = texture.rgba.as_chunks::<4>().0;
            if texels.len() as u64 != u64::from(texture.width) * u64::from(texture.height)
                || texels.is_empty()
            {
                // Such a texture becomes one white texel, or is read past its end as white.
                return Range { least: Vec3::ZERO, most: Vec3::ONE };
            }
            let (mut least, mut most) = ([u8::MAX; 4], [0u8; 4]);
            for texel in texels {
                for channel in 0..4 {
                    least[channel] = least[channel].min(texel[channel]);
                    most[channel] = most[channel].max(texel[channel]);
                }
            }
            let linear = |byte: u8| {
                let value = f32::from(byte) / 255.0;
                if texture.srgb { linear_from_srgb(value) } else { value }
            };
            let color = |[r, g, b, _]: [u8; 4]| Vec3::new(linear(r), linear(g), linear(b));
            Range { least: color(least), most: color(most) }
        })
    }
}

/// A box around a mesh's box in the world.
fn placed_bounds(bounds: &Bounds, placed: &Instance) -> Bounds {
    let mut around = Bounds::EMPTY;
    for corner in 0..8 {
        let pick = |axis: usize| if corner >> axis & 1 == 0 { bounds.min[axis] } else { bounds.max[axis] };
        around.extend(placed.world_from_mesh.transform_point3(DVec3::new(pick(0), pick(1), pick(2))));
    }
    around
}

/// Corners of a mesh's triangles about its origin. A missing vertex is at the origin.
fn triangles(mesh: &Mesh) -> impl Iterator<Item = ([u32; 3], [DVec3; 3])> {
    let at = |i: u32| mesh.positions.get(i as usize).copied().unwrap_or_default().as_dvec3();
    mesh.indices.as_chunks::<3>().0.iter().map(move |&indices| (indices, indices.map(at)))
}

fn area(mesh: &Mesh, world_from_mesh: DMat3) -> f64 {
    let of =
        |[a, b, c]: [DVec3; 3]| (world_from_mesh * (b - a)).cross(world_from_mesh * (c - a)).length() * 0.5;
    triangles(mesh).map(|(_, corners)| of(corners)).filter(|area| area.is_finite()).sum()
}

/// Largest product of a mesh's triangles and vertices for which its shape is examined.
const MOST_TESTS: usize = 1 << 22;
/// Largest height of a vertex above a triangle's plane that counts as none, as a share of their distance: a few times the
/// rounding of coordinates where a triangle is a hundredth of its mesh.
pub(super) const LEVEL: f64 = 1e-5;
/// Rounding of coordinates, as a share of a mesh's extent. Thinner triangles have no direction, and show nothing.
const ROUNDING: f64 = 1e-7;

/// Largest coordinate of a mesh about its origin.
fn extent(mesh: &Mesh) -> f64 {
    let most = mesh.positions.iter().fold(0.0f32, |most, position| most.max(position.abs().max_element()));
    f64::from(most)
}

/// Whether a triangle is thinner than the rounding of its coordinates.
fn is_sliver([a, b, c]: [DVec3; 3], extent: f64) -> bool {
    let longest = (b - a).length().max((c - a).length()).max((c - b).length());
    (b - a).cross(c - a).length() <= longest * extent * ROUNDING
}

/// Whether no triangle of a mesh can block light that another of its visible sides faces: it is flat, or all of it lies
/// behind each of its triangles and only fronts are seen.
fn is_convex(mesh: &Mesh, double_sided: bool) -> bool {
    if mesh.triangles().saturating_mul(mesh.positions.len()) > MOST_TESTS {
        return false;
    }
    let (mut behind, mut flat) = (!double_sided, true);
    let extent = extent(mesh);
    for (_, [a, b, c]) in triangles(mesh) {
        if is_sliver([a, b, c], extent) {
            continue;
        }
        let normal = (b - a).cross(c - a).normalize_or_zero();
        for position in &mesh.positions {
            let to = position.as_dvec3() - a;
            // NaN is neither.
            let (height, level) = (normal.dot(to), LEVEL * to.length());
            behind &= height <= level;
            flat &= height.abs() <= level;
        }
        if !(behind || flat) {
            return false;
        }
    }
    true
}

/// Largest angle between shading normals and normals of triangles.
fn bend(mesh: &Mesh, world_from_mesh: DMat3) -> f64 {
    if mesh.normals.is_empty() {
        return 0.0;
    }
    let world = world_from_mesh.inverse().transpose();
    let extent = extent(mesh);
    let mut most = 0.0f64;
    for (indices, [a, b, c]) in triangles(mesh) {
        let face = (world * (b - a).cross(c - a)).normalize_or_zero();
        if face == DVec3::ZERO || is_sliver([a, b, c], extent) {
            continue;
        }
        for index in indices {
            let normal = mesh.normals.get(index as usize).copied().unwrap_or_default();
            let normal = (world * normal.as_dvec3()).normalize_or_zero();
            let angle = face.cross(normal).length().atan2(face.dot(normal));
            // NaN, and a missing normal, count as unknown.
            let known = normal != DVec3::ZERO && angle < std::f64::consts::FRAC_PI_2;
            most = most.max(if known { angle } else { std::f64::consts::FRAC_PI_2 });
        }
    }
    most
}
