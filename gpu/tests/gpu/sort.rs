//! Prefix sums and sorting.

use argus_gpu::wgpu::BufferUsages;
use argus_gpu::{Scan, ScanSums, Sort, SortScratch};

use crate::numbers::Numbers;
use crate::{gpu, read};

const USAGE: BufferUsages = BufferUsages::STORAGE.union(BufferUsages::COPY_SRC);

#[test]
fn prefix_sums_of_every_size_around_the_runs_are_exact() {
    let gpu = gpu();
    let scan = Scan::new(&gpu);
    for count in [1usize, 2, 31, 32, 33, 1023, 1024, 1025, 32 * 32 * 32 + 1, 200_003] {
        let mut numbers = Numbers(count as u64);
        let values: Vec<u32> = (0..count).map(|_| numbers.next() as u32 % 1000).collect();
        let buffer = gpu.upload("values", &values, USAGE);
        let sums = ScanSums::new(&gpu, count as u64);
        let mut commands = gpu.commands("scan");
        scan.run(&mut commands, "scan", &buffer, count as u32, &sums);
        commands.submit().wait().unwrap();
        let before = values.iter().scan(0u32, |sum, v| {
            *sum += v;
            Some(*sum - v)
        });
        assert_eq!(read::<u32>(&buffer, count), before.collect::<Vec<_>>(), "{count}");
        assert_eq!(read::<u32>(sums.total(), 1), [values.iter().sum::<u32>()], "{count}");
    }
}

#[test]
fn fewer_values_than_there_is_room_for_leave_the_rest_alone() {
    let gpu = gpu();
    let buffer = gpu.upload("values", &[1u32; 100], USAGE);
    let sums = ScanSums::new(&gpu, 5000);
    let mut commands = gpu.commands("scan");
    Scan::new(&gpu).run(&mut commands, "scan", &buffer, 40, &sums);
    commands.submit().wait().unwrap();
    let expected: Vec<u32> = (0..100).map(|i| if i < 40 { i } else { 1 }).collect();
    assert_eq!(read::<u32>(&buffer, 100), expected);
    assert_eq!(read::<u32>(sums.total(), 1), [40]);
}

#[test]
fn keys_are_sorted_by_the_bits_asked_for_and_stay_in_order_where_those_are_equal() {
    let gpu = gpu();
    let (scan, sort) = (Scan::new(&gpu), Sort::new(&gpu));
    for (count, bits) in
        [(1usize, 0..64), (63, 0..64), (64, 60..64), (65, 32..62), (5000, 32..35), (70_001, 0..64)]
    {
        let mut numbers = Numbers(count as u64);
        // Few distinct digits in the upper half, so that stability is put to the test.
        let keys: Vec<u64> = (0..count).map(|_| numbers.next() & 0xf0f0_0003_0000_ffff).collect();
        let buffer = gpu.upload("keys", &keys, USAGE);
        let scratch = SortScratch::new(&gpu, count as u64);
        let mut commands = gpu.commands("sort");
        let sorted = sort.run(&mut commands, &scan, &buffer, count as u32, bits.clone(), &scratch).clone();
        commands.submit().wait().unwrap();
        let mut expected = keys;
        // Digits are whole: the range is rounded up to a multiple of four bits.
        let width = (bits.end - bits.start).next_multiple_of(4);
        let mask = if width >= 64 { u64::MAX } else { (1u64 << width) - 1 };
        expected.sort_by_key(|key| key >> bits.start & mask);
        assert_eq!(read::<u64>(&sorted, count), expected, "{count} {bits:?}");
    }
}
