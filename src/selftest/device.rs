//! Describes the device and its features, and gives advice if no device opens.

use std::fmt::Write as _;
use std::path::Path;

use argus_gpu::wgpu::Features;
use argus_gpu::{Gpu, GpuError};
use serde::Serialize;

/// Optional features that Argus uses, by name.
const USED: [(&str, Features); 6] = [
    ("subgroups", Features::SUBGROUP),
    ("timestamp_queries", Features::TIMESTAMP_QUERY),
    ("atomics_64_bit", Features::SHADER_INT64_ATOMIC_MIN_MAX),
    ("atomics_64_bit_all_operations", Features::SHADER_INT64_ATOMIC_ALL_OPS),
    ("primitive_index", Features::PRIMITIVE_INDEX),
    ("multi_draw_indirect_count", Features::MULTI_DRAW_INDIRECT_COUNT),
];

/// The device's description for users and reports.
#[derive(Serialize)]
pub(super) struct Description {
    adapter: String,
    driver: String,
    /// Discrete, integrated or virtual GPU, or software.
    kind: String,
    backend: String,
    /// Smallest and largest subgroup, in lanes.
    subgroup_sizes: [u32; 2],
    has: Vec<&'static str>,
    lacks: Vec<&'static str>,
    /// Bytes of a buffer that one shader binding can address.
    max_binding_bytes: u64,
    max_buffer_bytes: u64,
    storage_buffers_per_stage: u32,
    workgroup_memory_bytes: u32,
    /// Supported visibility backends: raster, trace, cpu.
    pub(super) triangles_by: Vec<&'static str>,
}

/// Reads the description of a device.
pub(super) fn describe(gpu: &Gpu) -> Description {
    let (adapter, limits, features) = (gpu.adapter(), gpu.device.limits(), gpu.device.features());
    let named = |present: bool| {
        USED.iter().filter(move |(_, one)| features.contains(*one) == present).map(|(name, _)| *name)
    };
    Description {
        adapter: adapter.name.clone(),
        driver: format!("{} {}", adapter.driver, adapter.driver_info).trim().to_owned(),
        kind: if gpu.is_software() { "software".to_owned() } else { format!("{:?}", adapter.device_type) },
        backend: adapter.backend.to_string(),
        subgroup_sizes: [adapter.subgroup_min_size, adapter.subgroup_max_size],
        has: named(true).collect(),
        lacks: named(false).collect(),
        max_binding_bytes: limits.max_storage_buffer_binding_size,
        max_buffer_bytes: limits.max_buffer_size,
        storage_buffers_per_stage: limits.max_storage_buffers_per_shader_stage,
        workgroup_memory_bytes: limits.max_compute_workgroup_storage_size,
        triangles_by: Vec::new(),
    }
}

impl Description {
    /// The description as text, followed by an empty line.
    pub(super) fn text(&self) -> String {
        let mut text = String::new();
        let list = |names: &[&str]| if names.is_empty() { "nothing".to_owned() } else { names.join(", ") };
        let mib = |bytes: u64| bytes as f64 / f64::from(1 << 20);
        let [least, most] = self.subgroup_sizes;
        let rows = [
            ("device", format!("{} ({}, {})", self.adapter, self.kind, self.backend)),
            ("driver", self.driver.clone()),
            ("has", list(&self.has)),
            ("lacks", list(&self.lacks)),
            ("subgroups", format!("{least} to {most} lanes")),
            (
                "one binding",
                format!(
                    "{:.0} MiB of a buffer of {:.0} MiB",
                    mib(self.max_binding_bytes),
                    mib(self.max_buffer_bytes)
                ),
            ),
            (
                "a shader",
                format!(
                    "{} storage buffers, {} bytes of workgroup memory",
                    self.storage_buffers_per_stage, self.workgroup_memory_bytes
                ),
            ),
            ("triangles by", list(&self.triangles_by)),
        ];
        for (name, value) in rows {
            let _ = writeln!(text, "{name:<14}{value}");
        }
        text + "\n"
    }
}

/// Advice for a device that cannot be opened.
pub(super) fn advice(error: &GpuError) -> String {
    let GpuError::NoAdapter(message) = error else { return error.to_string() };
    if !cfg!(target_os = "linux") || message.starts_with("no adapter matches") {
        return message.clone();
    }
    let loader = LOADER_FOLDERS.iter().any(|folder| Path::new(folder).join("libvulkan.so.1").exists());
    let manifests = MANIFEST_FOLDERS.iter().filter_map(|folder| std::fs::read_dir(folder).ok());
    let drivers =
        manifests.flatten().flatten().filter(|file| file.path().extension().is_some_and(|e| e == "json"));
    let variables = ["VK_DRIVER_FILES", "VK_ICD_FILENAMES"].map(|name| (name, std::env::var(name).ok()));
    let chosen = variables.into_iter().find_map(|(name, value)| Some((name, value?)));
    format!("{message}; {}", missing(loader, drivers.count(), chosen.as_ref().map(|(n, v)| (*n, v.as_str()))))
}

const LOADER_FOLDERS: [&str; 6] = [
    "/usr/lib/x86_64-linux-gnu",
    "/usr/lib/aarch64-linux-gnu",
    "/lib/x86_64-linux-gnu",
    "/usr/lib64",
    "/usr/lib",
    "/usr/local/lib",
];

const MANIFEST_FOLDERS: [&str; 3] =
    ["/usr/share/vulkan/icd.d", "/etc/vulkan/icd.d", "/usr/local/share/vulkan/icd.d"];

/// What is missing of the Vulkan loader and driver, judging by their files.
fn missing(loader: bool, drivers: usize, chosen: Option<(&str, &str)>) -> String {
    if !loader {
        return "the Vulkan loader (libvulkan.so.1) is not in any of the usual folders".to_owned();
    }
    if let Some((variable, value)) = chosen {
        return format!("the loader is installed but the driver that {variable}={value} names does not work");
    }
    if drivers == 0 {
        return "the loader is installed but there is no driver manifest (/usr/share/vulkan/icd.d, /etc/vulkan/icd.d); in a \
        container with an NVIDIA GPU set NVIDIA_DRIVER_CAPABILITIES=graphics,compute,utility, or name a manifest \
        elsewhere with VK_DRIVER_FILES"
            .to_owned();
    }
    format!("the loader and {drivers} drivers' manifests are installed, but no driver opens a device")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_missing_loader_a_missing_driver_and_a_wrong_choice_are_told_apart() {
        assert!(missing(false, 3, None).contains("libvulkan.so.1"));
        assert!(missing(true, 0, None).contains("NVIDIA_DRIVER_CAPABILITIES"));
        assert!(missing(true, 2, None).contains("2 drivers"));
        assert!(missing(true, 2, Some(("VK_DRIVER_FILES", "/x"))).contains("VK_DRIVER_FILES=/x"));
    }

    #[test]
    fn other_errors_are_passed_on_unchanged() {
        let error = GpuError::Lost("gone".to_owned());
        assert_eq!(advice(&error), error.to_string());
        let error = GpuError::NoAdapter("no adapter matches `x`; there is 0: y".to_owned());
        assert_eq!(advice(&error), "no adapter matches `x`; there is 0: y");
    }
}
