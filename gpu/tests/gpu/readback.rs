//! What goes to the device comes back the same.

use argus_gpu::wgpu::{BufferUsages, TextureFormat};
use argus_gpu::{Gpu, GpuOptions, plane};
use argus_scene::{Plane, PlaneData, PlaneFormat, PlaneKind};
use bytes::Bytes;

use crate::gpu;

#[test]
fn buffers_come_back_whole_and_in_part_and_of_odd_length() {
    let gpu = gpu();
    let data: Vec<u8> = (0..=100u8).collect();
    let buffer = gpu.upload("test", &data, BufferUsages::COPY_SRC);
    for _ in 0..3 {
        let mut commands = gpu.commands("test");
        let whole = commands.read_buffer(&buffer, 0..101);
        let part = commands.read_buffer(&buffer, 8..16);
        let mut finished = commands.submit().wait().unwrap();
        assert_eq!(finished.take(whole)[..101], data);
        assert_eq!(finished.take(part)[..], data[8..16]);
        assert!(finished.take(part).is_empty(), "a readback has one result");
    }
}

#[test]
fn a_submission_without_work_is_answered() {
    let mut finished = gpu().commands("nothing").submit().wait().unwrap();
    assert!(finished.stages.is_empty());
    assert!(finished.take(argus_gpu::PendingReadback::default()).is_empty());
}

#[test]
fn planes_survive_the_device_whatever_their_width() {
    let gpu = gpu();
    for size in [[1, 1], [3, 5], [64, 2], [65, 3]] {
        let texels = (size[0] * size[1]) as usize;
        let bytes: Vec<u8> = (0..texels * 4).map(|i| (i * 7) as u8).collect();
        let host = Plane {
            kind: PlaneKind::Specular,
            format: PlaneFormat::Rgba8Unorm,
            size,
            data: PlaneData::Host(Bytes::from(bytes.clone())),
        };
        let texture = gpu.texture_2d("test", size, TextureFormat::Rgba8Unorm, plane::USAGE);
        plane::copy_into_layer(&gpu, &host, &texture, 0).unwrap();
        let device = plane::device_plane(host.kind, host.format, texture);
        let again = gpu.texture_2d("test", size, TextureFormat::Rgba8Unorm, plane::USAGE);
        plane::copy_into_layer(&gpu, &device, &again, 0).unwrap();
        let back = plane::to_host(&gpu, &plane::device_plane(host.kind, host.format, again)).unwrap();
        let PlaneData::Host(back) = back.data else { panic!("must be on the host") };
        assert_eq!(back, bytes, "{size:?}");
    }
}

#[test]
fn a_plane_that_does_not_fit_is_refused() {
    let gpu = gpu();
    let texture = gpu.texture_2d("test", [4, 4], TextureFormat::Rgba8Unorm, plane::USAGE);
    let plane = |size, bytes: usize| Plane {
        kind: PlaneKind::Specular,
        format: PlaneFormat::Rgba8Unorm,
        size,
        data: PlaneData::Host(Bytes::from(vec![0; bytes])),
    };
    assert!(plane::copy_into_layer(&gpu, &plane([4, 5], 80), &texture, 0).is_err());
    assert!(plane::copy_into_layer(&gpu, &plane([4, 4], 63), &texture, 0).is_err());
}

#[test]
fn a_rejected_command_is_an_error_of_that_submission_alone() {
    // A device of its own: a submission of another thread at the same moment may get the error.
    let gpu = Gpu::new(&GpuOptions::default()).unwrap();
    let small = gpu.upload("small", &[1u32, 2, 3, 4], BufferUsages::COPY_SRC);
    let mut commands = gpu.commands("beyond the end");
    commands.read_buffer(&small, 0..4096);
    assert!(commands.submit().wait().is_err());
    let mut commands = gpu.commands("within");
    let pending = commands.read_buffer(&small, 0..16);
    assert_eq!(commands.submit().wait().unwrap().take(pending).len(), 16);
}
