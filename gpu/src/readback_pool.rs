//! A pool of mappable buffers. A steady stream of readbacks allocates nothing.

use parking_lot::Mutex;

/// Idle buffers.
#[derive(Debug, Default)]
pub(crate) struct ReadbackPool {
    free: Mutex<Vec<wgpu::Buffer>>,
}

/// Most bytes of idle buffers. Beyond it a returned buffer is dropped.
const MAX_IDLE_BYTES: u64 = 256 << 20;

impl ReadbackPool {
    /// A mappable buffer of at least `size` bytes: the smallest suitable idle one, or a new one.
    pub(crate) fn take(&self, device: &wgpu::Device, size: u64) -> wgpu::Buffer {
        let mut free = self.free.lock();
        let fits = |b: &wgpu::Buffer| b.size() >= size && b.size() <= 4 * size.max(64 << 10);
        let best = (0..free.len()).filter(|&i| fits(&free[i])).min_by_key(|&i| free[i].size());
        if let Some(index) = best {
            return free.swap_remove(index);
        }
        drop(free);
        device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("readback"),
            size: size.next_power_of_two().max(16),
            usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        })
    }

    pub(crate) fn give_back(&self, buffer: wgpu::Buffer) {
        let mut free = self.free.lock();
        if free.iter().map(wgpu::Buffer::size).sum::<u64>() + buffer.size() <= MAX_IDLE_BYTES {
            free.push(buffer);
        }
    }
}
