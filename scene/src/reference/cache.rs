//! Reference images on disk, kept between runs outside the repository.
//!
//! An image's name is a hash of all its inputs: the scene's content (not its file, so that an image of an older loader
//! is not used), camera, size, samples per pixel, lighting and [`REFERENCE_VERSION`]. Files can be deleted at any
//! time; a damaged one is rendered again. A file is written under a temporary name beside its own and renamed, so
//! processes may share the folder.

use std::io::Write;
use std::path::{Path, PathBuf};

use glam::{DVec3, Vec3};

use super::image::grid_side;
use super::{Indirect, REFERENCE_VERSION, ReferenceImage, Tracer};
use crate::{Camera, Pose, Scene};

/// First bytes of every file.
const MAGIC: &[u8; 8] = b"argusref";
/// Magic, width, height.
const HEADER: usize = 16;
/// Bytes of a pixel: three f32 of radiance, one of range.
const PIXEL: usize = 16;

/// The folder of images: `$ARGUS_CACHE`, else `argus` in the user's cache folder (XDG base directory specification);
/// `None` if neither is set.
pub fn directory() -> Option<PathBuf> {
    let absolute = |name| std::env::var_os(name).map(PathBuf::from).filter(|path| path.is_absolute());
    std::env::var_os("ARGUS_CACHE")
        .filter(|path| !path.is_empty())
        .map(PathBuf::from)
        .or_else(|| absolute("XDG_CACHE_HOME").map(|path| path.join("argus")))
        .or_else(|| absolute("HOME").map(|path| path.join(".cache/argus")))
}

/// [`Tracer::render`], with the cache of [`render_with`].
pub fn render(
    directory: Option<&Path>,
    tracer: &Tracer,
    camera: &Camera,
    size: [u32; 2],
    samples_per_pixel: u32,
    progress: impl Fn(f64) + Sync,
) -> ReferenceImage {
    render_with(directory, tracer, camera, size, samples_per_pixel, None, progress)
}

/// [`Tracer::render_with`], read from `directory` if it was rendered before. With a folder that cannot be read or
/// written, every image is rendered again.
pub fn render_with(
    directory: Option<&Path>,
    tracer: &Tracer,
    camera: &Camera,
    [width, height]: [u32; 2],
    samples_per_pixel: u32,
    indirect: Option<Indirect>,
    progress: impl Fn(f64) + Sync,
) -> ReferenceImage {
    let render = || tracer.render_with(camera, [width, height], samples_per_pixel, indirect, &progress);
    let Some(directory) = directory else { return render() };
    let path = directory.join(name_with(tracer, camera, [width, height], samples_per_pixel, indirect));
    if let Some(image) = load(&path, [width, height]) {
        progress(1.0);
        return image;
    }
    let image = render();
    // An image that cannot be stored is still returned.
    let _ = store(&path, &image);
    image
}

/// The file name of an image without indirect light.
pub fn name(tracer: &Tracer, camera: &Camera, size: [u32; 2], samples_per_pixel: u32) -> String {
    name_with(tracer, camera, size, samples_per_pixel, None)
}

/// The file name of an image.
fn name_with(
    tracer: &Tracer,
    camera: &Camera,
    size: [u32; 2],
    samples_per_pixel: u32,
    indirect: Option<Indirect>,
) -> String {
    let mut hasher = blake3::Hasher::new();
    hasher.update(&REFERENCE_VERSION.to_le_bytes());
    hasher.update(tracer.content_hash().as_bytes());
    for v in [camera.eye, camera.target, camera.up, DVec3::splat(camera.fov_deg)] {
        hasher.update(bytemuck::bytes_of(&v));
    }
    if let Some(lens) = camera.lens {
        hasher.update(format!("{lens:?}").as_bytes());
    }
    hasher.update(bytemuck::bytes_of(&[size[0], size[1], grid_side(samples_per_pixel)]));
    if let Some(Indirect { paths, bounces }) = indirect {
        hasher.update(b"indirect");
        hasher.update(bytemuck::bytes_of(&[paths, bounces]));
    }
    if let Some(light) = tracer.direct_light() {
        hasher.update(b"direct light");
        hasher.update(bytemuck::bytes_of(&[light.effects.bits(), light.rays]));
    }
    if let Some(reflecting) = &tracer.reflecting {
        hasher.update(b"reflecting");
        hasher.update(&reflecting.rays.to_le_bytes());
        hasher.update(bytemuck::cast_slice(&reflecting.instances));
    }
    format!("{}.ref", hasher.finalize().to_hex())
}

impl Tracer {
    /// Hash over all parts of the scene that an image depends on; computed once, on first use.
    pub fn content_hash(&self) -> blake3::Hash {
        *self.content_hash.get_or_init(|| content_hash(&self.scene, &self.pose))
    }
}

fn content_hash(scene: &Scene, pose: &Pose) -> blake3::Hash {
    let mut hasher = blake3::Hasher::new();
    // Lengths separate consecutive parts, so that no two scenes feed the same bytes.
    let mut part = |bytes: &[u8]| {
        hasher.update(&(bytes.len() as u64).to_le_bytes());
        hasher.update(bytes);
    };
    part(&(scene.meshes.len() as u64).to_le_bytes());
    for mesh in &scene.meshes {
        part(bytemuck::bytes_of(&mesh.origin));
        part(bytemuck::cast_slice(&mesh.positions));
        part(bytemuck::cast_slice(&mesh.normals));
        part(bytemuck::cast_slice(&mesh.tangents));
        part(bytemuck::cast_slice(&mesh.uvs));
        part(bytemuck::cast_slice(&mesh.uvs2));
        part(bytemuck::cast_slice(&mesh.colors));
        part(bytemuck::cast_slice(&mesh.indices));
        part(&mesh.material.to_le_bytes());
    }
    for instance in &pose.instances {
        part(&instance.mesh.to_le_bytes());
        part(bytemuck::cast_slice(&instance.world_from_mesh.to_cols_array()));
    }
    for texture in &scene.textures {
        let described = (texture.width, texture.height, texture.srgb, texture.wrap, texture.filter);
        part(format!("{described:?}").as_bytes());
        part(&texture.rgba);
    }
    // Debug prints every field, and each float with full precision: a new field changes the hash without code
    // here.
    part(format!("{:?}", scene.materials).as_bytes());
    part(format!("{:?}", pose.lighting).as_bytes());
    hasher.finalize()
}

/// The image in a file; `None` if there is no file, or it is damaged or of another size.
fn load(path: &Path, [width, height]: [u32; 2]) -> Option<ReferenceImage> {
    let file = std::fs::read(path).ok()?;
    let pixels = width as usize * height as usize;
    if file.len() != HEADER + pixels * PIXEL + blake3::OUT_LEN || !file.starts_with(MAGIC) {
        return None;
    }
    let (content, checksum) = file.split_at(file.len() - blake3::OUT_LEN);
    if blake3::hash(content).as_bytes() != checksum {
        return None;
    }
    let number = |at: usize| <[u8; 4]>::try_from(&content[at..at + 4]).ok();
    if number(8).map(u32::from_le_bytes)? != width || number(12).map(u32::from_le_bytes)? != height {
        return None;
    }
    let floats = content[HEADER..].chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]]));
    let floats: Vec<f32> = floats.collect();
    let (radiance, range) = floats.split_at(3 * pixels);
    let radiance = radiance.chunks_exact(3).map(Vec3::from_slice).collect();
    Some(ReferenceImage { width, height, radiance, range: range.to_vec() })
}

fn store(path: &Path, image: &ReferenceImage) -> std::io::Result<()> {
    let mut content = Vec::with_capacity(HEADER + image.range.len() * PIXEL);
    content.extend(MAGIC);
    content.extend([image.width, image.height].iter().flat_map(|n| n.to_le_bytes()));
    content.extend(image.radiance.iter().flat_map(|v| v.to_array()).flat_map(f32::to_le_bytes));
    content.extend(image.range.iter().copied().flat_map(f32::to_le_bytes));
    let directory = path.parent().unwrap_or(Path::new("."));
    std::fs::create_dir_all(directory)?;
    let mut file = tempfile::NamedTempFile::new_in(directory)?;
    file.write_all(&content)?;
    file.write_all(blake3::hash(&content).as_bytes())?;
    file.persist(path).map_err(|failed| failed.error)?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image() -> ReferenceImage {
        let radiance = vec![Vec3::new(0.1, -2.0, 3e9), Vec3::ZERO];
        ReferenceImage { width: 2, height: 1, radiance, range: vec![1.5, f32::INFINITY] }
    }

    #[test]
    fn a_stored_image_is_loaded_bit_for_bit() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("deep/er/x.ref");
        store(&path, &image()).unwrap();
        assert_eq!(load(&path, [2, 1]), Some(image()));
        assert_eq!(load(&path, [1, 2]), None);
        let left: Vec<_> = std::fs::read_dir(path.parent().unwrap()).unwrap().collect();
        assert_eq!(left.len(), 1, "no temporary file stays behind");
    }

    #[test]
    fn damaged_and_missing_files_are_not_loaded() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("x.ref");
        assert_eq!(load(&path, [2, 1]), None);
        store(&path, &image()).unwrap();
        let whole = std::fs::read(&path).unwrap();
        for at in 0..whole.len() {
            let mut flipped = whole.clone();
            flipped[at] ^= 0x10;
            std::fs::write(&path, &flipped).unwrap();
            assert_eq!(load(&path, [2, 1]), None, "byte {at}");
            std::fs::write(&path, &whole[..at]).unwrap();
            assert_eq!(load(&path, [2, 1]), None, "cut at {at}");
        }
    }
}
