//! Normals and ids of a view: of what the ray through each pixel's centre shows.
//!
//! They are of the triangles, without light, and are found on the CPU on every device: by packets of rays, whose triangle is met
//! again in f64. So they depend on no visibility backend, and a view from samples has those of the same view from triangles.

use argus_scene::camera::CameraRays;
use argus_scene::{Images, Mesh, Output, Outputs, RenderError, Scene, Stage, ViewJob};
use bytes::Bytes;
use glam::{DVec2, DVec3, Vec3};
use rayon::prelude::*;

use crate::layers::direction;
use crate::ray_tile::RayTile;
use crate::resident::{Placement, Resident};
use crate::surfaces::{corners, front, interpolated_normal};
use crate::tile::Tile;
use crate::view::Image;
use crate::visibility::VisibilityBackends;

/// The outputs that are found here.
const OUTPUTS: Outputs = Outputs::only(Output::Normal).with(Output::Instance).with(Output::Material);

/// What a pixel shows.
#[derive(Debug, Clone, Copy)]
struct Seen {
    /// Unit, world space, on the eye's side; zero without a surface.
    normal: Vec3,
    /// Indices into the scene's instances and materials; -1 without a surface.
    instance: i32,
    material: i32,
}

const NOTHING: Seen = Seen { normal: Vec3::ZERO, instance: -1, material: -1 };

/// The images of a view that are asked for, of its tiles with one sub-sample a pixel. `lens` has the rays of a view that is no pinhole's.
///
/// # Errors
/// [`RenderError::Internal`] if the tracer is missing.
pub(crate) fn images(
    visibility: &mut VisibilityBackends,
    resident: &Resident,
    view: &ViewJob,
    tiles: &[Tile],
    lens: Option<&CameraRays>,
    stages: &mut Vec<Stage>,
) -> Result<Images, RenderError> {
    let wanted: Vec<Output> = view.outputs.iter().filter(|output| OUTPUTS.has(*output)).collect();
    if wanted.is_empty() {
        return Ok(Images::default());
    }
    let begin = std::time::Instant::now();
    let size = [view.width, view.height];
    let mut images: Vec<(Output, Image)> =
        wanted.into_iter().map(|output| (output, Image::new(size, output.pixel_bytes()))).collect();
    for tile in tiles {
        let seen = seen_in(visibility, resident, view.camera.eye, tile, lens)?;
        for (output, image) in &mut images {
            image.place(tile, plane(*output, &seen));
        }
    }
    crate::timing::add_since(stages, "trace geometry", begin);
    Ok(images.into_iter().map(|(output, image)| (output, image.into_bytes())).collect())
}

/// What each pixel of a tile shows.
fn seen_in(
    visibility: &mut VisibilityBackends,
    resident: &Resident,
    eye: DVec3,
    tile: &Tile,
    lens: Option<&CameraRays>,
) -> Result<Vec<Seen>, RenderError> {
    let (rays, width) = (tile.rays(), tile.size[0]);
    let listed = lens.map(|lens| RayTile::new(lens, *tile).directions);
    let packets = visibility.prepare_packets(resident);
    let (mut ids, layers) = match &listed {
        None => (packets.trace(eye, &rays), visibility.layers_of_tile(resident, eye, &rays)),
        Some(directions) => (
            packets.trace_listed(eye, directions, width),
            visibility.layers_of_rays(resident, eye, directions, width),
        ),
    };
    for ray in layers {
        if let (Some(id), Some((shown, _))) = (ids.get_mut(ray.at as usize), ray.shown()) {
            *id = shown;
        }
    }
    let mut placements: Vec<Option<&Placement>> = vec![None; resident.instance_count];
    resident.instances.iter().for_each(|placed| placements[placed.instance as usize] = Some(placed));
    let scene = visibility.scene();
    let seen = |(at, ids): (usize, &[u32; 2])| {
        let placement = (*placements.get(ids[0].checked_sub(1)? as usize)?)?;
        let place = [at as u32 % width, at as u32 / width];
        let centre = |axis: usize| f64::from(tile.begin[axis] + place[axis]) + 0.5;
        let direction = match lens {
            None => direction(&rays, place),
            Some(lens) => lens.direction(DVec2::new(centre(0), centre(1)))?,
        };
        surface(scene, placement, ids[1], eye, direction)
    };
    Ok(ids.par_iter().enumerate().map(|at| seen(at).unwrap_or(NOTHING)).collect())
}

/// A triangle's surface on a ray that was found to meet it.
fn surface(
    scene: &Scene,
    placement: &Placement,
    primitive: u32,
    eye: DVec3,
    direction: DVec3,
) -> Option<Seen> {
    let mesh = &scene.meshes[placement.mesh as usize];
    let front = front(placement, mesh, primitive)?;
    let weights = weights(placement, mesh, primitive, eye, direction)?;
    let normal = interpolated_normal(placement, mesh, corners(mesh, primitive)?, weights).unwrap_or(front);
    // A surface seen from behind has its normals flipped, as in `argus_scene::shading`.
    let normal = if front.dot(direction) > 0.0 { -normal } else { normal };
    let (instance, material) = (placement.instance as i32, mesh.material as i32);
    Some(Seen { normal: normal.as_vec3(), instance, material })
}

/// Weights of a triangle's corners where a ray meets its plane. Along its edges they are those of the nearest point of the
/// triangle, since packets are less precise.
fn weights(
    placement: &Placement,
    mesh: &Mesh,
    primitive: u32,
    eye: DVec3,
    direction: DVec3,
) -> Option<[f32; 3]> {
    let corners = corners(mesh, primitive)?;
    let [a, b, c] =
        corners.map(|i| placement.world_from_mesh * mesh.positions[i].as_dvec3() + (placement.origin - eye));
    // Möller and Trumbore, 1997.
    let (e1, e2) = (b - a, c - a);
    let p = direction.cross(e2);
    let inverse = e1.dot(p).recip();
    let beta = -a.dot(p) * inverse;
    let gamma = direction.dot((-a).cross(e1)) * inverse;
    if !(beta.is_finite() && gamma.is_finite()) {
        return Some([1.0 / 3.0; 3]);
    }
    let within = [1.0 - beta - gamma, beta, gamma].map(|weight| weight.clamp(0.0, 1.0));
    let sum: f64 = within.iter().sum();
    Some(within.map(|weight| (weight / sum) as f32))
}

/// The bytes of an output of pixels.
fn plane(output: Output, seen: &[Seen]) -> Bytes {
    match output {
        Output::Normal => {
            seen.iter().flat_map(|seen| seen.normal.to_array()).flat_map(f32::to_le_bytes).collect()
        }
        Output::Instance => seen.iter().flat_map(|seen| seen.instance.to_le_bytes()).collect(),
        Output::Material => seen.iter().flat_map(|seen| seen.material.to_le_bytes()).collect(),
        _ => Bytes::new(),
    }
}
