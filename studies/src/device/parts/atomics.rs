//! Scattered atomics of 32 and 64 bits, in buffers that fit the caches and in larger ones.

use std::sync::Arc;

use anyhow::Result;
use argus_gpu::{Gpu, GpuError, ScatteredAtomics, Word};

use super::measure::Measure;
use super::options::Options;
use crate::median::median;

/// Operations of the first dispatch.
const FIRST: u64 = 1 << 16;
/// Largest number of operations of a dispatch.
const MOST: u64 = 1 << 30;

pub(super) fn measure(gpu: &Arc<Gpu>, options: &Options) -> Result<Vec<Measure>> {
    let mut rows = Vec::new();
    for &bytes in &options.buffers {
        for word in [Word::Bits32, Word::Bits64] {
            rows.push(one(gpu, options, word, bytes)?);
        }
    }
    Ok(rows)
}

fn one(gpu: &Arc<Gpu>, options: &Options, word: Word, bytes: u64) -> Result<Measure> {
    let (name, variant) = ("scattered atomics", format!("{} bits, {}", word.bits(), size(bytes)));
    let mut atomics = match ScatteredAtomics::new(gpu, word, bytes) {
        Err(GpuError::OutOfMemory(why)) => return Ok(Measure::absent(name, variant, "G/s", why)),
        atomics => atomics?,
    };
    let mut operations = FIRST;
    // The first dispatch also compiles the pipeline.
    atomics.run(operations)?;
    loop {
        let (ms, _) = atomics.run(operations)?;
        match grown(operations, ms, options.dispatch_ms) {
            Some(more) => operations = more,
            None => break,
        }
    }
    let mut rates = Vec::new();
    for _ in 0..options.rounds {
        let (ms, done) = atomics.run(operations)?;
        rates.push(done as f64 / ms * 1e-6);
    }
    Ok(Measure::new(name, variant, median(&rates), "G/s")
        .noting(format!("{operations} operations a dispatch")))
}

/// Operations of the next dispatch, at most eight times as many; `None` if this one was long enough. The factor keeps a
/// dispatch well below a second even if the rate falls with its size.
fn grown(operations: u64, ms: f64, wanted_ms: f64) -> Option<u64> {
    if ms >= 0.5 * wanted_ms || operations >= MOST {
        return None;
    }
    let factor = if ms > 0.0 { (wanted_ms / ms).clamp(2.0, 8.0) } else { 8.0 };
    Some(((operations as f64 * factor) as u64).min(MOST))
}

/// Bytes in decimal units.
fn size(bytes: u64) -> String {
    match bytes {
        1_000_000_000.. => format!("{} GB", bytes / 1_000_000_000),
        _ => format!("{} MB", bytes / 1_000_000),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dispatches_grow_until_they_are_long_enough_or_reach_the_limit() {
        assert_eq!(grown(1 << 16, 0.0, 50.0), Some(1 << 19));
        assert_eq!(grown(1 << 16, 20.0, 50.0), Some(163_840));
        assert_eq!(grown(1 << 16, 25.0, 50.0), None);
        assert_eq!(grown(MOST / 2, 0.001, 50.0), Some(MOST));
        assert_eq!(grown(MOST, 0.001, 50.0), None);
        // A clock without timestamps also ends the growth at the limit.
        assert_eq!(grown(MOST, f64::NAN, 50.0), None);
    }

    #[test]
    fn sizes_are_decimal() {
        assert_eq!([15_000_000, 4_000_000_000].map(size), ["15 MB", "4 GB"]);
    }
}
