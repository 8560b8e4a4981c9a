//! Opens a device and tracks its faults.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use argus_scene::Stage;
use parking_lot::Mutex;
use wgpu::{Backends, DeviceType, Features, InstanceFlags};

use crate::readback_pool::ReadbackPool;
use crate::{GpuError, quirks};

/// Options for opening a device.
#[derive(Debug, Clone, Default)]
pub struct GpuOptions {
    /// Part of the adapter's name (case-insensitive), or its index. `None` reads `ARGUS_ADAPTER`; if that is unset, the
    /// fastest kind is used (discrete, integrated, virtual, software).
    pub adapter: Option<String>,
}

/// A device, its queue, and state shared by all users.
///
/// Shared as an `Arc`. Any thread may record and submit.
#[derive(Debug)]
pub struct Gpu {
    /// The device.
    pub device: wgpu::Device,
    /// Its queue.
    pub queue: wgpu::Queue,
    kind: String,
    adapter: wgpu::AdapterInfo,
    faults: Arc<Faults>,
    longest_pass: Mutex<Option<Stage>>,
    pub(crate) submissions: AtomicU64,
    pub(crate) waits: AtomicU64,
    pub(crate) readback: ReadbackPool,
}

/// Required features.
const REQUIRED: Features =
    Features::SHADER_INT64.union(Features::SHADER_INT64_ATOMIC_MIN_MAX).union(Features::FLOAT32_FILTERABLE);

/// Optional features.
const OPTIONAL: Features = Features::TIMESTAMP_QUERY
    .union(Features::IMMEDIATES)
    .union(Features::PRIMITIVE_INDEX)
    .union(Features::SUBGROUP)
    .union(Features::INDIRECT_FIRST_INSTANCE)
    .union(Features::MULTI_DRAW_INDIRECT_COUNT)
    .union(Features::RG11B10UFLOAT_RENDERABLE)
    .union(Features::TEXTURE_FORMAT_16BIT_NORM)
    .union(Features::TEXTURE_ADAPTER_SPECIFIC_FORMAT_FEATURES)
    .union(Features::SHADER_INT64_ATOMIC_ALL_OPS);

impl Gpu {
    /// Opens a device on the adapter that `options` select, with all limits of the adapter.
    ///
    /// # Errors
    /// [`GpuError::NoAdapter`] with advice, [`GpuError::Unsupported`] with the missing features.
    pub fn new(options: &GpuOptions) -> Result<Arc<Self>, GpuError> {
        let mut desc = wgpu::InstanceDescriptor::new_without_display_handle();
        desc.backends = Backends::VULKAN | Backends::METAL | Backends::DX12;
        // Validation layers are off unless WGPU_VALIDATION=1, also in debug builds: they need extra packages and cost
        // more than the work.
        desc.flags = (InstanceFlags::default() - InstanceFlags::debugging()).with_env();
        let instance = wgpu::Instance::new(desc);
        let adapters = block_on(instance.enumerate_adapters(Backends::all()));
        let wanted = options.adapter.clone().or_else(|| std::env::var("ARGUS_ADAPTER").ok());
        let adapter = choose(adapters, wanted.as_deref())?;
        let info = adapter.get_info();
        let missing = REQUIRED - adapter.features();
        if !missing.is_empty() {
            let missing = missing.iter_names().map(|(name, _)| name).collect::<Vec<_>>().join(", ");
            return Err(GpuError::Unsupported { adapter: info.name, missing });
        }
        let descriptor = wgpu::DeviceDescriptor {
            label: Some("argus"),
            required_features: REQUIRED | (OPTIONAL & adapter.features()),
            required_limits: adapter.limits(),
            ..Default::default()
        };
        let (device, queue) = block_on(adapter.request_device(&descriptor)).map_err(|error| {
            GpuError::NoAdapter(format!("the GPU `{}` gives no device: {error}", info.name))
        })?;
        let faults = Arc::new(Faults::default());
        let on_lost = Arc::clone(&faults);
        device.set_device_lost_callback(move |reason, message| {
            *on_lost.lost.lock() = Some(format!("{reason:?}: {message}"));
        });
        let on_error = Arc::clone(&faults);
        device.on_uncaptured_error(Arc::new(move |error| on_error.record(error)));
        tracing::info!(adapter = info.name, driver = info.driver_info, "GPU device opened");
        Ok(Arc::new(Self {
            device,
            queue,
            kind: format!("{} / {} {}", info.name, info.driver, info.driver_info),
            adapter: info,
            faults,
            longest_pass: Mutex::new(None),
            submissions: AtomicU64::new(0),
            waits: AtomicU64::new(0),
            readback: ReadbackPool::default(),
        }))
    }

    /// Kind of device for provenance: adapter, driver, version.
    pub fn kind(&self) -> &str {
        &self.kind
    }

    /// Number of submissions that were waited for so far.
    pub fn waits(&self) -> u64 {
        self.waits.load(Ordering::Relaxed)
    }

    /// Whether the adapter is a software driver (CPU).
    pub fn is_software(&self) -> bool {
        quirks::is_software(&self.adapter)
    }

    /// Workgroups for a list of unknown length, of which `most` are useful.
    pub fn list_workgroups(&self, most: u32) -> u32 {
        quirks::list_workgroups(&self.adapter, most)
    }

    /// Adapter information of the driver.
    pub fn adapter(&self) -> &wgpu::AdapterInfo {
        &self.adapter
    }

    /// Most bytes of an array that a program may bind.
    pub fn largest_array(&self) -> u64 {
        let limits = self.device.limits();
        limits.max_storage_buffer_binding_size.min(limits.max_buffer_size)
    }

    /// Whether the device has timestamps.
    pub fn has_timestamps(&self) -> bool {
        self.device.features().contains(Features::TIMESTAMP_QUERY)
    }

    /// The longest pass so far, milliseconds of the device's clock. `None` without timestamps or passes. See
    /// [`quirks::LONGEST_PASS_MS`].
    pub fn longest_pass(&self) -> Option<Stage> {
        self.longest_pass.lock().clone()
    }

    /// Numbers of submissions so far, and of times that a thread waited for one, with or without readbacks.
    pub fn traffic(&self) -> [u64; 2] {
        [&self.submissions, &self.waits].map(|count| count.load(Ordering::Relaxed))
    }

    pub(crate) fn note_pass(&self, name: &str, ms: f64) {
        let mut longest = self.longest_pass.lock();
        if longest.as_ref().is_none_or(|stage| ms > stage.ms) {
            *longest = Some(Stage::new(name.to_owned(), ms));
        }
    }

    /// Why the device was lost; `None` if it was not.
    pub fn lost(&self) -> Option<String> {
        self.faults.lost.lock().clone()
    }

    /// Number of faults so far. See [`Gpu::fault_since`].
    pub(crate) fn fault_count(&self) -> u64 {
        self.faults.count.load(Ordering::Acquire)
    }

    /// The loss of the device, or the latest fault since `count` was read.
    pub(crate) fn fault_since(&self, count: u64) -> Option<GpuError> {
        if self.fault_count() != count {
            // Commands to a lost device are rejected as invalid before the loss is reported.
            let _ = self.device.poll(wgpu::PollType::Poll);
        }
        if let Some(reason) = self.lost() {
            return Some(GpuError::Lost(reason));
        }
        if self.fault_count() == count { None } else { self.faults.latest.lock().clone() }
    }

    /// A zeroed buffer of `size` bytes, at least 16, because an empty buffer cannot be bound.
    pub fn buffer(&self, label: &str, size: u64, usage: wgpu::BufferUsages) -> wgpu::Buffer {
        self.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some(label),
            size: size.max(16).next_multiple_of(4),
            usage,
            mapped_at_creation: false,
        })
    }

    /// A buffer with content `data`. `COPY_DST` is added to its usage.
    pub fn upload<T: bytemuck::NoUninit>(
        &self,
        label: &str,
        data: &[T],
        usage: wgpu::BufferUsages,
    ) -> wgpu::Buffer {
        let bytes: &[u8] = bytemuck::cast_slice(data);
        let buffer = self.buffer(label, bytes.len() as u64, usage | wgpu::BufferUsages::COPY_DST);
        self.write(&buffer, data);
        buffer
    }

    /// Writes to the start of a buffer before the next submit.
    pub fn write<T: bytemuck::NoUninit>(&self, buffer: &wgpu::Buffer, data: &[T]) {
        let bytes: &[u8] = bytemuck::cast_slice(data);
        let whole = bytes.len() & !3;
        if whole > 0 {
            self.queue.write_buffer(buffer, 0, &bytes[..whole]);
        }
        if whole < bytes.len() {
            let mut tail = [0u8; 4];
            tail[..bytes.len() - whole].copy_from_slice(&bytes[whole..]);
            self.queue.write_buffer(buffer, whole as u64, &tail);
        }
    }

    /// A two-dimensional texture with one mip level.
    pub fn texture_2d(
        &self,
        label: &str,
        size: [u32; 2],
        format: wgpu::TextureFormat,
        usage: wgpu::TextureUsages,
    ) -> wgpu::Texture {
        self.device.create_texture(&wgpu::TextureDescriptor {
            label: Some(label),
            size: wgpu::Extent3d { width: size[0], height: size[1], depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format,
            usage,
            view_formats: &[],
        })
    }
}

/// Errors that the driver reported asynchronously.
#[derive(Debug, Default)]
struct Faults {
    lost: Mutex<Option<String>>,
    latest: Mutex<Option<GpuError>>,
    count: AtomicU64,
}

impl Faults {
    fn record(&self, error: wgpu::Error) {
        tracing::error!(%error, "GPU fault");
        let fault = match error {
            wgpu::Error::OutOfMemory { source } => GpuError::OutOfMemory(source.to_string()),
            other => GpuError::Rejected(other.to_string()),
        };
        *self.latest.lock() = Some(fault);
        self.count.fetch_add(1, Ordering::AcqRel);
    }
}

/// The wanted adapter, or one of the fastest kind.
fn choose(adapters: Vec<wgpu::Adapter>, wanted: Option<&str>) -> Result<wgpu::Adapter, GpuError> {
    let names: Vec<String> = adapters.iter().map(|a| a.get_info().name).collect();
    if names.is_empty() {
        let advice = "no Vulkan driver was found; install one (Debian, Ubuntu: `apt install \
                      mesa-vulkan-drivers libvulkan1`, which includes a software driver)";
        return Err(GpuError::NoAdapter(advice.to_owned()));
    }
    let index = match wanted.filter(|w| !w.is_empty()) {
        Some(wanted) => position(&names, wanted).ok_or_else(|| {
            let list = names.iter().enumerate().map(|(i, n)| format!("{i}: {n}")).collect::<Vec<_>>();
            GpuError::NoAdapter(format!("no adapter matches `{wanted}`; there is {}", list.join(", ")))
        })?,
        None => {
            let rank = |a: &wgpu::Adapter| match a.get_info().device_type {
                DeviceType::DiscreteGpu => 0,
                DeviceType::IntegratedGpu => 1,
                DeviceType::VirtualGpu => 2,
                DeviceType::Other => 3,
                DeviceType::Cpu => 4,
            };
            (0..adapters.len()).min_by_key(|&i| rank(&adapters[i])).unwrap_or(0)
        }
    };
    let mut adapters = adapters;
    Ok(adapters.swap_remove(index))
}

/// Index of the wanted name: `wanted` is an index or part of a name.
fn position(names: &[String], wanted: &str) -> Option<usize> {
    if let Ok(index) = wanted.parse::<usize>() {
        return (index < names.len()).then_some(index);
    }
    let wanted = wanted.to_lowercase();
    names.iter().position(|name| name.to_lowercase().contains(&wanted))
}

/// Runs one of wgpu's start-up futures, which are ready at once on native platforms.
fn block_on<F: Future>(future: F) -> F::Output {
    let mut future = std::pin::pin!(future);
    let mut context = std::task::Context::from_waker(std::task::Waker::noop());
    loop {
        if let std::task::Poll::Ready(output) = future.as_mut().poll(&mut context) {
            return output;
        }
        std::thread::yield_now();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_adapter_is_named_by_index_or_by_part_of_its_name() {
        let names = vec!["NVIDIA H200".to_owned(), "llvmpipe (LLVM 15.0.6, 256 bits)".to_owned()];
        assert_eq!(position(&names, "1"), Some(1));
        assert_eq!(position(&names, "2"), None);
        assert_eq!(position(&names, "LLVMpipe"), Some(1));
        assert_eq!(position(&names, "radeon"), None);
    }

    #[test]
    fn an_adapter_that_does_not_exist_is_answered_with_those_that_do() {
        let error = Gpu::new(&GpuOptions { adapter: Some("no such adapter".to_owned()) }).unwrap_err();
        assert!(error.to_string().contains("no such adapter"), "{error}");
    }
}
