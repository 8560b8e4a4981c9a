//! Prefix sums of lists whose lengths only the device knows.

use argus_gpu::wgpu::BufferUsages;
use argus_gpu::{LengthAt, ListScan, Lists};

use crate::device::{gpu, read};
use crate::numbers::Numbers;

/// Scans a list of `length` values in buffers for `capacity`. Returns its sums, its total, and both lengths.
fn scanned(values: &[u32], length: u32, capacity: u32) -> (Vec<u32>, u32, [u32; 2]) {
    let gpu = gpu();
    let scan = ListScan::new(&gpu);
    let lists = Lists::new(&gpu, 3, capacity);
    let usage = BufferUsages::STORAGE | BufferUsages::COPY_SRC;
    let buffer = gpu.upload("values", values, usage);
    let total = gpu.upload("length", &[0, length - length.min(2)], usage);
    let mut commands = gpu.commands("lists");
    scan.advance(&mut commands, "scan", &lists, 2, LengthAt { buffer: &total, word: 1, more: length.min(2) });
    scan.run(&mut commands, "scan", &lists, 2, &buffer);
    commands.submit();
    let lengths: Vec<[u32; 2]> = read(&lists.lengths, 3);
    (read(&buffer, values.len()), read::<u32>(lists.total(), 1)[0], lengths[2])
}

#[test]
fn a_list_of_any_length_is_scanned_and_what_follows_it_stays() {
    let mut numbers = Numbers(3);
    for length in [0, 1, 31, 32, 33, 1023, 1024, 1025, 2047, 32_769, 100_000] {
        for capacity in [length.max(1), 100_000] {
            let values: Vec<u32> = (0..length + 9).map(|_| (numbers.unit() * 1000.0) as u32).collect();
            let (sums, total, lengths) = scanned(&values, length, capacity);
            assert_eq!(lengths, [length, length]);
            let mut sum = 0u32;
            for (at, (&value, &found)) in values.iter().zip(&sums).enumerate() {
                assert_eq!(
                    found,
                    if at < length as usize { sum } else { value },
                    "{length} in {capacity}, {at}"
                );
                sum += if at < length as usize { value } else { 0 };
            }
            assert_eq!(total, sum, "{length} in {capacity}");
        }
    }
}

#[test]
fn a_list_that_does_not_fit_is_empty_and_says_how_long_it_should_be() {
    let (values, total, lengths) = scanned(&[7; 50], 50, 49);
    assert_eq!((values, total, lengths), (vec![7; 50], 0, [0, 50]));
}
