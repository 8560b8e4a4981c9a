//! Which instances of a scene reflect it.

use argus_scene::{Instance, Scene};

/// The reflectors among a scene's instances.
pub(crate) struct Reflectors {
    /// Their instances.
    pub(crate) instances: Vec<u32>,
    /// For each instance of the scene 1 + the number of its reflector, or 0; at least one.
    pub(crate) numbers: Vec<u32>,
    /// For each instance the share of light that passes, in the mean over a transmission texture: the G-buffer does not hold it.
    transmission: Vec<f32>,
}

impl Reflectors {
    /// The reflectors of a scene, at most so many.
    pub(crate) fn new(scene: &Scene, most: u32) -> Self {
        let instances = scene.reflectors(most);
        let mut numbers = vec![0u32; scene.instances.len().max(1)];
        for (number, &instance) in (1..).zip(&instances) {
            numbers[instance as usize] = number;
        }
        let passes = |instance: &Instance| {
            let mesh = scene.meshes.get(instance.mesh as usize)?;
            let material = scene.materials.get(mesh.material as usize)?;
            let texture = material.transmission_texture.and_then(|r| scene.textures.get(r.texture as usize));
            Some(material.transmission * texture.map_or(1.0, |texture| texture.mean(0)))
        };
        let transmission = scene.instances.iter().map(|instance| passes(instance).unwrap_or(0.0)).collect();
        Self { instances, numbers, transmission }
    }

    /// Number of an instance's reflector, from 0, and the share of light that passes it.
    pub(crate) fn of(&self, instance: u32) -> Option<(u32, f32)> {
        let number = self.numbers.get(instance as usize)?.checked_sub(1)?;
        Some((number, *self.transmission.get(instance as usize)?))
    }
}
